"""An explanation as a picture: a plan of the room, and below it the surrounding seconds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.figures import Axes, Figure, write_figure
from hri_predict.base.looks import LEVEL_COLOURS, PALETTE
from hri_predict.explaining.deciding import distance_of, needed_by, part_of, person_of
from hri_predict.explaining.episodes import level_of
from hri_predict.explaining.situation import Situation
from hri_predict.explaining.times import NS
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.explaining.window import newest
from hri_predict.recording import Told
from hri_predict.recording.mcap.well_known import DAMAGED, capsules_of

# -- content of a plan view of a moment: bodies, zones and the robot as capsules seen from above

AHEAD_S = 0.4
"""Horizon of the drawn zones."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FloorPlan:
    """Capsules are (N, 7): ax ay az bx by bz r, metres.

    Attributes:
        bodies, zones: by person, as captured, and ``ahead_s`` later.
        robots: by name.
        lost: untracked people.
        line: the two ends of the separation; ``None`` if unknown.
    """

    bodies: dict[int, Floats]
    zones: dict[int, Floats]
    ahead_s: float
    robots: dict[str, Floats]
    lost: frozenset[int]
    line: tuple[Floats, Floats] | None


def plan(about: Situation) -> FloorPlan:
    """Return the newest picture before a moment; unrecorded parts are left out."""
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
    """Return each robot's capsules, from the cylinders and balls of the 3D view."""
    found = {}
    for entity in map(mapped, listed(None if view is None else view.data.get("entities"))):
        name = text(entity.get("id"))
        if not name.startswith("robot "):
            continue
        try:
            capsules = capsules_of(dict(entity))
        except DAMAGED:
            capsules = np.zeros((0, 7))
        found[name.removeprefix("robot ")] = capsules[np.isfinite(capsules).all(axis=1)]
    return found


def _line(
    about: Situation, zones: Told | None, bodies: dict[int, Floats], robot: Floats | None
) -> tuple[Floats, Floats] | None:
    """The shortest line from the deciding body part to the robot."""
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


# --------------------------------------------------------------------------------------------------

PERSON, LOST, ROBOT = PALETTE[0], "#777777", "#444444"
BEFORE_S, AFTER_S = 8.0, 6.0
_ROUND = np.linspace(-np.pi / 2, np.pi / 2, 13)


def draw(about: Situation, found: Mapping[str, Any], path: Path) -> None:
    """Draw an explanation into a .png or .svg.

    Raises:
        ConfigError: it cannot be written.
    """
    figure = Figure(figsize=(9.0, 9.4), layout="constrained")
    figure.suptitle(_broken(found["answer"]), fontsize=11, x=0.01, ha="left", parse_math=False)
    above, middle, below, levels = figure.subplots(
        4, 1, gridspec_kw={"height_ratios": [5.2, 1.8, 1.4, 0.35]}
    )
    _plan(above, about)
    times = _timeline(middle, below, about)
    _levels(levels, about, times)
    write_figure(figure, path, dpi=110, option="--picture")


def _broken(answer: str) -> str:
    lines = [""]
    for word in answer.split():
        if len(lines[-1]) + len(word) > 105:
            lines.append("")
        lines[-1] += f"{word} "
    return "\n".join(lines[:4])


def outline(capsule: Floats) -> Floats:
    """Return the outline (N, 2) of a capsule (7,) seen from above."""
    a, b, radius = capsule[:2], capsule[3:5], capsule[6]
    heading = np.arctan2(*(b - a)[::-1])
    ahead = b + radius * np.column_stack([np.cos(heading + _ROUND), np.sin(heading + _ROUND)])
    behind = a - radius * np.column_stack([np.cos(heading + _ROUND), np.sin(heading + _ROUND)])
    edge: Floats = np.concatenate([ahead, behind])
    return edge


