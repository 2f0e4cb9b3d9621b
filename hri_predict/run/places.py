"""Checks that the robots, source and doors of a configuration can belong to one cell.

Each number may be plausible by itself although positions are in centimetres, in inches, or in
another room's frame. A robot placed where no person is ever observed would always be advised
*clear*.
"""

import math
from collections.abc import Sequence

import numpy as np

from hri_predict.base.errors import ConfigError
from hri_predict.base.quantities.units import meant
from hri_predict.base.settings import Region
from hri_predict.operation.monitoring.remote import REMEDY
from hri_predict.risk.areas import floor_distance
from hri_predict.robots.model import RobotModel
from hri_predict.run.config import Config

MAX_FROM_VIEW_M = 3.0
"""Maximum distance between a robot's reach and the source's view or the walls: a person approaching
from there is observed in time, or no person can approach.
"""
MAX_FROM_SOURCE_M = 15.0
"""The same from the source itself if no view is configured: the range at which cameras and lidars
detect a body (depth cameras: 6 m).
"""
NEAR_M = 5.0
"""Distance below which a robot is not reported."""
MILLIMETRES = 100.0
"""Minimum coordinate for which a number in metres is proposed: a thousandth of it is 10 cm."""
MAX_REGION_M = 40.0
"""Maximum distance of a zone, door or shadow from the nearest robot or source; nothing is observed
beyond.
"""
MAX_EXIT_M2 = 60.0
"""Maximum area of an exit: a gate for two lorries with 6 m of floor in front."""


def check_places(config: Config, robots: Sequence[RobotModel]) -> None:
    """Refuse positions that cannot be intended.

    Raises:
        ConfigError: one line with key, distance and remedy.
    """
    for i, model in enumerate(robots):
        if model.base is None:
            continue  # it drives
        beyond_m, what = _distance(config, model)
        seen = _view(config) is not None
        if beyond_m > (MAX_FROM_VIEW_M if seen else MAX_FROM_SOURCE_M):
            key, far = _farthest(config, i, model.base.tolist())
            hint = meant(far, "m") if abs(far) >= MILLIMETRES else "metres are meant"
            more = "" if seen else ", or define its view with source.field_of_view"
            raise ConfigError(
                f"{config.place(*key)}: what robot {model.name} reaches ends {beyond_m:.3g} m from "
                f"{what}, so no person would be seen near it; correct one of the two ({hint}){more}"
            )
    _check_regions(config, robots)
    for i, door in enumerate(config.node.people.exits):
        area = _area(door.polygon)
        if area > MAX_EXIT_M2:
            raise ConfigError(
                f"{config.place('people', 'exits', i)}: {area:.0f} m2 is too large for an exit: a "
                f"person lost anywhere in it is treated as gone; give only the floor in front of "
                f"the door, at most {MAX_EXIT_M2:g} m2, in metres"
            )


def _farthest(config: Config, robot: int, base: list[float]) -> tuple[tuple[str | int, ...], float]:
    """Return the key that is farther from the room's origin, the robot's base or what is seen,
    because it is more likely the mistake; and its largest coordinate.
    """
    source, room = config.source, config.node.people.room
    seen: tuple[str | int, ...]
    if source.field_of_view is not None:
        seen = ("source", "field_of_view")
        at = [v for corner in source.field_of_view.polygon for v in corner]
    elif room is not None:
        seen, at = ("people", "room"), [v for corner in room.polygon for v in corner]
    else:
        at = min(source.known_places, key=lambda place: math.dist(place[:2], base[:2]))
        stated = list(at) == list(source.room_from_source.xyz)
        seen = ("source", "room_from_source") if stated else ("source",)
    both = {("robots", robot, "room_from_robot"): base, seen: at}
    key = max(both, key=lambda each: max(map(abs, both[each])))
    return key, max(both[key], key=abs)


def _check_regions(config: Config, robots: Sequence[RobotModel]) -> None:
    """Refuse zones, doors and shadows that are far from everything else."""
    node, source = config.node, config.source
    regions: list[tuple[tuple[str | int, ...], Region]] = [
        *((("zones", i), zone) for i, zone in enumerate(node.zones)),
        *((("people", "exits", i), door) for i, door in enumerate(node.people.exits)),
        *((("people", "entrances", i), door) for i, door in enumerate(node.people.entrances or ())),
        *((("source", "shadows", i), shadow) for i, shadow in enumerate(source.shadows)),
    ]
    places = [
        *map(np.asarray, source.known_places),
        *(m.base for m in robots if m.base is not None),
    ]
    view = _view(config)
    if view is not None:
        places += [np.array([x, y, 0.0]) for x, y in view.polygon]
    for key, region in regions:
        away_m = min(floor_distance(region, place) for place in places)
        if away_m > MAX_REGION_M:
            far = max((v for corner in region.polygon for v in corner), key=abs)
            raise ConfigError(
                f"{config.place(*key)}: {away_m:.3g} m from every robot and the source, where "
                f"nothing is observed; {meant(far, 'm')}"
            )


def place_notes(config: Config, robots: Sequence[RobotModel]) -> list[str]:
    """Return one line for each robot far from the source's view."""
    notes = []
    for model in robots:
        beyond_m, what = (0.0, "") if model.base is None else _distance(config, model)
        if beyond_m > (0.0 if _view(config) is not None else NEAR_M):
            notes.append(
                f"robot {model.name}: its reach ends {beyond_m:.2f} m from {what}; {REMEDY}"
            )
    return notes


def _view(config: Config) -> Region | None:
    return config.source.field_of_view or config.node.people.room


def _distance(config: Config, model: RobotModel) -> tuple[float, str]:
    """Return the horizontal distance in metres from a robot's reach to the observed area, and the
    area's name.
    """
    assert model.base is not None
    source, room = config.source, config.node.people.room
    if source.field_of_view is not None:
        away, what = floor_distance(source.field_of_view, model.base), "source.field_of_view"
    elif room is not None:
        away, what = floor_distance(room, model.base), "people.room"
    else:
        places = np.array(source.known_places, dtype=np.float64)[:, :2]
        away = float(np.linalg.norm(places - model.base[:2], axis=1).min())
        what = "the source (source.room_from_source)"
    return max(0.0, away - model.reach_m), what


def _area(polygon: Sequence[Sequence[float]]) -> float:
    corners = [(x, y) for x, y in polygon]
    after = [*corners[1:], corners[0]]
    return abs(math.fsum(x * w - z * y for (x, y), (z, w) in zip(corners, after, strict=True))) / 2
