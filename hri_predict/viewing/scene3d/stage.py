"""Draws pictures into viser's scene: a few batched nodes, whatever the number of people."""

from typing import Any

import numpy as np
from viser import BatchedMeshHandle, ViserServer

from hri_predict.viewing.levels import FORECAST, GREY, GRID, LOST, PERSON, colour, worst
from hri_predict.viewing.picture import Picture, Shapes
from hri_predict.viewing.scene3d.solids import cylinder, cylinders_of, linear, sphere, spheres_of
from hri_predict.viewing.scene3d.surroundings import Surroundings
from hri_predict.viewing.scene3d.tags import Tags

SKY, SUN = 1.6, 1.8
"""Brightness of the lights."""
GHOSTS = 3
"""Number of bodies of each forecast that are drawn; more of them hide each other."""
LOOK_FROM_M = np.array([2.5, -3.3, 2.2])
"""From the place that is looked at, at the start."""
LOOK_AT_M, ASIDE_M = 0.6, 0.9
"""That place's height, and how far it may lie from the robots, towards the room's middle."""
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
        capsules, colours = capsules[sound], linear(colours)[sound]
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
        self._surroundings = Surroundings(server)
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
            self._clear.draw(*_see_through(picture, step, known))
            self._tags.draw(picture, known)
        self._server.flush()

    def _look_at(self, place: Any) -> None:
        """Let browsers look at a place (3,), those that are here and those that come."""
        at = tuple(float(x) for x in place)
        seen_from = tuple(float(x) for x in place + LOOK_FROM_M)
        cameras: list[Any] = [client.camera for client in self._server.get_clients().values()]
        for camera in (self._server.initial_camera, *cameras):
            camera.look_at, camera.position = at, seen_from


def _middle(picture: Picture) -> Any:
    """(2,) on the floor, between the robots and the middle of what the sensor sees."""
    robots, view = picture.robots[:, :2].mean(axis=0), picture.facts["room"]["view"]
    if view is None:
        return robots
    way = np.mean(view["polygon"], axis=0) - robots
    return robots + way * min(0.5, ASIDE_M / max(float(np.hypot(*way)), 1e-9))


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
    shown = np.unique(np.linspace(1, until, min(GHOSTS, until)).round().astype(int))
    steps = shown.tolist() if forecast.shape[1] > 1 else []
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
