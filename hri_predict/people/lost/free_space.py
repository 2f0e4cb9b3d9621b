"""Space seen free by a source, and places where a lost person may still be.

Only a sensor that distinguishes free from occupied space gives such evidence (a depth camera or a
lidar with a tracker that reports every person who stands in the open): ``source.sees_free_space``.
The floor is a grid. A cell is *open* in a scene if no person could stand there unseen: the cell and
half a body's width around it are inside the field of view (or behind a wall), outside every static
shadow, and not behind (or at) another body. A lost person may be in any cell within walking
distance of where they were last seen, except in cells that can be reached only by staying in the
open for ``free_captures`` captures.

So a person who steps behind a pallet can only be there, or within reach of the pallet, until the
sensor sees behind it.

No person vanishes in the open. If the place where a person was last seen counts as open, and no
person is seen there again, that place is in fact hidden: an unknown object (such as a vehicle) of
unknown size and motion stands between the place and the camera. For this person, no place then
counts as seen free until a body is seen down to its feet at that place, or just behind it on the
same line of sight. A drop-out of the tracker thus ends when the body is found again.

A body with a stated position error may hide other places than it appears to. So scenes with such a
body prove nothing, and for a lost person with such an error no place counts as seen free.
"""

import itertools
import math
from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import in_polygon, segment_distance
from hri_predict.base.settings import Region
from hri_predict.contracts.source import SourceSettings
from hri_predict.people.settings import PeopleSettings

FREE_SPACE_M = 60.0
"""Maximum size of the grid of seen free space: a larger one would delay the advice."""
CELL_M = 0.25
BODY_M = 0.3
"""Half a body's width. A person this near to a hidden place may be half hidden and not detected."""
HIDES_M = 0.3
"""Height of a person who lies on the floor."""
TALL_M = 2.0
"""Maximum height at which a shadow that hides a standing person begins."""
STEP_M = 0.5
"""Maximum change of a body's mean between scenes, due to other joints or a step."""
ON_LINE_M, BEFORE_M, BEHIND_M = 0.2, 0.2, 0.5
"""Maximum distances of a body from the line of sight to a place, in front of the place and behind
it, at which the body shows that the line is free. From a camera 2.4 m high and 4 m away, such a
line is at most half a metre above the place: lower objects do not hide a person."""
MOST_PLACES = 16
"""Maximum number of discs; at most the number of a body's segments, because a zone has one capsule
for each segment."""
_HALF_M = CELL_M * math.sqrt(0.5)  # from a cell's middle to its corner
_BORDER_M = 1.0  # of the grid around the field of view: cells that are never open


