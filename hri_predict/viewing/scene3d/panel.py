"""The text next to the 3D scene, as HTML that escapes everything."""

from collections.abc import Sequence
from html import escape
from typing import Any

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
    (PERSON, "solid", "person as captured"),
    (FORECAST, "faint", "where the person is predicted to be, up to zones ahead"),
    (COLOURS["SLOW"], "faint", "zone: where the person may be at zones ahead; in the worst level"),
    (COLOURS["SLOW"], "line", "robot, and the line to the deciding body part: in its level"),
    (LOST, "faint", "lost person; shadow or floor where a person could stand unseen"),
    (VIEW, "line", "field of view"),
    (COLOURS["CLEAR"], "line", "named zone: green empty, yellow entry predicted, red occupied"),
    (GRID, "line", "floor: a line each half metre, brighter each metre"),
)
_LIVE: Rgb = (60, 75, 90)
_ONE_LINE = "white-space:nowrap;overflow:hidden;text-overflow:ellipsis"
_TRACK = "6px 67px 0 120px"
"""Above the track of the slider below it: viser has labels left of it, and a number right."""
ROOM_FOR_BAR = "<style>.mantine-ScrollArea-viewport{padding-right:12px}</style>"
"""viser's scroll bar lies on top of what it scrolls; so it lies beside it."""
BEAT_S, STILL_S = 0.5, 4.0
"""Interval at which live values are resent; a view without updates is greyed out after STILL_S."""
_UNFOLDED = (
    "<style>[data-dock-region-handle],[data-dock-minimize],[aria-label^='Collapse panel']"
    "{visibility:hidden!important}</style>"
)
"""A live panel cannot be folded away: it would take the cover along."""
STRIP_PARTS = 240
"""Maximum number of parts of a timeline; each shows the worst level within."""


def head(facts: dict[str, Any], *, stale: str = "", when: str = "", beat: int = 0) -> str:
    """The levels of a picture: ``stale`` says why it is not now, in grey; ``when`` it was recorded.

    Its height is always the same for the same robots, so that nothing below it moves under a hand.
    Current values have to come again with another ``beat``, or the browser covers the whole view.
    """
    if when:
        parts = [_line("RECORDED", GREY, when)]
    else:
        parts = [_line("NOT LIVE", GREY, stale) if stale else _line("LIVE", _LIVE, "")]
    for robot in facts["robots"]:
        rgb = GREY if stale else colour(robot["level"])
        parts.append(badge(f"{robot['name']}: {robot['level']}", rgb, robot["reason"]))
    if not when:
        parts.append(_UNFOLDED)
    if not (stale or when):
        parts.append(_cover(beat))
    return '<div style="padding:0 12px">' + "".join(parts) + "</div>"


def _cover(beat: int) -> str:
    """Comes over the whole view by itself, unless it is replaced before: nothing else shows a
    browser that the view's process, or the network, has stopped.
    """
    return (
        "<style>@keyframes hri-still{0%,95%{opacity:0}100%{opacity:1}}"
        ".still::after{content:'NO CONTACT: nothing here is current'}</style>"
        f'<div class="still" data-beat="{beat}" style="position:fixed;inset:0;z-index:10000;'
        "pointer-events:none;display:flex;align-items:center;justify-content:center;"
        f"background:{css(GREY)};color:#fff;font-size:34px;font-weight:800;opacity:0;"
        f'animation:hri-still {STILL_S}s linear forwards"></div>'
    )


def note(text: str) -> str:
    """A text instead of a picture's levels."""
    return f'<div style="padding:8px 12px">{escape(text)}</div>'


def details(facts: dict[str, Any]) -> str:
    """Return further facts of a picture."""
    tables = [_table(_of_robot(robot)) for robot in facts["robots"]]
    return f'<div style="padding:0 12px">{"".join(tables)}{_table(_of_cell(facts))}</div>'


def badge(word: str, rgb: Rgb, line: str) -> str:
    """A large word on a colour, and a line under it."""
    return (
        f'<div style="background:{css(rgb)};color:#fff;border-radius:6px;padding:8px 12px;'
        f'margin:4px 0"><div style="font-size:26px;font-weight:800;letter-spacing:1px;{_ONE_LINE}">'
        f'{escape(word)}</div><div style="font-size:13px;{_ONE_LINE}">{escape(line)}</div></div>'
    )


def _line(word: str, rgb: Rgb, line: str) -> str:
    """Return a word on a colour, and the text next to it."""
    return (
        f'<div style="font-size:13px;{_ONE_LINE}"><span style="background:{css(rgb)};color:#fff;'
        f'border-radius:4px;padding:1px 8px;font-weight:800">{escape(word)}</span> {escape(line)}'
        "</div>"
    )


def strip(levels: Sequence[str]) -> str:
    """A timeline of levels, oldest first: a coloured bar."""
    if not levels:
        return ""
    width = 100.0 / len(levels)
    stops = []
    for i, level in enumerate(levels):
        if i and level == levels[i - 1]:
            continue
        end = next((k for k in range(i, len(levels)) if levels[k] != level), len(levels))
        rgb = css(colour(level))
        stops.append(f"{rgb} {i * width:.2f}% {end * width:.2f}%")
    bar = f"height:14px;border-radius:3px;background:linear-gradient(to right,{','.join(stops)})"
    return f'<div style="padding:{_TRACK}"><div class="levels" style="{bar}"></div></div>'


def legend() -> str:
    """Return the legend of the scene."""
    rows = "".join(
        f'<tr><td style="padding-right:10px">{_swatch(rgb, shape)}</td><td>{escape(text)}</td></tr>'
        for rgb, shape, text in _LEGEND
    )
    return (
        f'<div style="padding:6px 12px"><table style="font-size:12px;opacity:.85">{rows}</table>'
        f'<div style="font-size:12px;opacity:.85;margin-top:4px">{_levels()}</div></div>'
    )


def _swatch(rgb: Rgb, shape: str) -> str:
    size = "width:22px;height:3px" if shape == "line" else "width:14px;height:14px"
    opacity = ".45" if shape == "faint" else "1"
    return (
        f'<div style="{size};margin:auto;border-radius:3px;background:{css(rgb)};'
        f'opacity:{opacity}"></div>'
    )


def _levels() -> str:
    """The levels' colours, each with its name on it."""
    return " ".join(
        f'<span style="background:{css(COLOURS[name])};color:#fff;border-radius:3px;'
        f'padding:1px 5px;font-weight:700">{name}</span>'
        for name in ("CLEAR", "WARN", "SLOW", "STOP", "UNKNOWN")
    )


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
    """The detail without what stands in other rows: the reason, and what clears it."""
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
    """A number with two digits and its unit; a dash if it is not known."""
    return "-" if value is None else f"{value:.2f} {unit}"


def _table(rows: list[tuple[str, str]]) -> str:
    lines = "".join(
        f'<tr><td style="opacity:.6;padding-right:10px;vertical-align:top;white-space:nowrap">'
        f"{escape(name)}</td><td>{escape(text)}</td></tr>"
        for name, text in rows
    )
    return f'<table style="font-size:12.5px;margin:4px 0">{lines}</table>'
