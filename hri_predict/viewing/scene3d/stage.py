"""Draws pictures into viser's scene: a few batched nodes, whatever the number of people."""

import math
from collections.abc import Sequence
from itertools import cycle, islice
from typing import Any

import numpy as np
from viser import BatchedMeshHandle, LabelHandle, LineSegmentsHandle, ViserServer

from hri_predict.viewing.levels import FORECAST, GREY, GRID, LOST, PERSON, Rgb, colour, worst
from hri_predict.viewing.picture import Picture, Shapes
from hri_predict.viewing.scene3d.solids import (
    ENDS_M,
    NO_SIZE,
    cylinder,
    cylinders_of,
    linear,
    sphere,
    spheres_of,
)
from hri_predict.viewing.scene3d.surroundings import Surroundings

SKY, SUN = 1.6, 1.8
"""Brightness of the lights."""
GHOSTS = 3
"""Number of bodies of each forecast that are drawn; more would hide each other."""
OPENING = math.radians(58)
"""The camera's vertical field of view; from the initial position, about 5 m of the room."""
THINNER = 0.9
"""Ratio of a forecast's radii to the body's: below 1, so that it hides inside a still body."""
LINKS = (1.0, 0.72)
"""Brightness of a robot's capsules in turn, so that its links differ."""
LOOK_FROM_M = np.array([2.3, -3.4, 1.9])
"""Initial camera position, relative to the point that it looks at."""
LOOK_AT_M, ASIDE_M = 0.6, 0.9
"""Height of that point, and its maximum distance from the robots, towards the room's middle."""
ZONE_OPACITY, FORECAST_OPACITY, FADED = 0.2, 0.6, 0.4
_ENDS = np.concatenate((ENDS_M, ENDS_M, np.full((2, 1), NO_SIZE, np.float32)), axis=1)
"""The two points as capsules, the first two of each batch."""
_UNTURNED = np.array([1, 0, 0, 0], np.float32)


class _Solids:
    """All capsules of one kind: one batch of spheres, and one of cylinders.

    Transparent capsules show only their outermost surface: each batch exists twice, and the first,
    invisible one hides from the second everything behind the surface. Browsers draw batches with
    the same middle in the order of creation (``ENDS_M``).

    Args:
        server: server that shows them.
        name: name of the kind.
        opacity: opacity; ``None``: solid.
    """

    def __init__(self, server: ViserServer, name: str, opacity: float | None = None) -> None:
        shapes = (("ends", sphere), ("middles", cylinder))
        passes: list[tuple[str, float | None]] = [("shown", opacity)]
        if opacity is not None:
            passes = [("surface", 0.0), *passes]
        self._parts: list[tuple[BatchedMeshHandle, ...]] = []
        for which, opaque in passes:
            handles = []
            for part, shape in shapes:
                vertices, faces = shape()
                handle = server.scene.add_batched_meshes_simple(
                    f"/{name}/{which}/{part}",
                    vertices,
                    faces,
                    batched_wxyzs=np.tile(_UNTURNED, (2, 1)),
                    batched_positions=_ENDS[:, :3],
                    batched_scales=np.full((2, 3), NO_SIZE, np.float32),
                    batched_colors=np.zeros((2, 3), np.uint8),
                    opacity=opaque,
                    lod="off",
                    cast_shadow=False,
                    receive_shadow=False,
                    side="front",
                )
                handles.append(handle)
            self._parts.append(tuple(handles))

    def draw(self, capsules: Shapes, colours: Any) -> None:
        """Show these (N, 7) capsules, with (N, 3) colours."""
        sound = np.isfinite(capsules).all(axis=1)
        capsules = np.concatenate((_ENDS, capsules[sound]))
        colours = np.concatenate((np.zeros((2, 3), np.uint8), linear(colours)[sound]))
        balls, unturned = spheres_of(capsules), np.tile(_UNTURNED, (2 * len(capsules), 1))
        between = cylinders_of(capsules)
        between[2][: len(_ENDS)] = NO_SIZE
        for ends, middles in self._parts:
            ends.batched_positions, ends.batched_scales = balls
            ends.batched_wxyzs = unturned
            middles.batched_positions, middles.batched_wxyzs, middles.batched_scales = between
            ends.batched_colors, middles.batched_colors = np.tile(colours, (2, 1)), colours