class FreeSpace:
    """The grid and its open cells.

    Args:
        view: space that the sensor sees.
        room: region where people can be, up to walls and fences; ``None``: everywhere.
        shadows: space within the view that the sensor never sees.
        viewpoints: (V, 3) camera positions; empty: unknown, so no cell is open in a scene with
            people, because they may hide others.
        captures: number of captures within which a person in the open is seen at least once.
        floor_m: height of the floor.
    """

    def __init__(
        self,
        *,
        view: Region,
        room: Region | None,
        shadows: Sequence[Region],
        viewpoints: Sequence[Sequence[float]],
        captures: int,
        floor_m: float = 0.0,
    ) -> None:
        corners = np.asarray((room or view).polygon, dtype=np.float64)
        low = corners.min(0) - _BORDER_M
        self.shape = tuple(np.ceil((np.ptp(corners, axis=0) + 2 * _BORDER_M) / CELL_M).astype(int))
        x, y = np.meshgrid(*(np.arange(n) for n in self.shape), indexing="ij")
        self.centres: Floats = low + CELL_M * (np.stack([x, y], axis=-1) + 0.5)
        self.captures = captures
        self._viewpoints = np.asarray(viewpoints, dtype=np.float64).reshape(-1, 3)[:, :2]
        self.in_room: Bools = np.ones(self.shape, bool)
        if room is not None:
            self.in_room = self._contains(room)
        sees_floor = view.z_min <= floor_m + HIDES_M
        seen = self._contains(view) if sees_floor else np.zeros(self.shape, bool)
        for shadow in shadows:
            if shadow.z_max > floor_m + HIDES_M and shadow.z_min < floor_m + TALL_M:
                seen &= ~self._touches(shadow)
        hidden = (self.in_room & ~seen).astype(np.intp)
        for _ in range(math.ceil((BODY_M + _HALF_M) / CELL_M)):
            hidden = _spread(hidden)
        self._open: Bools = hidden == 0

    def free(self, seen: Sequence[Floats]) -> Bools:
        """Return which cells are open in a scene with bodies at these (3,) positions."""
        if not len(seen):
            return self._open
        if not len(self._viewpoints):
            return np.zeros(self.shape, bool)
        hidden = np.ones(self.shape, bool)
        for viewpoint in self._viewpoints:
            hidden &= self._behind(viewpoint, np.array(seen)[:, :2])
        return self._open & ~hidden

    def start(self, place: Floats, capture_ns: int, speed_m_s: float) -> "Whereabouts | None":
        """Return the cells in which a person last seen at ``place`` (3,) may be; ``None``:
        ``place`` is off the grid, or outside the room.
        """
        if not self.within(place, STEP_M).any():  # nobody can be there: do not rely on it
            return None
        return Whereabouts(self, place[:2], capture_ns, speed_m_s)

    def within(self, place: Floats, metres: float) -> Bools:
        """Return the cells of the room with centres within this distance of ``place``."""
        apart = np.hypot(*np.moveaxis(self.centres - place[:2], -1, 0))
        near: Bools = self.in_room & (apart <= metres)
        return near

    def shows(self, place: Floats, standing: Sequence[Floats]) -> bool:
        """Return whether bodies seen down to their feet at these (2,) places show that ``place`` is
        seen. With several cameras it is unknown which one sees a body, so only the place itself
        counts.
        """
        for body in standing:
            away = body - place
            if np.hypot(*away) <= ON_LINE_M:
                return True
            if len(self._viewpoints) == 1:
                sight = place - self._viewpoints[0]
                sight = sight / max(float(np.hypot(*sight)), 1e-9)
                aside = abs(float(away[0] * sight[1] - away[1] * sight[0]))
                if aside <= ON_LINE_M and -BEFORE_M <= float(away @ sight) <= BEHIND_M:
                    return True
        return False

    def _touches(self, region: Region) -> Bools:
        """Return cells that are at least partly inside."""
        return self._contains(region) | (self._edge_m(region) < _HALF_M)

    def _contains(self, region: Region) -> Bools:
        return in_polygon(self.centres, np.asarray(region.polygon, dtype=np.float64))

    def _edge_m(self, region: Region) -> Floats:
        corners = np.asarray(region.polygon, dtype=np.float64)
        start = np.column_stack([corners, np.zeros(len(corners))])
        end = np.roll(start, -1, axis=0)
        points = np.concatenate([self.centres, np.zeros((*self.shape, 1))], axis=-1)[..., None, :]
        distance: Floats = segment_distance(points, points, start, end).min(-1)
        return distance

    def _behind(self, viewpoint: Floats, bodies: Floats) -> Bools:
        """Return cells hidden from one camera, behind or at the (B, 2) places of bodies."""
        way = self.centres - viewpoint  # (X, Y, 2)
        length = np.maximum(np.hypot(way[..., 0], way[..., 1]), 1e-9)
        hidden = np.zeros(self.shape, bool)
        for body in bodies:
            to = body - viewpoint
            if np.hypot(*to) <= BODY_M + _HALF_M:  # at the camera, it may hide everything
                return np.ones(self.shape, bool)
            along = (way @ to) / length  # of the body, along the ray to the cell
            aside = np.abs(way[..., 0] * to[1] - way[..., 1] * to[0]) / length
            behind = (along > 0) & (along <= length + BODY_M + _HALF_M)
            # seen from the camera, what is farther away is narrower
            narrower = np.clip(along / length, 0.0, 1.0)
            hidden |= behind & (aside <= BODY_M + (BODY_M + _HALF_M) * narrower)
        return hidden


