"""Stopping curves for the tests of separation."""

from hri_predict.robots.stopping import StoppingCurve


def constant(deceleration: float, top: float = 2.5) -> StoppingCurve:
    return StoppingCurve.of(lambda v: (v / deceleration, v * v / (2 * deceleration)), top)