def _plan(axes: Axes, about: Situation) -> None:
    seen = plan(about)
    level = level_of(about.advice.data)
    for each in seen.zones.values():
        _fill(axes, each, colour=LEVEL_COLOURS[level], alpha=0.10, layer=1)
    for id_, body in seen.bodies.items():
        colour = LOST if id_ in seen.lost else PERSON
        _fill(axes, body, colour=colour, alpha=0.35, layer=2)
        if len(body):
            word = " (lost)" if id_ in seen.lost else ""
            x, y = body[:, :2].mean(axis=0).tolist()
            axes.annotate(
                f"person {id_}{word}", (x, y), (0, -34), textcoords="offset points", ha="center"
            )
    for name, robot in seen.robots.items():
        _fill(axes, robot, colour=ROBOT, alpha=0.55, layer=3)
        if len(robot):
            axes.annotate(
                name, tuple(robot[0, :2]), (-6, 12), textcoords="offset points", ha="right"
            )
    for name, pose in about.info.frames:
        axes.plot(*pose.xyz[:2], "k+", markersize=9, zorder=5)
        if name not in seen.robots:
            axes.annotate(name, (pose.xyz[0], pose.xyz[1]), (6, 6), textcoords="offset points")
    if seen.line is not None:
        start, end = seen.line
        axes.plot(*np.array([start[:2], end[:2]]).T, "o-", color="black", lw=2, ms=4, zorder=6)
        x, y = ((start + end)[:2] / 2).tolist()
        axes.annotate(
            _distance(about), (x, y), (8, 10), textcoords="offset points", fontweight="bold",
            bbox={"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.8}, zorder=7,
        )  # fmt: skip
    if not (seen.bodies or seen.robots):
        axes.annotate("no zones and no picture were recorded at that time", (0.5, 0.5), ha="center",
                      xycoords="axes fraction")  # fmt: skip
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.grid(alpha=0.25)
    shade = f"shaded: where bodies may be within {seen.ahead_s:.1f} s" if seen.zones else ""
    axes.set_title(f"seen from above; {shade}", fontsize=9, loc="left")


def _fill(axes: Axes, capsules: Floats, *, colour: str, alpha: float, layer: int) -> None:
    for capsule in capsules:
        edge = outline(capsule)
        axes.fill(*edge.T, color=colour, alpha=alpha, lw=0, zorder=layer)


def _distance(about: Situation) -> str:
    separation = distance_of(about.advice)
    return "" if separation is None else f"{separation:.2f} m"


def _timeline(middle: Axes, below: Axes, about: Situation) -> Floats:
    """Draw the deciding pair's distance and the required one, and the speed and its limit."""
    now_ns = about.advice.utc_ns
    around = [
        told
        for told in about.window.advice[about.robot]
        if -BEFORE_S <= (told.utc_ns - now_ns) / NS <= AFTER_S
    ]
    times = np.array([(told.utc_ns - now_ns) / NS for told in around])

    def of(key: str) -> Floats:
        return _series(around, lambda told: number(told.data.get(key)))

    middle.plot(times, _series(around, distance_of), color=PERSON, label="deciding pair")
    middle.plot(times, _series(around, needed_by), color=LEVEL_COLOURS["STOP"], label="needed")
    middle.set_ylabel("m")
    below.plot(times, of("speed_limit_m_s"), color="black", lw=1, label="speed limit")
    below.plot(times, of("speed_m_s"), color=PALETTE[5], label="robot's speed")
    below.set_ylabel("m/s")
    for axes in (middle, below):
        axes.axvline(0.0, color="black", lw=0.8, ls=":")
        axes.set_xlim(-BEFORE_S, AFTER_S)
        axes.set_ylim(bottom=0)
        axes.grid(alpha=0.25)
        axes.tick_params(labelbottom=False)
        axes.legend(loc="upper right", fontsize=8, framealpha=0.7)
    return times


def _series(around: list[Told], value: Callable[[Told], float | None]) -> Floats:
    found = [value(told) for told in around]
    return np.array([np.nan if v is None else v for v in found], dtype=np.float64)


def _levels(axes: Axes, about: Situation, times: Floats) -> None:
    around = [
        told
        for told in about.window.advice[about.robot]
        if -BEFORE_S <= (told.utc_ns - about.advice.utc_ns) / NS <= AFTER_S
    ]
    names = [level_of(told.data) for told in around]
    for level, colour in LEVEL_COLOURS.items():
        there = [k for k, name in enumerate(names) if name == level]
        spans = [
            (times[k], (times[k + 1] if k + 1 < len(times) else times[k] + 0.04) - times[k])
            for k in there
        ]
        if spans:
            axes.broken_barh(spans, (0, 1), color=colour, label=level, lw=0)
    axes.axvline(0.0, color="black", lw=0.8, ls=":")
    axes.set_xlim(-BEFORE_S, AFTER_S)
    axes.set_yticks([])
    axes.set_ylabel("level", rotation=0, ha="right", va="center")
    axes.set_xlabel(f"seconds from {about.clock(about.advice.utc_ns)}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -1.6), ncols=6, fontsize=8, frameon=False)
