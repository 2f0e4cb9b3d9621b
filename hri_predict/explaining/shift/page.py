"""The report of a shift as one page of HTML that loads nothing and runs nothing."""

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from hri_predict.base.markup import LEVEL_COLOURS, Content, Markup, document, join, table, tag
from hri_predict.base.skeleton import in_words
from hri_predict.explaining.episodes import LEVEL_NAMES
from hri_predict.explaining.values import metres
from hri_predict.protocol.messages import LEVELS

# -- bars as SVG inside the page: nothing is loaded, no script runs --------------------------------

_WIDTH, _BAR, _LEFT = 640.0, 18.0, 64.0
_TALL = 120.0


def level_bars(rows: Sequence[tuple[str, Mapping[str, float]]]) -> Markup:
    """A bar for each row, divided by the seconds at each level; as long as its seconds."""
    most = max((sum(seconds.values()) for _, seconds in rows), default=0.0) or 1.0
    parts: list[Markup] = []
    for k, (name, seconds) in enumerate(rows):
        top, left = k * (_BAR + 4), _LEFT
        parts.append(_text(_LEFT - 6, top + 13, name, "end"))
        for level, colour in LEVEL_COLOURS.items():
            wide = (_WIDTH - _LEFT) * seconds.get(level, 0.0) / most
            if wide > 0:
                title = f"{name} {level}: {seconds[level]:.1f} s"
                parts.append(_rect((left, top), (wide, _BAR), colour, title))
            left += wide
    return _svg(parts, len(rows) * (_BAR + 4))


def legend() -> Markup:
    """The colours of the levels, with their names."""
    spans = [
        tag("span", tag("i", style=f"background:{colour}"), name, class_="key")
        for name, colour in LEVEL_COLOURS.items()
    ]
    return tag("p", *spans, class_="legend")


def histogram(rows: Sequence[Sequence[float]], unit: str) -> Markup:
    """Columns of (lower edge, weight); the last column holds all beyond."""
    most = max((weight for _, weight in rows), default=0.0) or 1.0
    wide = (_WIDTH - _LEFT) / max(1, len(rows))
    parts: list[Markup] = []
    for k, (edge, weight) in enumerate(rows):
        tall = (_TALL - 6) * weight / most
        left = _LEFT + k * wide
        if tall > 0:
            title, size = f"from {edge:.1f} {unit}: {weight:.1f} s", (max(0.5, wide - 1), tall)
            parts.append(_rect((left, _TALL - tall), size, "#0072B2", title))
        if k % 5 == 0:
            parts.append(_text(left, _TALL + 14, f"{edge:.1f}", "middle"))
    parts.append(_text(_WIDTH, _TALL + 28, f"{unit}; the last column holds all beyond", "end"))
    parts.append(_text(_LEFT - 6, 12, f"{most:.0f} s", "end"))
    return _svg(parts, _TALL + 34)


def _svg(parts: Sequence[Markup], tall: float) -> Markup:
    return tag(
        "svg",
        join(parts),
        viewBox=f"0 0 {_WIDTH:.0f} {tall:.0f}",
        width="100%",
        xmlns="http://www.w3.org/2000/svg",
        role="img",
    )


def _rect(at: tuple[float, float], size: tuple[float, float], colour: str, title: str) -> Markup:
    return tag(
        "rect",
        tag("title", title),
        x=f"{at[0]:.1f}",
        y=f"{at[1]:.1f}",
        width=f"{size[0]:.2f}",
        height=f"{size[1]:.2f}",
        fill=colour,
    )


def _text(x: float, y: float, words: str, anchor: str) -> Markup:
    return tag("text", words, x=f"{x:.1f}", y=f"{y:.1f}", text_anchor=anchor, font_size="11")


# --------------------------------------------------------------------------------------------------

