"""Checks whether bodies seen by two sensors may be one person, from their common joints."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.merging.sensor import Key
from hri_predict.people.track import Body

LEAST_JOINTS = 5
"""Minimum number of common joints from which two bodies are known to be one person."""
_SIDES = [[JOINTS.index(f"{side}_{joint}") for side in "lr"] for joint in ("shoulder", "hip")]
MAYBE_M = 0.5
"""Maximum distance of the centres at which bodies with fewer common joints may be one person."""


class Seen(NamedTuple):
    """A body of one of several sensors: the sensor's number, and the body's key in that sensor."""

    sensor: int
    key: Key


class Likeness:
    """Distances between the bodies at one time, all computed together.

    There may be 64 people for each of four sensors, and the merge must not delay the node.

    Args:
        bodies: all of them, canonical joints at the same time.
        same_m, apart_m: see ``MergedSettings``.
    """

    def __init__(self, bodies: Mapping[Seen, Body], same_m: float, apart_m: float) -> None:
        self.bodies = bodies
        self._apart_m = apart_m
        self._order = list(bodies)
        self._place = {seen: k for k, seen in enumerate(bodies)}
        positions = np.array([b.positions for b in bodies.values()]).reshape(-1, len(JOINTS), 3)
        observed = np.array([b.observed for b in bodies.values()], np.bool_)
        observed = observed.reshape(-1, len(JOINTS))
        self._apart = _medians_m(positions, observed)
        self._same = (self._apart <= same_m) & (_sides_m(positions, observed) <= same_m)
        self._that_may_be: dict[Seen, list[Seen]] = {}
        self._may_be = self._all_that_may_be(positions, observed)

    def apart_m(self, one: Seen, other: Seen) -> float | None:
        """Return the median distance of common joints, metres; ``None``: too few joints."""
        apart_m = float(self._apart[self._place[one], self._place[other]])
        return apart_m if apart_m < np.inf else None

    def is_same(self, one: Seen, other: Seen) -> bool:
        """Return whether two bodies are near enough, on both sides, to count as one person."""
        return bool(self._same[self._place[one], self._place[other]])

    def still_same(self, one: Seen, other: Seen) -> bool:
        """Return whether two bodies of one person still fit; a body without a joint always fits."""
        if not (self.bodies[one].observed.any() and self.bodies[other].observed.any()):
            return True
        apart_m = self.apart_m(one, other)
        return apart_m is not None and apart_m <= self._apart_m

    def that_may_be(self, seen: Seen) -> list[Seen]:
        """Return the bodies of other sensors that could be this body: near, or with too few joints
        to decide.

        A body without a joint is not included.
        """
        if seen not in self._that_may_be:
            others = (self._order[k] for k in np.flatnonzero(self._may_be[self._place[seen]]))
            self._that_may_be[seen] = [each for each in others if each.sensor != seen.sensor]
        return self._that_may_be[seen]

    def _all_that_may_be(self, positions: Floats, observed: Bools) -> Bools:
        """(N, N) whether two bodies could be one person."""
        counts = observed.sum(axis=1)
        middles = positions[..., :2].sum(axis=1) / np.maximum(counts, 1)[:, None]
        near: Bools = np.linalg.norm(middles[:, None] - middles, axis=2) <= MAYBE_M
        seen = (counts > 0)[:, None] & (counts > 0)
        may_be: Bools = (self._apart <= self._apart_m) | (np.isinf(self._apart) & near & seen)
        return may_be


def _medians_m(positions: Floats, observed: Bools) -> Floats:
    """Return (N, N) median distance of the joints common to two bodies; inf: too few."""
    medians = np.full((len(positions), len(positions)), np.inf)
    for k in range(len(positions) - 1):
        both = observed[k] & observed[k + 1 :]
        apart = norm(positions[k] - positions[k + 1 :])
        ordered = np.sort(np.where(both, apart, np.inf), axis=1)
        counts = both.sum(axis=1)
        rows = np.arange(len(counts))
        middle = (ordered[rows, np.maximum(counts - 1, 0) // 2] + ordered[rows, counts // 2]) / 2
        medians[k, k + 1 :] = np.where(counts >= LEAST_JOINTS, middle, np.inf)
        medians[k + 1 :, k] = medians[k, k + 1 :]
    return medians


def _sides_m(positions: Floats, observed: Bools) -> Floats:
    """Return (N, N) mean distance of both shoulders, or of both hips if smaller; inf: neither is
    seen.

    If two people stand shoulder to shoulder and face opposite ways, their left sides are nearly in
    the same place, but their right sides are a metre apart.
    """
    nearest = np.full((len(positions), len(positions)), np.inf)
    for pair in _SIDES:
        seen: Bools = np.logical_and.reduce(observed[:, pair], axis=1)
        places = positions[:, pair]
        apart = norm(places[:, None] - places).mean(axis=2)
        nearest = np.minimum(nearest, np.where(seen[:, None] & seen, apart, np.inf))
    return nearest
