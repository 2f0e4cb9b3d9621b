"""A plan of the room in characters: people, their zones and the robots, seen from above."""

import numpy as np
from rich.text import Text

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules

LEAST_M = 2.0
"""The plan shows at least this much around every robot's base."""
FARTHEST_M = 30.0
"""Maximum distance from the first robot that is shown: no impossible place shrinks the plan."""
_MARGIN_M = 0.3
_STEPS_M = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0)
_DOT_M = 0.06  # radius of a joint
_NEAREST = 1.12  # columns from any point to the middle of the nearest character, at most


class Extent:
    """The part of the room that the plan shows. It only grows, so that the picture stays calm.

    Args:
        bases: (R, 2) where the robots stand, metres in the room's frame; with none, the origin.
    """

    def __init__(self, bases: Floats) -> None:
        self._middle = bases[0] if len(bases) else np.zeros(2)
        bases = bases if len(bases) else np.zeros((1, 2))
        self.low: Floats = bases.min(0) - LEAST_M
        self.high: Floats = bases.max(0) + LEAST_M

    def include(self, points: Floats) -> None:
        """Grow to hold (N, 2) or (N, 3) points; those that are too far away or NaN do not count."""
        xy = points.reshape(-1, points.shape[-1])[:, :2]
        xy = xy[np.isfinite(xy).all(1)]
        xy = xy[(np.abs(xy - self._middle) <= FARTHEST_M).all(1)]
        if len(xy):
            self.low = np.minimum(self.low, xy.min(0) - _MARGIN_M)
            self.high = np.maximum(self.high, xy.max(0) + _MARGIN_M)


class CharacterPlan:
    """Characters that show an extent: x to the right, y up.

    A character is about twice as high as it is wide, so a row is twice as long as a column.

    Args:
        extent: the region to show.
        columns: width in characters.
        rows: height in characters.
    """

    def __init__(self, extent: Extent, columns: int, rows: int) -> None:
        size = extent.high - extent.low
        least = max(size[0] / columns, size[1] / (2 * rows))
        self.column_m = next((step for step in _STEPS_M if step >= least), least)
        middle = (extent.low + extent.high) / 2
        xs = middle[0] + (np.arange(columns) - (columns - 1) / 2) * self.column_m
        ys = middle[1] + ((rows - 1) / 2 - np.arange(rows)) * 2 * self.column_m
        self._points = np.stack(np.meshgrid(xs, ys), axis=-1)[..., None, :]  # (rows, columns, 1, 2)
        self._cells = [[(" ", "")] * columns for _ in range(rows)]

    def capsules(self, capsules: Capsules, mark: str, style: str) -> None:
        """Mark every character whose middle lies under one of C capsules."""
        if not len(capsules.radius):
            return
        a, b = capsules.a[:, :2], capsules.b[:, :2]
        along = b - a
        length2 = np.maximum((along**2).sum(-1), 1e-12)
        t = np.clip(((self._points - a) * along).sum(-1) / length2, 0.0, 1.0)
        distance = np.linalg.norm(self._points - (a + t[..., None] * along), axis=-1)
        self._mark(
            (distance <= np.maximum(capsules.radius, _NEAREST * self.column_m)).any(-1), mark, style
        )

    def dots(self, points: Floats, mark: str, style: str) -> None:
        """Mark (N, 3) points; those that are not finite are left out."""
        ends = points[np.isfinite(points).all(axis=-1)]
        self.capsules(Capsules(ends, ends, np.full(len(ends), _DOT_M)), mark, style)

    def text(self) -> Text:
        """The plan, a line a row."""
        lines = (
            Text.assemble(*[(mark, style) for mark, style in row], no_wrap=True)
            for row in self._cells
        )
        return Text("\n").join(lines)

    def _mark(self, inside: Bools, mark: str, style: str) -> None:
        for row, column in np.argwhere(inside):
            self._cells[row][column] = (mark, style)
