"""Checks of the contracts, on any predictor, source or link: ``hri-predict conformance PART``.

``predictors``, ``sources`` and ``links`` hold the checks, one short function for each thing that a
contract asks; ``checks`` runs them. What is checked is how the node uses a part, so a part that
passes works in the node, and one that fails says what the node would have met.
"""
