"""Draws pictures into viser's scene: a few batched nodes, whatever the number of people."""

import contextlib
from typing import Any

import numpy as np
from viser import BatchedMeshHandle, LabelHandle, LineSegmentsHandle, SceneNodeHandle, ViserServer

from hri_predict.viewing.levels import COLOURS, GREY, Rgb, colour, worst
from hri_predict.viewing.picture import Picture, Shapes
from hri_predict.viewing.scene3d.solids import cylinder, cylinders_of, sphere, spheres_of

PERSON: Rgb = (20, 85, 200)
LOST: Rgb = (150, 60, 200)
FORECAST: Rgb = (90, 190, 255)
VIEW: Rgb = (70, 130, 150)
ZONE_OPACITY, LOST_OPACITY, FORECAST_OPACITY = 0.045, 0.07, 0.4
_NOWHERE = np.array([[0, 0, -50, 0, 0, -50, 1e-3]], np.float32)
"""Drawn where nothing is to be drawn: a batch is never empty."""
_NONE = np.zeros(1, np.float32)
_UNTURNED = np.array([1, 0, 0, 0], np.float32)


class _Solids:
    """All capsules of one kind: one batch of spheres, and one of cylinders."""

    def __init__(self, server: ViserServer, name: str, *, opacity: float | None) -> None:
        self._parts: list[BatchedMeshHandle] = []
        for part, shape in (("ends", sphere), ("middles", cylinder)):
            vertices, faces = shape()
            handle = server.scene.add_batched_meshes_simple(
                f"/{name}/{part}",
                vertices,
                faces,
                batched_wxyzs=np.array([[1.0, 0.0, 0.0, 0.0]]),
                batched_positions=_NOWHERE[:, :3],
                batched_scales=np.full((1, 3), 1e-3),
                batched_colors=np.array([[0, 0, 0]], np.uint8),
                batched_opacities=None if opacity is None else np.array([opacity], np.float32),
                opacity=None if opacity is None else 1.0,
                lod="off",
                cast_shadow=False,
                receive_shadow=False,
                side="front",
            )
            self._parts.append(handle)
        self._see_through = opacity is not None

    def draw(self, capsules: Shapes, colours: Any, opacities: Shapes) -> None:
        """Show these (N, 7) capsules, with (N, 3) colours and (N,) opacities."""
        sound = np.isfinite(capsules).all(axis=1)
        capsules, colours = capsules[sound], np.asarray(colours, np.uint8)[sound]
        opacities = np.asarray(opacities, np.float32)[sound]
        if not len(capsules):
            capsules, colours, opacities = _NOWHERE, np.zeros((1, 3), np.uint8), _NONE
        ends, middles = self._parts
        ends.batched_positions, ends.batched_scales = spheres_of(capsules)
        ends.batched_wxyzs = np.tile(_UNTURNED, (2 * len(capsules), 1))
        ends.batched_colors = np.concatenate((colours, colours))
        middles.batched_positions, middles.batched_wxyzs, middles.batched_scales = cylinders_of(
            capsules
        )
        middles.batched_colors = colours
        if self._see_through:
            ends.batched_opacities = np.concatenate((opacities, opacities)).astype(np.float32)
            middles.batched_opacities = opacities.astype(np.float32)


