"""The text next to the 3D scene; ``panel.html`` has its elements."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

from hri_predict.base.pages import macros
from hri_predict.viewing.levels import (
    COLOURS,
    FORECAST,
    GREY,
    GRID,
    LOST,
    PERSON,
    VIEW,
    Rgb,
    colour,
    css,
)

_LEGEND = (
    (PERSON, "solid", "person as captured; parts that no sensor sees are inferred"),
    (FORECAST, "faint", "predicted position of the person, up to zones ahead"),
    (COLOURS["SLOW"], "faint", "zone: where the person may be at zones ahead; in the worst level"),
    (COLOURS["SLOW"], "line", "robot, and the line to the deciding body part: in its level"),
    (LOST, "faint", "lost person; shadow or floor where a person could stand unseen"),
    (VIEW, "line", "field of view"),
    (COLOURS["CLEAR"], "line", "named zone: green empty, yellow entry, red occupied, grey unknown"),
    (GRID, "line", "floor: a line every half metre, brighter every metre"),
)
_LIVE: Rgb = (60, 75, 90)
ROOM_FOR_BAR = "<style>.mantine-ScrollArea-viewport{padding-right:12px}</style>"
"""Style that moves viser's scroll bar next to the scrolled content, which it would cover."""
BEAT_S, STILL_S = 0.5, 4.0
"""Interval at which live values are resent; a view without updates is greyed out after STILL_S."""
STRIP_PARTS = 240
"""Maximum number of parts of a timeline; each shows the worst level within."""
_PANEL = macros("viewing/scene3d/panel.html")


def head(facts: dict[str, Any], *, stale: str = "", when: str = "", beat: int = 0) -> str:
    """Return the levels of a picture, in grey if it is not current or was recorded.

    The height is constant for the same robots, so that controls below it do not move. Current
    values must be resent with another ``beat``, otherwise the browser covers the whole view.

    Args:
        facts: those of the picture.
        stale: reason why it is not current.
        when: time at which it was recorded.
        beat: see above.
    """
    said = "LIVE", css(_LIVE), ""
    if when or stale:
        said = "RECORDED" if when else "NOT LIVE", css(GREY), when or stale
    badges = [
        (
            f"{robot['name']}: {robot['level']}",
            css(GREY if stale else colour(robot["level"])),
            robot["reason"],
        )
        for robot in facts["robots"]
    ]
    return str(_PANEL.head(said, badges, beat, STILL_S, css(GREY)))


def note(text: str) -> str:
    """Return a text in place of a picture's levels."""
    return str(_PANEL.note(text))


def details(facts: dict[str, Any]) -> str:
    """Return further facts of a picture."""
    return str(_PANEL.details([*map(_of_robot, facts["robots"]), _of_cell(facts)]))


def strip(levels: Sequence[str]) -> str:
    """Return a timeline of levels, oldest first, as a coloured bar."""
    if not levels:
        return ""
    width, start, stops = 100.0 / len(levels), 0, []
    for level, same in groupby(levels):
        end = start + len(list(same))
        stops.append(f"{css(colour(level))} {start * width:.2f}% {end * width:.2f}%")
        start = end
    return str(_PANEL.strip(",".join(stops)))


def legend() -> str:
    """Return the legend of the scene: its shapes and the colours of the levels."""
    rows = [(css(rgb), shape, text) for rgb, shape, text in _LEGEND]
    names = ("CLEAR", "WARN", "SLOW", "STOP", "UNKNOWN")
    return str(_PANEL.legend(rows, [(name, css(COLOURS[name])) for name in names]))


def _of_robot(robot: dict[str, Any]) -> list[tuple[str, str]]:
    rows = [
        (robot["name"], robot["reason"]),
        ("speed limit", metres(robot["limit_m_s"] or 0.0, "m/s")),
        ("robot's speed", metres(robot["speed_m_s"], "m/s")),
        ("separation", metres(robot["separation_m"], "m")),
    ]
    if robot["pair"]:
        rows += [("decides", robot["pair"]), ("apart", robot["apart"])]
    if detail := _detail(robot):
        rows.append(("detail", detail))
    if robot["clears"]:
        rows.append(("clears when", robot["clears"]))
    return rows


def _detail(robot: dict[str, Any]) -> str:
    """Return the detail without the reason and the remedy, which other rows show."""
    said = set(robot["reason"].split("; "))
    parts = robot["detail"].removeprefix(f"{robot['name']}: ").split("; ")
    return "; ".join(p for p in parts if p not in said and not p.startswith("clears when"))


def _of_cell(facts: dict[str, Any]) -> list[tuple[str, str]]:
    tracked = facts["tracked"]
    lost = facts["people"][tracked:]
    age, rate = facts["age_s"], facts.get("rate_hz")
    rows = [
        ("node", ": ".join(filter(None, (facts["state"].lower(), "; ".join(facts["reasons"]))))),
        ("people", f"{tracked}" + (f", lost: {', '.join(map(str, lost))}" if lost else "")),
        ("age", "-" if age is None else f"{age * 1e3:.0f} ms"),
    ]
    if rate is not None:
        rows.append(("rate", f"{rate:.1f} Hz"))
    if facts["coverage"]:
        rows.append(("coverage", facts["coverage"]))
    if facts.get("dropped"):
        rows.append(("pictures dropped", str(facts["dropped"])))
    return rows


def metres(value: float | None, unit: str) -> str:
    """Format a number with two digits and its unit; a dash if unknown."""
    return "-" if value is None else f"{value:.2f} {unit}"