class Stage:
    """The 3D scene of one server."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._surroundings = Surroundings(server)
        self._solid = _Solids(server, "bodies")
        self._ghosts = _Solids(server, "forecast", FORECAST_OPACITY)
        self._zones = _Solids(server, "zones", ZONE_OPACITY)
        self._tags = Tags(server)
        self._looked = False
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(enabled=False)
        server.scene.configure_environment_map(hdri=None)  # it would bleach the levels' colours
        server.scene.add_light_hemisphere("/sky", ground_color=(90, 90, 100), intensity=SKY)
        server.scene.add_light_directional("/sun", intensity=SUN, position=(2.0, -3.0, 5.0))
        server.scene.add_grid(
            "/floor",
            cell_size=0.5,
            cell_color=(48, 52, 58),
            section_color=GRID,
            section_size=1.0,
            infinite_grid=True,
            fade_distance=18.0,
        )
        self._look_at(np.array([0.0, 0.0, LOOK_AT_M]))

    def draw(self, picture: Picture, ahead_s: float, *, known: bool = True) -> None:
        """Show a picture with the zones ``ahead_s`` from its tick; grey if it is not ``known``."""
        if len(picture.robots) and not self._looked:
            self._looked = True
            self._look_at(np.array([*_middle(picture), LOOK_AT_M]))
        times = np.asarray(picture.facts["times_s"])
        step = int(np.abs(times - ahead_s).argmin()) if len(times) else 0
        with self._server.atomic():
            self._surroundings.draw(picture.facts, known)
            self._solid.draw(*_solids(picture, known))
            self._ghosts.draw(*_forecast(picture, step, known))
            self._zones.draw(*_zones(picture, step, known))
            self._tags.draw(picture, known)
        self._server.flush()

    def _look_at(self, place: Any) -> None:
        """Point the camera of current and future browsers at a place (3,)."""
        at = tuple(float(x) for x in place)
        seen_from = tuple(float(x) for x in place + LOOK_FROM_M)
        cameras: list[Any] = [client.camera for client in self._server.get_clients().values()]
        for camera in (self._server.initial_camera, *cameras):
            # the place last: viser moves it along with the position
            camera.position, camera.look_at, camera.fov = seen_from, at, OPENING


def _middle(picture: Picture) -> Any:
    """Return (2,) on the floor, between the robots and the middle of the field of view."""
    robots, view = picture.robots[:, :2].mean(axis=0), picture.facts["room"]["view"]
    if view is None:
        return robots
    way = np.mean(view["polygon"], axis=0) - robots
    return robots + way * min(0.5, ASIDE_M / max(float(np.hypot(*way)), 1e-9))


def _solids(picture: Picture, known: bool) -> tuple[Shapes, Any]:
    """People as captured, and robots in the colour of their level."""
    bodies = picture.bodies
    segments = bodies.shape[1]
    tracked = picture.facts["tracked"]
    kinds = [PERSON if row < tracked else LOST for row in range(len(bodies))]
    colours: list[Any] = [rgb if known else GREY for rgb in kinds for _ in range(segments)]
    for robot in picture.facts["robots"]:
        rgb = colour(robot["level"]) if known else GREY
        shades = islice(cycle(LINKS), robot["capsules"])
        colours += [tuple(round(shade * part) for part in rgb) for shade in shades]
    capsules = np.concatenate((bodies.reshape(-1, 7), picture.robots))
    return capsules, np.array(colours, np.uint8).reshape(-1, 3)


def _forecast(picture: Picture, step: int, known: bool) -> tuple[Shapes, Any]:
    """The bodies of the forecast up to a step, fading."""
    forecast, until = picture.forecast, max(1, step)
    shown = np.unique(np.linspace(1, until, min(GHOSTS, until)).round().astype(int))
    ghosts = forecast[:, shown.tolist() if forecast.shape[1] > 1 else []]
    people, count, segments = ghosts.shape[:3]
    fading = 1.0 - FADED * np.arange(count) / max(count, 1)
    each = np.tile(np.repeat(fading, segments), people)[:, None]
    ghosts[..., 6] *= THINNER
    return ghosts.reshape(-1, 7), (each * (FORECAST if known else GREY)).astype(np.uint8)


def _zones(picture: Picture, step: int, known: bool) -> tuple[Shapes, Any]:
    """The zones at a step, in the colour of the worst level."""
    zones = picture.zones
    lost = set(picture.facts["people"][picture.facts["tracked"] :])
    rgb = colour(worst(robot["level"] for robot in picture.facts["robots"]))
    rows = zones[:, min(step, max(zones.shape[1] - 1, 0))] if len(zones) else zones[:, 0]
    each = rows.shape[1]
    kinds = [LOST if id_ in lost else rgb for id_ in picture.facts["zones"] for _ in range(each)]
    capsules = rows.reshape(-1, 7)
    if not known:
        kinds = [GREY] * len(kinds)
    return capsules, np.array(kinds, np.uint8).reshape(-1, 3)


ABOVE_M = 0.18
"""Height of labels above the labelled object."""
RING_M = 0.32
"""Radius of the ring on the floor around a robot's base."""
_TURNS = np.linspace(0.0, 2 * np.pi, 49)
_RING = RING_M * np.stack((np.cos(_TURNS), np.sin(_TURNS), np.zeros(49)), axis=-1)
_NOWHERE = np.array([[[0, 0, -50], [0, 0, -50]]], np.float32)
_BLACK: Rgb = (0, 0, 0)
Words = dict[str, tuple[str, Sequence[float]]]
"""Labels and their positions, by labelled object."""


