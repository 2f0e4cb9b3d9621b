"""Content of a plan view of a moment: bodies, zones and the robot as capsules seen from above."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.explaining.reason_clause import part_of, person_of
from hri_predict.explaining.situation import Situation
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.explaining.window import newest
from hri_predict.recording import Told

AHEAD_S = 0.4
"""The zones drawn: so far ahead."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FloorPlan:
    """Capsules are (N, 7): ax ay az bx by bz r, metres.

    Attributes:
        bodies, zones: by person, as captured, and ``ahead_s`` later.
        robots: by name.
        lost: who is not tracked.
        line: the two ends of the separation; ``None``: not known.
    """

    bodies: dict[int, Floats]
    zones: dict[int, Floats]
    ahead_s: float
    robots: dict[str, Floats]
    lost: frozenset[int]
    line: tuple[Floats, Floats] | None


def plan(about: Situation) -> FloorPlan:
    """The newest picture before a moment; what was not recorded is left out."""
    zones = newest(about.window.zones, about.advice.utc_ns, 1.0)
    bodies: dict[int, Floats] = {}
    ahead: dict[int, Floats] = {}
    ahead_s = AHEAD_S
    if zones is not None:
        times = [number(t) for t in listed(zones.data.get("times_s"))]
        later = [k for k, t in enumerate(times) if t is not None and t >= AHEAD_S - 0.01]
        step = later[0] if later else max(0, len(times) - 1)
        ahead_s = (times[step] if times else None) or 0.0
        for k, id_ in enumerate(listed(zones.data.get("ids"))):
            bodies[id_] = _capsules(zones, k, 0)
            ahead[id_] = _capsules(zones, k, step)
    robots = _robots(newest(about.window.views, about.advice.utc_ns, 1.0))
    return FloorPlan(
        bodies=bodies,
        zones=ahead,
        ahead_s=ahead_s,
        robots=robots,
        lost=frozenset(p["id"] for p in about.people if p["state"] == "lost"),
        line=_line(about, zones, bodies, robots.get(about.robot)),
    )


def _capsules(zones: Told, person: int, step: int) -> Floats:
    try:
        found = np.array(zones.data["capsules"][person][step], dtype=np.float64)
    except (KeyError, IndexError, TypeError, ValueError, OverflowError):
        return np.zeros((0, 7))
    if found.ndim != 2 or found.shape[1] != 7:
        return np.zeros((0, 7))
    return found[np.isfinite(found).all(axis=1)]


def _robots(view: Told | None) -> dict[str, Floats]:
    """Of each robot its capsules, from the cylinders and balls that a 3D view shows."""
    found = {}
    for entity in map(mapped, listed(None if view is None else view.data.get("entities"))):
        name = text(entity.get("id"))
        if not name.startswith("robot "):
            continue
        parts = [_ball(mapped(each)) for each in listed(entity.get("spheres"))]
        parts += [_cylinder(mapped(each)) for each in listed(entity.get("cylinders"))]
        capsules = np.array([part for part in parts if part is not None]).reshape(-1, 7)
        found[name.removeprefix("robot ")] = capsules
    return found


def _xyz(value: Any, keys: str = "xyz") -> list[float] | None:
    numbers = [number(mapped(value).get(key)) for key in keys]
    known = [n for n in numbers if n is not None]
    return known if len(known) == len(keys) else None


def _ball(ball: Any) -> list[float] | None:
    at, size = _xyz(mapped(ball.get("pose")).get("position")), _xyz(ball.get("size"))
    return None if at is None or size is None else [*at, *at, size[0] / 2]


def _cylinder(cylinder: Any) -> list[float] | None:
    pose = mapped(cylinder.get("pose"))
    at, size = _xyz(pose.get("position")), _xyz(cylinder.get("size"))
    turn = _xyz(pose.get("orientation"), "xyzw")
    if at is None or size is None or turn is None:
        return None
    x, y, z, w = turn
    axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    half = axis * size[2] / 2
    return [*(np.array(at) - half).tolist(), *(np.array(at) + half).tolist(), size[0] / 2]


def _line(
    about: Situation, zones: Told | None, bodies: dict[int, Floats], robot: Floats | None
) -> tuple[Floats, Floats] | None:
    """The shortest way from the deciding body part to the robot."""
    person, part = person_of(about.advice), part_of(about.advice)
    grounds = mapped(about.advice.data.get("grounds"))
    part = part or text(grounds.get("segment"))
    names = listed(None if zones is None else zones.data.get("segments"))
    if person not in bodies or robot is None or not len(robot) or part not in names:
        return None
    if names.index(part) >= len(bodies[person]):
        return None
    body = bodies[person][names.index(part)]
    shares = np.linspace(0.0, 1.0, 25)[:, None]
    on_body = body[:3] + shares * (body[3:6] - body[:3])
    on_robot = robot[:, None, :3] + shares * (robot[:, None, 3:6] - robot[:, None, :3])
    away = np.linalg.norm(on_robot[:, :, None] - on_body[None, None], axis=-1)
    away -= robot[:, None, None, 6]
    capsule, k, j = np.unravel_index(int(away.argmin()), away.shape)
    start, end = on_body[j], on_robot[capsule, k]
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-9)
    return start + along * body[6], end - along * robot[capsule, 6]
