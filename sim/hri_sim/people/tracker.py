"""A procedural body as a tracker reports it: the tracker's joints and errors."""

import math
from dataclasses import replace

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.contracts.joint_map import JointMap, load_joint_map


def delivered_by(tracker: JointMap) -> JointMap:
    """Return a joint map of canonical joints that delivers the same joints as ``tracker``.

    A joint that the tracker derives from other delivered joints (COCO's waist, between the hips) is
    derived from them here, too, and so has their errors. A joint derived from points that are not
    canonical joints (COCO's head, between the ears; a shoulder from markers on the chest) is taken
    directly from the body.
    """
    alone = (tracker.weights > 0) & ((tracker.weights > 0).sum(1, keepdims=True) == 1)
    owner = alone.astype(np.float64)  # (J, J_source): which canonical joint a source joint is
    known = owner.any(0)
    canonical = load_joint_map("canonical")
    weights = np.zeros_like(canonical.weights)
    for joint in np.flatnonzero(tracker.mapped):
        row = tracker.weights[joint]
        if row.any() and known[row > 0].all():
            weights[joint] = row @ (owner / np.maximum(owner.sum(0), 1.0)).T
        else:
            weights[joint, joint] = 1.0
    return replace(canonical, weights=weights)


class Wander:
    """Noise that is correlated in time: a first-order autoregression, one for each person.

    x_k = a x_(k-1) + sqrt(1 - a^2) n_k with a = exp(-1 / (rate tau)), so its standard deviation is
    ``wander_m`` at all times and its autocorrelation falls to 1/e after tau = ``wander_s``.

    Args:
        wander_m: standard deviation per axis.
        wander_s: correlation time.
        rate_hz: captures per second.
        seed: seed of its random numbers.
    """

    def __init__(self, wander_m: float, wander_s: float, rate_hz: float, seed: list[int]) -> None:
        self._wander_m = wander_m
        self._keeps = math.exp(-1.0 / (rate_hz * wander_s))
        self._rng = np.random.default_rng(seed)
        self._now: Floats | None = None

    def next(self, joints: int) -> Floats:
        """Return (joints, 3) metres, the error at the next capture."""
        fresh = self._rng.normal(0.0, self._wander_m, (joints, 3))
        if self._now is None:
            self._now = fresh
        else:
            self._now = self._keeps * self._now + math.sqrt(1.0 - self._keeps**2) * fresh
        return self._now