class Tags:
    """Labels and lines of one server's scene."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._labels: dict[str, LabelHandle] = {}
        self._lines = self._batch("separation", 3.0)
        self._rings = self._batch("rings", 4.0)

    def draw(self, picture: Picture, known: bool) -> None:
        """Show the labels and lines of a picture; grey if it is not ``known`` to be current."""
        words = {**_of_people(picture), **_of_robots(picture), **_of_pairs(picture)}
        for name, label in self._labels.items():
            label.visible = name in words
        for name, (text, at) in words.items():
            self._word(name, text, at)
        robots = picture.facts["robots"]
        paired = [robot for robot in robots if robot["line"] is not None]
        ends = np.array([robot["line"] for robot in paired], np.float32).reshape(-1, 2, 3)
        _set(self._lines, ends, [_rgb(robot, known) for robot in paired])
        based = [(robot, rows) for robot, rows in _parts(picture) if len(rows)]
        rings = [_RING + np.array([*rows[0, :2], 0.01]) for _, rows in based]
        edges = [np.stack((ring[:-1], ring[1:]), axis=1) for ring in rings]
        each = len(_TURNS) - 1
        colours = [_rgb(robot, known) for robot, _ in based for _ in range(each)]
        _set(self._rings, np.array(edges, np.float32).reshape(-1, 2, 3), colours)

    def _word(self, name: str, text: str, at: Sequence[float]) -> None:
        if name not in self._labels:
            path = f"/tags/{len(self._labels)}"
            self._labels[name] = self._server.scene.add_label(path, text, anchor="bottom-center")
        label = self._labels[name]
        label.text, label.position = text, (float(at[0]), float(at[1]), float(at[2]))

    def _batch(self, name: str, pixels: float) -> LineSegmentsHandle:
        return self._server.scene.add_line_segments(
            f"/{name}", _NOWHERE, GREY, thickness=pixels, thickness_units="screen"
        )


def _set(lines: LineSegmentsHandle, points: Shapes, colours: list[Rgb]) -> None:
    """Show these (N, 2, 3) lines, one colour each; nothing if there are none."""
    if not len(points):
        points, colours = _NOWHERE, [_BLACK]
    rgb = linear(colours)[:, None]
    lines.points, lines.colors = points, np.repeat(rgb, 2, axis=1)


def _of_people(picture: Picture) -> Words:
    """Each person's number above the head."""
    words: Words = {}
    for row, id_ in enumerate(picture.facts["people"]):
        ends = picture.bodies[row][:, :6].reshape(-1, 3)
        ends = ends[np.isfinite(ends).all(axis=1)]
        if len(ends):
            lost = " (lost)" if row >= picture.facts["tracked"] else ""
            top = ends[ends[:, 2].argmax()]
            words[f"person {id_}"] = (f"person {id_}{lost}", (*top[:2], top[2] + ABOVE_M))
    return words


def _of_robots(picture: Picture) -> Words:
    """Each robot's name and level above it."""
    words: Words = {}
    for robot, rows in _parts(picture):
        if len(rows):
            ends = rows[:, :6].reshape(-1, 3)
            top = [*ends[0, :2], ends[:, 2].max() + ABOVE_M]
            words[f"robot {robot['name']}"] = (f"{robot['name']}: {robot['level']}", top)
    return words


def _of_pairs(picture: Picture) -> Words:
    """Return the distances of the deciding pairs, in the middle of their lines."""
    return {
        f"separation {robot['name']}": (
            robot["apart"].partition(",")[0],  # the panel has all of it
            np.mean(robot["line"], axis=0),
        )
        for robot in picture.facts["robots"]
        if robot["line"] is not None
    }


def _parts(picture: Picture) -> list[tuple[dict[str, Any], Shapes]]:
    """Each robot with its (C, 7) capsules."""
    parts, start = [], 0
    for robot in picture.facts["robots"]:
        parts.append((robot, picture.robots[start : start + robot["capsules"]]))
        start += robot["capsules"]
    return parts


def _rgb(robot: dict[str, Any], known: bool) -> Rgb:
    return colour(robot["level"]) if known else GREY