_STYLE = """
* { box-sizing: border-box; }
body { font: 15px/1.45 "Helvetica Neue", Arial, sans-serif; color: #222; margin: 0 auto;
  max-width: 60rem; padding: 1.2rem; }
h1 { font-size: 1.6rem; margin: 0; } h2 { font-size: 1.2rem; margin: 1.8rem 0 .4rem;
  border-bottom: 1px solid #222; } h3 { font-size: 1rem; margin: 1.1rem 0 .3rem; }
table { border-collapse: collapse; width: 100%; margin: .4rem 0 1rem; font-size: .87rem; }
th, td { border-bottom: 1px solid #ccc; padding: .25rem .5rem; text-align: right;
  vertical-align: top; overflow-wrap: anywhere; }
th:first-child, td:first-child, .left td, .left th { text-align: left; }
code { font: .8rem Menlo, Consolas, monospace; }
.note { border-left: 4px solid #D55E00; padding-left: .7rem; }
.small { color: #555; font-size: .85rem; }
.big { display: flex; flex-wrap: wrap; gap: .8rem; margin: .8rem 0; }
.big div { border: 1px solid #ccc; border-radius: 6px; padding: .5rem .9rem; }
.big b { display: block; font-size: 1.4rem; }
.key { margin-right: 1rem; } .key i { display: inline-block; width: .9rem; height: .9rem;
  margin-right: .3rem; vertical-align: -2px; }
th, .stops td:nth-child(-n+4) { white-space: nowrap; }
tr { break-inside: avoid; } svg { display: block; }
"""
_COUNTED = "Errors, losses and failures; what a healthy cell counts is left out."


def page(shift: Mapping[str, Any], recordings: Sequence[str]) -> str:
    """The page.

    Args:
        shift: of ``tally``.
        recordings: the files and folders as the user named them, for the commands to type.
    """
    title = f"Shift of {shift['cell']}, {shift['from']} to {shift['to']}"
    return document(
        title,
        _STYLE,
        tag("h1", title),
        _about(shift),
        *(_robot(robot) for robot in shift["robots"]),
        _longest(shift["longest_stops"], recordings),
        _forecast(shift["forecast"], shift["predictor"]),
        _trouble(shift),
    )


def _about(shift: Mapping[str, Any]) -> Markup:
    clock = "UTC" if shift["has_utc"] else "seconds since the start: these have no UTC"
    files = shift["files"]
    count = f"{files} {'file' if files == 1 else 'files'}"
    words = f"{_time(shift['seconds'])}, {count}; times are {clock}"
    notes = [tag("p", f"Note: {note}", class_="note") for note in shift["notes"]]
    if shift["dropped"]:
        lost = f"The recorder lost {shift['dropped']} messages: what follows is incomplete."
        notes.append(tag("p", lost, class_="note"))
    return join([tag("p", words, class_="small"), *notes])


def _robot(robot: Mapping[str, Any]) -> Markup:
    total = sum(robot["seconds_at"].values()) or 1.0
    figures = [
        ("of full speed permitted, on average", _percent(robot["permitted_share"])),
        ("of the time at full speed", _percent(robot["full_speed_share"])),
        ("stops", robot["stops"]),
        ("standing by advice", _time(robot["stopped_s"])),
        ("working time lost by slowdowns and stops", _cost(robot["lost_s"])),
        ("near misses", robot["near_misses"]),
        (_nearest(robot["nearest_at"]), metres(robot["nearest_m"])),
        ("age of advice, p50 / p99", f"{_ms(robot['age_p50_s'])} / {_ms(robot['age_p99_s'])}"),
    ]
    boxes = [tag("div", tag("b", value), name) for name, value in figures]
    hours = [(hour["from"][:8], hour["seconds_at"]) for hour in robot["hours"]]
    parts: list[Content] = [
        tag("h2", f"Robot {robot['name']}"),
        tag("div", *boxes, class_="big"),
        tag("h3", "Time at each level"),
        legend(),
        level_bars([("all", robot["seconds_at"])]),
        table(
            ("", *LEVEL_NAMES),
            [
                ("time", *(_time(robot["seconds_at"][name]) for name in LEVEL_NAMES)),
                ("share", *(_percent(robot["seconds_at"][name] / total) for name in LEVEL_NAMES)),
            ],
        ),
        tag("h3", "By hour"),
        level_bars(hours),
        table(
            ("from", "recorded", "stops", "stop, unknown or fault", "of full speed permitted"),
            [_hour(hour) for hour in robot["hours"]],
        ),
        tag("h3", "Why it slowed or stopped"),
        table(
            ("cause", "worst level", "times", "all together", "working time lost"),
            [
                (
                    each["what"],
                    each["level"],
                    each["count"],
                    _time(each["seconds"]),
                    _cost(each["lost_s"]),
                )
                for each in robot["causes"]
            ],
        ),
        tag("h3", "How near people were"),
        histogram(robot["separation"], "m"),
        _near(robot),
    ]
    if robot["not_recorded_s"] > 0:
        missing = f"Not recorded in between: {_time(robot['not_recorded_s'])}."
        parts.append(tag("p", missing, class_="note"))
    words = (
        f"Full speed is {robot['top_m_s']:g} m/s. Of full speed permitted: the mean of "
        f"the advised limit over it: what the advice leaves for work. Of the working time lost, a "
        f"second at half of full speed is half a second; a slowdown or stop is counted from its "
        f"beginning until the robot may go on."
    )
    return join([*parts, tag("p", words, class_="small")])