class Stage:
    """The 3D scene of one server."""

    def __init__(self, server: ViserServer) -> None:
        self._server = server
        self._solid = _Solids(server, "bodies", opacity=None)
        self._clear = _Solids(server, "zones", opacity=0.1)
        self._room: Any = None
        self._regions: list[SceneNodeHandle] = []
        self._outlines: dict[str, LineSegmentsHandle] = {}
        self._lines: dict[int, tuple[LineSegmentsHandle, LabelHandle]] = {}
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        server.scene.add_grid(
            "/floor",
            cell_size=0.5,
            cell_color=(48, 52, 58),
            section_color=(72, 78, 86),
            infinite_grid=True,
            fade_distance=18.0,
        )
        server.initial_camera.position = (3.6, -3.0, 2.7)
        server.initial_camera.look_at = (0.9, 0.3, 0.75)

    def draw(self, picture: Picture, ahead_s: float, *, known: bool = True) -> None:
        """Show a picture with the zones ``ahead_s`` from its tick; grey if it is not ``known``."""
        times = np.asarray(picture.facts["times_s"])
        step = int(np.abs(times - ahead_s).argmin()) if len(times) else 0
        with self._server.atomic():
            self._draw_room(picture.facts, known)
            self._solid.draw(*_solids(picture, known))
            self._clear.draw(*_see_through(picture, step, known))
            self._draw_lines(picture.facts, known)
        self._server.flush()

    def _draw_room(self, facts: dict[str, Any], known: bool) -> None:
        if facts["room"] != self._room:
            self._room = facts["room"]
            for handle in self._regions:
                with contextlib.suppress(Exception):  # viser removed it with its parent
                    handle.remove()
            self._regions, self._outlines = [], {}
            if self._room["view"] is not None:
                self._region("field of view", self._room["view"], VIEW)
            for zone in self._room["named"]:
                self._region(zone["name"], zone, GREY)
        for zone in self._room["named"]:
            occupied, entry_s = facts["named"].get(zone["name"], [False, None])
            shown = COLOURS["STOP" if occupied else "WARN" if entry_s is not None else "CLEAR"]
            outline = self._outlines[zone["name"]]
            rgb = np.array(shown if known else GREY, np.uint8)
            outline.colors = np.broadcast_to(rgb, outline.points.shape).copy()

    def _region(self, name: str, region: dict[str, Any], rgb: Rgb) -> None:
        """A prism as its edges, with its name."""
        floor = np.array([[*corner, region["z_min"]] for corner in region["polygon"]])
        roof = floor + np.array([0.0, 0.0, region["z_max"] - region["z_min"]])
        edges = [(floor, np.roll(floor, -1, 0)), (roof, np.roll(roof, -1, 0)), (floor, roof)]
        points = np.concatenate([np.stack(edge, axis=1) for edge in edges]).astype(np.float32)
        path = f"/regions/{len(self._regions)}"
        line = self._server.scene.add_line_segments(path, points, rgb, thickness=0.015)
        label = self._server.scene.add_label(f"{path}/name", name, position=tuple(floor[0]))
        self._outlines[name] = line
        self._regions += [label, line]

    def _draw_lines(self, facts: dict[str, Any], known: bool) -> None:
        """Each robot's separation: a line from the deciding body part, with its length."""
        for index, robot in enumerate(facts["robots"]):
            ends = robot["line"]
            if index not in self._lines:
                if ends is None:
                    continue
                path, points = f"/separation/{index}", np.array([ends], np.float32)
                scene = self._server.scene
                self._lines[index] = (
                    scene.add_line_segments(path, points, GREY, thickness=0.025),
                    scene.add_label(f"/separation_label/{index}", "", anchor="bottom-center"),
                )
            line, label = self._lines[index]
            line.visible = label.visible = ends is not None
            if ends is not None:
                line.points = np.array([ends], np.float32)
                rgb = np.array(colour(robot["level"]) if known else GREY, np.uint8)
                line.colors = np.broadcast_to(rgb, (1, 2, 3)).copy()
                label.position = tuple(np.mean(ends, axis=0) + np.array([0, 0, 0.08]))
                label.text = robot["apart"]


def _solids(picture: Picture, known: bool) -> tuple[Shapes, Any, Shapes]:
    """People as captured, and robots in the colour of their level."""
    bodies = picture.bodies
    segments = bodies.shape[1]
    tracked = picture.facts["tracked"]
    kinds = [PERSON if row < tracked else LOST for row in range(len(bodies))]
    colours = [rgb if known else GREY for rgb in kinds for _ in range(segments)]
    for robot in picture.facts["robots"]:
        rgb = colour(robot["level"]) if known else GREY
        colours += [rgb] * robot["capsules"]
    capsules = np.concatenate((bodies.reshape(-1, 7), picture.robots))
    return capsules, np.array(colours, np.uint8).reshape(-1, 3), np.ones(len(capsules), np.float32)


def _see_through(picture: Picture, step: int, known: bool) -> tuple[Shapes, Any, Shapes]:
    """The forecast up to a step, fading, and the zones at it."""
    forecast, zones = picture.forecast, picture.zones
    until = max(1, step)
    steps = list(range(1, until + 1)) if forecast.shape[1] > 1 else []
    ghosts = forecast[:, steps]
    people, count, segments = ghosts.shape[:3]
    fading = FORECAST_OPACITY * (1.0 - 0.8 * np.arange(count) / max(count, 1))
    lost = set(picture.facts["people"][picture.facts["tracked"] :])
    rgb = colour(worst(robot["level"] for robot in picture.facts["robots"]))
    rows = zones[:, min(step, max(zones.shape[1] - 1, 0))] if len(zones) else zones[:, 0]
    kinds = [LOST if id_ in lost else rgb for id_ in picture.facts["zones"]]
    opaque = [LOST_OPACITY if id_ in lost else ZONE_OPACITY for id_ in picture.facts["zones"]]
    each = rows.shape[1]
    capsules = np.concatenate((ghosts.reshape(-1, 7), rows.reshape(-1, 7)))
    colours = [FORECAST] * (people * count * segments) + [k for k in kinds for _ in range(each)]
    opacities = [*np.tile(np.repeat(fading, segments), people), *np.repeat(opaque, each)]
    if not known:
        colours = [GREY] * len(colours)
    return capsules, np.array(colours, np.uint8).reshape(-1, 3), np.array(opacities, np.float32)
