"""Detects a moved sensor: for seconds, two sensors see the same people in different places.

If exactly one body of each of two sensors is within ``REACH_M`` of the other, both are assumed here
to be one person, whether merged or not. Between well-registered sensors, the centres of their
common joints are a few centimetres apart, because trackers place joints differently from each side.
A larger median over seconds is not noise: a sensor was moved or turned, or its pose or latency is
wrong. It is not possible to determine which of the two sensors is at fault.
"""

from collections import deque
from collections.abc import Mapping
from itertools import combinations

import numpy as np

from hri_predict.people.merging.likeness import Seen
from hri_predict.people.track import Body

REACH_M = 0.8
"""Maximum distance between two bodies that are assumed to be one person."""
WELL_JOINTS = 8
"""Minimum number of joints seen by both: their centre is then accurate to about a centimetre."""
SAMPLE_NS = 100_000_000
PER_S = 10


class Disagreement:
    """Distances between the bodies of each pair of sensors. One thread only.

    Args:
        moved_m, moved_s: see ``MergedSettings``.
    """

    def __init__(self, moved_m: float, moved_s: float) -> None:
        self._moved_m = moved_m
        self._count = round(moved_s * PER_S)
        self._apart: dict[tuple[int, int], deque[float]] = {}
        self._next_ns: int | None = None

    def note(self, time_ns: int, bodies: Mapping[Seen, Body]) -> None:
        """Add all bodies of one time; used at most ten times a second."""
        if self._next_ns is not None and time_ns < self._next_ns:
            return
        self._next_ns = time_ns + SAMPLE_NS
        whole = {s: b for s, b in bodies.items() if np.count_nonzero(b.observed) >= WELL_JOINTS}
        for one, other in combinations(sorted({seen.sensor for seen in whole}), 2):
            samples = self._apart.setdefault((one, other), deque(maxlen=self._count))
            samples.extend(_apart_m(whole, one, other))

    def apart_m(self) -> dict[tuple[int, int], float]:
        """Pairs of sensors that disagree, with their distance in metres."""
        found = {}
        for pair, samples in self._apart.items():
            if len(samples) == self._count:
                median_m = float(np.median(samples))
                if median_m > self._moved_m:
                    found[pair] = median_m
        return found


def _apart_m(bodies: Mapping[Seen, Body], one: int, other: int) -> list[float]:
    """Return the distances of the pairs of bodies that have no other body near them."""
    ours = [body for seen, body in bodies.items() if seen.sensor == one]
    theirs = [body for seen, body in bodies.items() if seen.sensor == other]
    apart = np.full((len(ours), len(theirs)), np.inf)
    for i, body in enumerate(ours):
        for j, their in enumerate(theirs):
            both = body.observed & their.observed
            if np.count_nonzero(both) >= WELL_JOINTS:
                between = (their.positions[both] - body.positions[both]).mean(axis=0)
                apart[i, j] = float(np.linalg.norm(between))
    near = apart <= REACH_M
    alone = near & (near.sum(0) == 1) & (near.sum(1, keepdims=True) == 1)
    return [float(metres) for metres in apart[alone]]
