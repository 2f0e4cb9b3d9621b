"""Whether bodies that two sensors see may be one person's, by the joints that both see."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.merging.sensor import Key
from hri_predict.people.track import Body

LEAST_JOINTS = 5
"""From fewer joints that both see, two bodies are not known to be one person's."""
_SIDES = [[JOINTS.index(f"{side}_{joint}") for side in "lr"] for joint in ("shoulder", "hip")]
MAYBE_M = 0.5
"""Two bodies without that many may be one person's if their middles are this near."""


class Seen(NamedTuple):
    """A body of one of several sensors: the sensor's number, and the body's key there."""

    sensor: int
    key: Key


class Likeness:
    """Distances between the bodies of one time, each worked out once.

    Args:
        bodies: all of them, canonical joints at the same time.
        same_m, apart_m: see ``MergedSettings``.
    """

    def __init__(self, bodies: Mapping[Seen, Body], same_m: float, apart_m: float) -> None:
        self.bodies = bodies
        self._same_m, self._apart_m = same_m, apart_m
        self._known: dict[tuple[Seen, Seen], float | None] = {}

    def apart_m(self, one: Seen, other: Seen) -> float | None:
        """Median distance of the joints that both see, metres; ``None``: too few joints."""
        pair = (one, other) if one < other else (other, one)
        if pair not in self._known:
            self._known[pair] = median_m(self.bodies[one], self.bodies[other])
        return self._known[pair]

    def is_same(self, one: Seen, other: Seen) -> bool:
        """Whether they are near enough, with both sides, to be taken for one person."""
        apart_m = self.apart_m(one, other)
        if apart_m is None or apart_m > self._same_m:
            return False
        return sides_m(self.bodies[one], self.bodies[other]) <= self._same_m

    def still_same(self, one: Seen, other: Seen) -> bool:
        """Whether two that were one person still are; one without a joint contradicts nothing."""
        if not (self.bodies[one].observed.any() and self.bodies[other].observed.any()):
            return True
        apart_m = self.apart_m(one, other)
        return apart_m is not None and apart_m <= self._apart_m

    def may_be(self, one: Seen, other: Seen) -> bool:
        """Whether they could be one person's: so near, or seen too little to say."""
        apart_m = self.apart_m(one, other)
        if apart_m is not None:
            return apart_m <= self._apart_m
        first, second = self.bodies[one], self.bodies[other]
        if not (first.observed.any() and second.observed.any()):
            return False
        return float(np.linalg.norm((first.centroid - second.centroid)[:2])) <= MAYBE_M


def median_m(one: Body, other: Body) -> float | None:
    """Median distance of the joints that two bodies have in common; ``None``: too few."""
    both = one.observed & other.observed
    if np.count_nonzero(both) < LEAST_JOINTS:
        return None
    return float(np.median(norm(one.positions[both] - other.positions[both])))


def sides_m(one: Body, other: Body) -> float:
    """Mean distance of both shoulders, or of both hips, whichever is less; inf: neither is seen.

    Of two people who stand shoulder to shoulder and look opposite ways, the left sides are nearly
    in one place; their right sides are a metre apart.
    """
    both = one.observed & other.observed
    found = [
        float(norm(one.positions[pair] - other.positions[pair]).mean())
        for pair in _SIDES
        if both[pair].all()
    ]
    return min(found, default=np.inf)
