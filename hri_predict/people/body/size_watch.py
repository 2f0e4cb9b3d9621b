"""Detects people of a wrong size: the source's scale or unit is wrong.

A body at half or twice its size is at half or twice its distance from the sensor, and moves as
smoothly as a real one. A single capture proves little, because noise changes the lengths of bones,
so the limbs of a second decide.
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from hri_predict.base.arrays import median
from hri_predict.people.body.stature import MOST_M, statures_m
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body

LEAST_M = 1.0
"""Minimum stature: cameras foreshorten limbs, and clusters of markers lie between the joints. In
309 recordings of adults, a second's statures were 1.23 to 1.88 m."""
SAMPLE_NS, SAMPLES, LEAST_SAMPLES = 100_000_000, 10, 4
LEAST_BONES = 2
"""Minimum number of limb bones that show a size."""
FORGET_NS = 1_000_000_000


@dataclass(slots=True)
class _Recent:
    """The statures that one person's limbs indicated most recently, metres, and the verdict.

    They stay while limbs are hidden: a person of a wrong size does not become right by that.
    """

    seen_ns: int = NEVER
    sampled_ns: int = NEVER
    statures: deque[float] = field(default_factory=lambda: deque(maxlen=SAMPLES))
    is_wrong: bool = False

    def add(self, stature: float, capture_ns: int) -> None:
        """Add a sample, and judge."""
        self.sampled_ns = capture_ns
        self.statures.append(stature)
        if len(self.statures) >= LEAST_SAMPLES:
            self.is_wrong = not LEAST_M <= median(np.array(self.statures)) <= MOST_M


class SizeWatch:
    """Judges the size of the people of one source. One thread only.

    Args:
        settings: without posture checks, bodies may have any size, and are not judged.
    """

    def __init__(self, settings: PeopleSettings) -> None:
        self._on = settings.posture_unchecked is None
        self._recent: dict[int, _Recent] = {}

    def is_wrong(self, body: Body, capture_ns: int) -> bool:
        """Add one body, and return whether this person's limbs are too short or too long."""
        if not self._on:
            return False
        recent = self._recent.get(body.id)
        if recent is None or capture_ns - recent.seen_ns > FORGET_NS:
            kept = {n: r for n, r in self._recent.items() if capture_ns - r.seen_ns <= FORGET_NS}
            self._recent = kept
            recent = self._recent[body.id] = _Recent()
        recent.seen_ns = capture_ns
        if capture_ns - recent.sampled_ns >= SAMPLE_NS:
            found = statures_m(body.positions, body.observed)
            if len(found) >= LEAST_BONES:
                recent.add(median(found), capture_ns)
        return recent.is_wrong
