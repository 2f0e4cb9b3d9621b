"""Checks of the contracts, on any predictor, source or link: ``hri-predict conformance PART``.

``predictors``, ``sources`` and ``links`` contain the checks, one short function for each
requirement; ``checks`` runs them. They use a part as the node does, so a part that passes works in
the node, and a failure describes the problem that the node would have.
"""