class Whereabouts:
    """Possible places of one lost person.

    Attributes:
        capture_ns: capture time of the newest scene used.
        speed_m_s: maximum walking speed of the person.
        disputed: whether the place where the person was last seen counted as open without a person
            there.
    """

    def __init__(self, space: FreeSpace, place: Floats, capture_ns: int, speed_m_s: float) -> None:
        self._space = space
        self._place = place
        self._begun_ns = capture_ns
        apart = np.hypot(*np.moveaxis(space.centres - place, -1, 0))
        nearest = np.where(space.in_room, apart, np.inf).argmin()
        self._home = np.unravel_index(int(nearest), space.shape)
        # The number of further captures that may miss a person in this cell; 0: nobody is there.
        self._left: Ints = np.where(space.within(place, STEP_M + CELL_M), space.captures, 0)
        self._travel_m = 0.0
        self._shown = False  # a body was seen there since
        self.disputed = False
        self.capture_ns = capture_ns
        self.speed_m_s = speed_m_s

    @property
    def anywhere(self) -> bool:
        """Whether any place is left where the person may be."""
        return bool(self._left.any())

    def update(self, capture_ns: int, free: Bools | None, standing: Sequence[Floats] = ()) -> None:
        """Expand the possible places until ``capture_ns``, then remove cells that are seen free.

        Args:
            capture_ns: capture time of the scene.
            free: cells that are open in the scene; ``None``: the scene proves nothing, and cells
                seen before must be seen again.
            standing: (2,) places of the bodies seen down to their feet in the scene.
        """
        self._shown = self._shown or self._space.shows(self._place, standing)
        self.disputed = self.disputed and not self._shown
        if self.disputed:
            free = None
        self._travel_m += self.speed_m_s * max(0, capture_ns - self.capture_ns) * 1e-9
        self.capture_ns = capture_ns
        while self._travel_m > 0:  # whole cells, before the way is walked: never too late
            wider = np.where(self._space.in_room, _spread(self._left), 0)
            self._travel_m -= CELL_M
            if np.array_equal(wider, self._left):  # everywhere: a pause of hours costs no more
                self._travel_m = min(self._travel_m, 0.0)
            self._left = wider
        unseen = np.where(self._left > 0, self._space.captures, 0)
        self._left = unseen if free is None else np.where(free, self._left - 1, unseen)
        np.maximum(self._left, 0, out=self._left)
        if not self._shown and not self._left[self._home]:
            self._dispute()

    def _dispute(self) -> None:
        """Reset to all places within walking distance: earlier free space is not trusted."""
        self.disputed = True
        seconds = max(0, self.capture_ns - self._begun_ns) * 1e-9
        reached = self._space.within(self._place, STEP_M + CELL_M + self.speed_m_s * seconds)
        self._left = np.where(reached, self._space.captures, 0)
        self._travel_m = 0.0

    def places(self) -> Floats:
        """Return (D, 3) x, y and radius of discs that cover every place, D <= ``MOST_PLACES``."""
        index = np.argwhere(self._left > 0)
        least = math.ceil(math.sqrt(len(index) / MOST_PLACES))  # smaller ones are too many
        for size in itertools.count(max(2, least)):  # cells along a block's edge
            number = index // size @ [len(self._left[0]) + 1, 1]
            used = np.bincount(number, minlength=1) > 0
            if np.count_nonzero(used) <= MOST_PLACES:
                block = (np.cumsum(used) - 1)[number]
                break
        return _discs(self._space.centres[index[:, 0], index[:, 1]], block)


def _discs(cells: Floats, block: Ints) -> Floats:
    """Return (D, 3) a disc around the cells of each block, from (M, 2) centres; x, y, radius."""
    if not len(cells):
        return np.zeros((0, 3))
    order = np.argsort(block, kind="stable")
    cells, starts = cells[order], np.flatnonzero(np.diff(block[order], prepend=-1))
    middle = 0.5 * (np.minimum.reduceat(cells, starts) + np.maximum.reduceat(cells, starts))
    apart = np.hypot(*(cells - middle[block[order]]).T)
    return np.column_stack([middle, np.maximum.reduceat(apart, starts) + _HALF_M])


def _spread(left: Ints) -> Ints:
    """Set each cell to the maximum of itself and its eight neighbours."""
    for axis in (0, 1):
        padded = np.pad(left, [(1, 1) if a == axis else (0, 0) for a in (0, 1)])
        a, b = np.moveaxis(padded, axis, 0), left.shape[axis]
        left = np.moveaxis(np.maximum(np.maximum(a[:b], a[1 : b + 1]), a[2:]), 0, axis)
    return left


def free_space_of(settings: PeopleSettings, source: SourceSettings) -> FreeSpace | None:
    """Return the grid of a source that sees free space; ``None`` for other sources.

    Raises:
        ConfigError: the room is too large.
    """
    if not source.sees_free_space or source.field_of_view is None:
        return None
    corners = np.asarray((settings.room or source.field_of_view).polygon)
    if np.ptp(corners, axis=0).max() > FREE_SPACE_M:
        raise ConfigError(
            f"source.sees_free_space: only for rooms up to {FREE_SPACE_M:g} m wide; draw"
            " people.room, or source.field_of_view, smaller"
        )
    return FreeSpace(
        view=source.field_of_view,
        room=settings.room,
        shadows=source.shadows,
        viewpoints=source.viewpoints,
        captures=settings.free_captures,
        floor_m=settings.floor_m,
    )
