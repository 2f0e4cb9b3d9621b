"""The floor that no sensor can see to be free, by the same rule that keeps people *lost* there.

The viewer computes it from the room and the people of a picture, at no cost to the node.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import in_polygon
from hri_predict.base.settings import Region
from hri_predict.people.lost.free_space import CELL_M, FREE_SPACE_M, FreeSpace


class UnseenFloor:
    """Unseen floor of a room from ``room.room_of``; none if its sensor does not see free space."""

    def __init__(self, room: dict[str, Any]) -> None:
        self._space: FreeSpace | None = None
        outline = room["walls"] or room["view"]
        if not room["sees_free_space"] or room["view"] is None:
            return
        corners = np.asarray(outline["polygon"], dtype=np.float64)
        if np.ptp(corners, axis=0).max() > FREE_SPACE_M:  # the node refuses such a room
            return
        self._space = FreeSpace(
            view=_region(room["view"]),
            room=None if room["walls"] is None else _region(room["walls"]),
            shadows=[_region(shadow) for shadow in room["shadows"]],
            viewpoints=room["viewpoints"],
            captures=1,
            floor_m=room["floor_m"],
        )
        self._inside = in_polygon(self._space.centres, corners)

    def tiles(self, places: Sequence[Sequence[float]], *, sees: bool) -> Floats:
        """Return (N, 4) rectangles: x and y of the middle, width and depth, metres.

        Args:
            places: x and y of all tracked people, who hide each other.
            sees: whether scenes are valid as proof now; if not, no place is seen to be free.
        """
        if self._space is None:
            return np.zeros((0, 4))
        seen = [np.array([*place[:2], 0.0]) for place in places]
        hidden = self._inside & ~self._space.free(seen) if sees else self._inside
        # runs of hidden cells along x: a tenth as many tiles as cells
        rows = np.pad(hidden.T.astype(np.int8), ((0, 0), (1, 1)))
        change = np.diff(rows, axis=1)
        row, start = np.nonzero(change == 1)
        _, end = np.nonzero(change == -1)
        low = self._space.centres[0, 0] - 0.5 * CELL_M
        wide = (end - start) * CELL_M
        deep = np.full(len(row), CELL_M)
        x = low[0] + start * CELL_M + 0.5 * wide
        return np.column_stack([x, low[1] + (row + 0.5) * CELL_M, wide, deep])


def _region(data: dict[str, Any]) -> Region:
    return Region.model_construct(**data)
