"""The floor in cells: where people were seen, where they vanished, and where no person was."""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import in_polygon
from hri_predict.base.settings import Region
from hri_predict.commissioning.report import MAX_CELLS, GridResult

BASE_M = 0.4
"""Minimum distance at which a person can stand from a robot's base."""


class Grid:
    """Cells around the robots: within reach plus protective separation distance of any of them.

    Args:
        cell_m: side of a cell.
        circles: (R, 3) x, y and radius of each robot's circle, metres, room frame.
        view: space that the sensor sees; cells outside count as ``outside``. ``None``: everything.
        exclude: polygons (N, 2) where no person can stand: machines, walls.

    Raises:
        ConfigError: there would be more than ``MAX_CELLS`` cells, or none is left.
    """

    def __init__(
        self,
        cell_m: float,
        circles: Floats,
        *,
        view: Region | None = None,
        exclude: Sequence[Floats] = (),
    ) -> None:
        self.cell_m = cell_m
        low = np.floor((circles[:, :2] - circles[:, 2:]).min(axis=0) / cell_m) * cell_m
        high = (circles[:, :2] + circles[:, 2:]).max(axis=0)
        columns, rows = (max(1, math.ceil(v)) for v in (high - low) / cell_m)
        if columns * rows > MAX_CELLS:
            raise ConfigError(
                f"walk.cell_m {cell_m:g}: {columns * rows} cells; at most {MAX_CELLS}: give more"
            )
        self.origin, self.columns, self.rows = low, columns, rows
        middles = self._middles()
        away = np.linalg.norm(middles[:, None] - circles[:, :2], axis=-1)
        inside = (away <= circles[:, 2]).any(axis=1) & (away >= BASE_M).all(axis=1)
        for polygon in exclude:
            inside &= ~in_polygon(middles, polygon)
        seen = np.ones(len(middles), np.bool_)
        if view is not None:
            seen = in_polygon(middles, np.asarray(view.polygon, np.float64))
        self._area = np.flatnonzero(inside & seen)
        self._outside = np.flatnonzero(inside & ~seen)
        if not len(self._area):
            raise ConfigError(
                "walk: no cell is left around the robots; look at source.field_of_view and "
                "walk.exclude"
            )
        self._seen: Counter[int] = Counter()
        self._lost: Counter[int] = Counter()

    def see(self, positions: Floats, observed: Bools) -> None:
        """Note a person who is seen: joints (J, 3) in the room, (J,) whether observed."""
        for cell in set(self._cells(positions[observed, :2])):
            self._seen[cell] += 1

    def lose(self, positions: Floats) -> None:
        """Note a person who vanished, last seen with joints (J, 3); NaN where never seen."""
        known = positions[np.isfinite(positions).all(axis=1), :2]
        if len(known):
            for cell in self._cells(known.mean(axis=0)[None]):
                self._lost[cell] += 1

    def result(self) -> GridResult:
        """Return the cells seen so far."""
        return GridResult(
            cell_m=self.cell_m,
            origin=[round(float(v), 4) for v in self.origin],
            columns=self.columns,
            rows=self.rows,
            area=self._area.tolist(),
            outside=self._outside.tolist(),
            seen=dict(sorted(self._seen.items())),
            lost=dict(sorted(self._lost.items())),
        )

    def _middles(self) -> Floats:
        """(columns * rows, 2) the middle of each cell."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        middles: Floats = (
            self.origin + (np.column_stack([x.ravel(), y.ravel()]) + 0.5) * self.cell_m
        )
        return middles

    def _cells(self, points: Floats) -> list[int]:
        """The cells of (N, 2) points; points outside the grid are in none."""
        finite = points[np.isfinite(points).all(axis=1)]
        place = np.floor((finite - self.origin) / self.cell_m)
        there = ((place >= 0) & (place < [self.columns, self.rows])).all(axis=1)
        place = place[there].astype(int)
        found: list[int] = (place[:, 1] * self.columns + place[:, 0]).tolist()
        return found
