"""Finds streams whose positions are relative to the body: they do not say where a person is."""

import numpy as np

from hri_drivers.sources.sent import SentPerson
from hri_predict.base.arrays import Floats

STILL = 30
"""Captures in a row in which the body moves and its root does not, to the last bit."""


class Rooted:
    """Whether a person's root moves in the room.

    Programs that track limbs alone put the body at one place. A measured root is never at the same
    horizontal place, to the last bit, while the body moves. A root that is not measured says
    nothing: two measured ones are compared across the captures between them.

    Args:
        root: index of the joint that carries the body (the pelvis).
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
        """Take the next capture; return whether its place can be believed."""
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
