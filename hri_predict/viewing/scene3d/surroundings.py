"""Draws the room: seen and unseen space, and the named zones."""

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from viser import BatchedMeshHandle, LineSegmentsHandle, SceneNodeHandle, ViserServer

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import in_polygon
from hri_predict.base.settings import Region
from hri_predict.people.lost.free_space import CELL_M, FREE_SPACE_M, FreeSpace
from hri_predict.viewing.levels import COLOURS, GREY, LOST, VIEW, Rgb
from hri_predict.viewing.picture import Shapes
from hri_predict.viewing.scene3d.solids import ENDS_M, NO_SIZE, linear

UNSEEN_OPACITY, SHADOW_OPACITY = 0.30, 0.22
ABOVE_M = 0.006
"""Height above the floor's grid at which the unseen floor is drawn."""
_CAMERA_M = 0.07
_SQUARE = np.array([[-0.5, -0.5, 0], [0.5, -0.5, 0], [0.5, 0.5, 0], [-0.5, 0.5, 0]], np.float32)
_SQUARE_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)


class Surroundings:
    """The room in one server's scene."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._room: Any = None
        self._parts: list[SceneNodeHandle] = []
        self._outlines: dict[str, LineSegmentsHandle] = {}
        self._unseen = UnseenFloor(_NO_ROOM)
        self._tiles = np.zeros((0, 4))
        self._floor = self._first_floor()

    def draw(self, facts: dict[str, Any], known: bool) -> None:
        """Show the room of a picture; grey if the picture is not ``known`` to be current."""
        if facts["room"] != self._room:
            self._room = facts["room"]
            self._build()
        for zone in self._room["named"]:
            outline = self._outlines[zone["name"]]
            rgb = linear(_colour(facts["named"].get(zone["name"])) if known else GREY)
            outline.colors = np.broadcast_to(rgb, outline.points.shape).copy()
        tiles = self._unseen.tiles(facts["places"], sees=facts["sees"] and known)
        if not np.array_equal(tiles, self._tiles):
            self._tiles = tiles
            self._lay(tiles)

    def _build(self) -> None:
        for part in self._parts:
            with contextlib.suppress(Exception):  # viser removed it with its parent
                part.remove()
        self._parts, self._outlines = [], {}
        room = self._room
        if room["view"] is not None:
            self._region("field of view", room["view"], VIEW)
        for shadow in room["shadows"]:
            self._region("shadow", shadow, LOST)
        self._walls_of(room["shadows"])
        for index, point in enumerate(room["viewpoints"]):
            path = f"/cameras/{index}"
            ball = self._server.scene.add_icosphere(path, _CAMERA_M, VIEW, position=tuple(point))
            name = self._server.scene.add_label(f"{path}/name", "camera")
            self._parts += [name, ball]
        for zone in room["named"]:
            self._outlines[zone["name"]] = self._region(zone["name"], zone, GREY)
        self._unseen = UnseenFloor(room)

    def _region(self, name: str, region: dict[str, Any], rgb: Rgb) -> LineSegmentsHandle:
        """Draw the edges of a prism, with its name."""
        floor, roof = _floor_and_roof(region)
        edges = [(floor, np.roll(floor, -1, 0)), (roof, np.roll(roof, -1, 0)), (floor, roof)]
        points = np.concatenate([np.stack(edge, axis=1) for edge in edges]).astype(np.float32)
        path = f"/regions/{len(self._parts)}"
        line = self._server.scene.add_line_segments(
            path, points, rgb, thickness=1.6, thickness_units="screen"
        )
        label = self._server.scene.add_label(f"{path}/name", name, position=tuple(floor[0]))
        self._parts += [label, line]
        return line

    def _walls_of(self, regions: list[dict[str, Any]]) -> None:
        """Draw the transparent sides of all these prisms as one mesh."""
        if not regions:
            return
        vertices, faces = sides_of(regions)
        self._parts.append(
            self._server.scene.add_mesh_simple(
                "/shadows",
                vertices,
                faces,
                color=LOST,
                opacity=SHADOW_OPACITY,
                side="double",
                flat_shading=True,
                cast_shadow=False,
                receive_shadow=False,
            )
        )

    def _first_floor(self) -> BatchedMeshHandle:
        """Return an empty batch of tiles; created before the zones, it is drawn before them."""
        return self._server.scene.add_batched_meshes_simple(
            "/unseen",
            _SQUARE,
            _SQUARE_FACES,
            batched_wxyzs=np.tile(np.array([1, 0, 0, 0], np.float32), (2, 1)),
            batched_positions=ENDS_M,
            batched_scales=np.full((2, 3), NO_SIZE, np.float32),
            batched_colors=LOST,
            opacity=UNSEEN_OPACITY,
            lod="off",
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _lay(self, tiles: NDArray[np.float64]) -> None:
        """Show the floor that is not seen to be free, as one batch of tiles."""
        height = self._room["floor_m"] + ABOVE_M
        ones = np.ones((len(tiles), 1))
        positions = np.concatenate((tiles[:, :2], height * ones), axis=1).astype(np.float32)
        scales = np.concatenate((tiles[:, 2:], ones), axis=1).astype(np.float32)
        count = len(ENDS_M) + len(tiles)
        self._floor.batched_wxyzs = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1))
        self._floor.batched_positions = np.concatenate((ENDS_M, positions))
        self._floor.batched_scales = np.concatenate((np.full_like(ENDS_M, NO_SIZE), scales))


def _colour(state: Sequence[Any] | None) -> Rgb:
    """Return the colour of a named zone; grey without a state, as in a tick that failed."""
    if state is None:
        return GREY
    occupied, entry_s = state
    return COLOURS["STOP" if occupied else "WARN" if entry_s is not None else "CLEAR"]


def sides_of(regions: list[dict[str, Any]]) -> tuple[Shapes, NDArray[np.uint32]]:
    """Vertices and triangles of the upright sides of prisms."""
    vertices: list[NDArray[np.float64]] = []
    faces: list[NDArray[np.intp]] = []
    start = 0
    for region in regions:
        floor, roof = _floor_and_roof(region)
        count = len(floor)
        a = np.arange(count)
        b = (a + 1) % count
        vertices += [floor, roof]
        corners = [np.stack((a, b, b + count), 1), np.stack((a, b + count, a + count), 1)]
        faces += [start + each for each in corners]
        start += 2 * count
    return np.concatenate(vertices).astype(np.float32), np.concatenate(faces).astype(np.uint32)


def _floor_and_roof(region: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    floor = np.array([[*corner, region["z_min"]] for corner in region["polygon"]])
    return floor, floor + np.array([0.0, 0.0, region["z_max"] - region["z_min"]])


_NO_ROOM: dict[str, Any] = {"walls": None, "view": None, "sees_free_space": False}


class UnseenFloor:
    """Unseen floor of a room from ``room.room_of``; none if its sensor does not see free space.

    The rule is that which keeps people *lost* there. The viewer computes it, not the node.
    """

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
