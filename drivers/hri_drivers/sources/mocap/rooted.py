"""Detects streams with positions relative to the body, which do not locate people in the room."""

import numpy as np

from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats

STILL = 30
"""Number of captures in a row in which the body moves but its root is bit-identical."""


class Rooted:
    """Whether a person's root moves in the room.

    Programs that track only limbs put the body at one place. While the body moves, a measured root
    never keeps a bit-identical horizontal position. Captures without a measured root are skipped:
    the comparison uses the measured roots before and after them.

    Args:
        root: index of the root joint of the body (the pelvis).
        up: index of the vertical coordinate.

    Attributes:
        still: number of captures in a row in which the body moved and its root did not.
    """

    def __init__(self, root: int, up: int) -> None:
        self._root = root
        self._level = [axis for axis in range(3) if axis != up]
        self.still = 0
        self._newest: Floats | None = None
        self._root_at: Floats | None = None
        self._moved = False

    def sees(self, person: SentPerson) -> bool:
        """Process the next capture; return whether its position is credible."""
        newest, self._newest = self._newest, person.positions
        now = person.positions[self._root, self._level]
        if not np.isfinite(now).all():
            return self._moved
        before, self._root_at = self._root_at, now
        if newest is None or before is None:
            return False
        if not np.array_equal(before, now):
            self._moved, self.still = True, 0
        elif not np.array_equal(newest, person.positions, equal_nan=True):
            self.still += 1
            self._moved = self._moved and self.still < STILL
        return self._moved