def _hour(hour: Mapping[str, Any]) -> tuple[Content, ...]:
    at = hour["seconds_at"]
    standing = sum(at[level.name] for level in LEVELS if not level.may_move)
    share = _percent(hour["permitted_share"])
    return hour["from"], _time(sum(at.values())), hour["stops"], _time(standing), share


def _near(robot: Mapping[str, Any]) -> Markup:
    if not robot["near_by_pair"]:
        return tag("p", "No near miss: no person was within a fifth of the distance needed.")
    rows = [
        (
            f"{in_words(pair['body_part'])} to {in_words(pair['robot_part'])}",
            pair["count"],
            f"{pair['least_m']:.2f} m",
        )
        for pair in robot["near_by_pair"][:20]
    ]
    return join(
        [
            tag("h3", "Near misses"),
            table(("body part and robot part", "times", "nearest"), rows),
            tag(
                "p",
                "A near miss: the robot moves, and a person has less than a fifth of the distance "
                "needed to spare. Less than the distance needed is a stop.",
                class_="small",
            ),
        ]
    )


def _longest(stops: Sequence[Mapping[str, Any]], recordings: Sequence[str]) -> Markup:
    if not stops:
        return join([tag("h2", "The longest stops"), tag("p", "No stop.")])
    first = shlex.quote(recordings[0]) if recordings else "FILE"
    rows = [
        (
            stop["from"],
            stop["robot"],
            tag(
                "span",
                stop["level"],
                style=f"color:{LEVEL_COLOURS[stop['level']]};font-weight:bold",
            ),
            _time(stop["seconds"]),
            stop["why"],
            tag(
                "code",
                f"hri-predict explain {first} --at {stop['at']} "
                f"--robot {shlex.quote(stop['robot'])}",
            ),
        )
        for stop in stops
    ]
    head = ("from", "robot", "level", "stood", "why, at its worst", "type this to see more")
    return join(
        [tag("h2", "The longest stops"), tag("div", table(head, rows), class_="left stops")]
    )


def _forecast(rows: Sequence[Mapping[str, Any]], predictor: str) -> Markup:
    shown = [
        (
            f"{row['ahead_s']:.1f} s",
            _mm(row["mean_m"]),
            _mm(row["p50_m"]),
            _mm(row["p95_m"]),
            row["joints"],
            _percent(row["coverage"]),
            row["zone_joints"],
        )
        for row in rows
    ]
    head = ("ahead", "mean", "p50", "p95", "joints compared", "inside the zones", "compared")
    words = (
        f"Forecasts of {predictor or 'the predictor'} and zones against where the source saw "
        f"people later, one of each a second. Inside: a joint, with the body around it, lies in "
        f"the zone of its segment."
    )
    title = tag("h2", "Forecasts against what then happened")
    return join([title, table(head, shown), tag("p", words, class_="small")])


def _trouble(shift: Mapping[str, Any]) -> Markup:
    parts: list[Content] = [tag("h2", "Losses and counters")]
    if shift["counters"]:
        rows = [
            (
                f"{'link ' if each['link'] else ''}{each['where']}: "
                f"{each['name'].replace('_', ' ')}",
                each["by"],
            )
            for each in shift["counters"]
        ]
        parts += [table(("counter", "rose by"), rows), tag("p", _COUNTED, class_="small")]
    else:
        parts.append(tag("p", "No counter of errors or losses rose."))
    if shift["clock_sets"]:
        parts.append(
            tag("p", f"The wall clock was set {shift['clock_sets']} times.", class_="note")
        )
    if shift["conditions"]:
        rows = [(each["what"], _time(each["seconds"])) for each in shift["conditions"]]
        parts += [tag("h3", "Conditions that held"), table(("what was wrong", "time"), rows)]
    return join(parts)


def _time(seconds: float) -> str:
    minutes, rest = divmod(seconds, 60)
    if seconds < 60:
        return f"{seconds:.1f} s"
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02.0f} s"


def _cost(seconds: float | None) -> str:
    return "-" if seconds is None else _time(seconds)


def _percent(share: float | None) -> str:
    return "-" if share is None else f"{100 * share:.1f} %"


def _nearest(at: str | None) -> str:
    return "shortest distance to a person" + ("" if at is None else f", at {at}")


def _ms(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds * 1e3:.0f} ms"


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value * 1e3:.0f} mm"
