"""Ids for the people of one camera.

It has its own matching because no tracker on the package index fits: norfair 2.3 needs numpy below
2, and trackers 2.6 installs SciPy and the OpenCV build with windows, which overwrites the headless
build. Bodies are matched by their predicted positions only. An id that could belong to two people
goes to the nearer one, and the node detects ids that move from one body to another.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_drivers.camera.network.found import apart
from hri_predict.base.arrays import Floats

KEPT_S = 0.5
"""A person who was not found for longer has left; the next body there gets a new id."""
GATE = 0.3
"""Maximum distance between a body and its predicted position, in extents of the body."""
BLEND_S = 0.1
"""Time constant of a body's velocity."""
MAX_ID = 65_535


@dataclass(slots=True, eq=False)
class _Track:
    id: int
    pixels: Floats
    seen_ns: int
    velocity: Floats  # (2,) pixels per second, of the body as a whole

    def at(self, now_ns: int) -> Floats:
        return self.pixels + self.velocity * (now_ns - self.seen_ns) / 1e9

    def follow(self, pixels: Floats, now_ns: int) -> None:
        passed_s = (now_ns - self.seen_ns) / 1e9
        steps = pixels - self.pixels
        steps = steps[np.isfinite(steps).all(axis=1)]
        if len(steps) and passed_s > 0:
            share = 1.0 - np.exp(-passed_s / BLEND_S)
            self.velocity = self.velocity + share * (
                np.median(steps, axis=0) / passed_s - self.velocity
            )
        self.pixels, self.seen_ns = pixels, now_ns


class Tracker:
    """Gives each person an id that stays from image to image."""

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._last_id = 0

    @property
    def given(self) -> int:
        """Number of people who got an id."""
        return self._last_id

    def assign(self, people: Sequence[Floats], now_ns: int) -> list[int]:
        """Return an id, 1..65535, for each person of an image.

        Args:
            people: (J, 2) pixels of each person; NaN where not found.
            now_ns: time of the image.
        """
        oldest = now_ns - round(KEPT_S * 1e9)
        self._tracks = [track for track in self._tracks if track.seen_ns >= oldest]
        led = [track.at(now_ns) for track in self._tracks]
        pairs = sorted(
            (distance, p, t)
            for p, pixels in enumerate(people)
            for t, expected in enumerate(led)
            if (distance := apart(pixels, expected)) <= GATE
        )
        of: dict[int, _Track] = {}
        taken: set[int] = set()
        for _, p, t in pairs:  # the nearest pair first
            if p not in of and t not in taken:
                of[p] = self._tracks[t]
                taken.add(t)
        return [self._id(of.get(p), pixels, now_ns) for p, pixels in enumerate(people)]

    def _id(self, track: _Track | None, pixels: Floats, now_ns: int) -> int:
        if track is None:
            self._last_id += 1
            number = (self._last_id - 1) % MAX_ID + 1
            self._tracks.append(_Track(number, pixels, now_ns, np.zeros(2)))
            return number
        track.follow(pixels, now_ns)
        return track.id
