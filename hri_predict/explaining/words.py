"""An explanation as text that fits 80 columns."""

import textwrap
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from hri_predict.base.skeleton import in_words, seen_text
from hri_predict.explaining.explanation import TERMS
from hri_predict.explaining.full_speed import is_full
from hri_predict.explaining.reason_clause import STANDS_M_S
from hri_predict.explaining.values import metres

_WAYS = {
    "zones": "by the zones over time",
    "standard": "by the standard's distance",
    "contact": "as a permitted contact",
}
SHOWN_PHASES = 12


def told(found: Mapping[str, Any], width: int = 80) -> Iterator[str]:
    """Return the lines of an explanation; the first one is the answer."""
    for paragraph in _paragraphs(found):
        yield from _wrapped(paragraph, width)


def _wrapped(line: str, width: int) -> list[str]:
    """Wrap one line; continuation lines are aligned with the text after two or more blanks."""
    start = len(line) - len(line.lstrip())
    return textwrap.wrap(line, width, subsequent_indent=" " * (start + 2)) or [""]


def _paragraphs(found: Mapping[str, Any]) -> Iterator[str]:
    yield found["answer"]
    for robot, level in found["also"].items():
        yield f"  also then: {robot} {level}"
    for heading, lines in (
        ("Asked of the robot", _asked(found)),
        ("Seen", _seen(found["people"])),
        (f"Separation at {found['at']}", _separation(found["separation"])),
        ("Forecast, compared with the actual motion", _forecast(found["forecast"])),
        ("History", _history(found["history"])),
        (f"Counters that rose in these {found['counted_s']:g} s", _counters(found)),
        ("Faults and conditions, and what clears them", _faults(found["faults"])),
        ("Note", found["notes"]),
    ):
        shown = list(lines)
        if shown:
            yield ""
            yield heading
            yield from (f"  {line}" for line in shown)


def _asked(found: Mapping[str, Any]) -> Iterator[str]:
    limit, speed, age = found["speed_limit_m_s"], found["speed_m_s"], found["age_s"]
    full = " (its full speed)" if is_full(limit, found["full_speed_m_s"]) else ""
    parts = [f"{found['level']} ({found['reason']})", f"speed limit {limit or 0.0:.2f} m/s{full}"]
    parts += [] if speed is None else [f"the robot moved at {speed:.2f} m/s"]
    parts += [] if age is None else [f"on a capture {age * 1e3:.0f} ms old"]
    yield "; ".join(parts)


def _seen(people: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    nobody = True
    for person in people:
        nobody = False
        parts = [f"person {person['id']} {person['state']}"]
        if person["last_seen_s"] is not None:
            parts.append(f"last seen {person['last_seen_s']:.2f} s before")
        if person["age_s"] is not None:
            age_ms = person["age_s"] * 1e3
            parts.append(f"capture {age_ms:.0f} ms old at the last forecast recorded before")
        parts.append(f"{person['observed']} of {person['joints']} joints observed")
        if person["missing"] and person["observed"]:
            parts.append("not: " + ", ".join(map(in_words, person["missing"])))
        if person["unmapped"]:
            parts.append("not in the joint map: " + ", ".join(map(in_words, person["unmapped"])))
        parts += [f"speed {person['speed']}"] if person["speed"] else []
        yield "; ".join(parts)
    if nobody:
        yield "no person"


def _separation(found: Mapping[str, Any] | None) -> Iterator[str]:
    if found is None:
        yield "not known: the position of the robot or of the people was not known"
        return
    if found["person"] is None:
        yield "no person was there"
        return
    part, link = in_words(found["body_part"]), in_words(found["robot_part"])
    short, stands = found["short_m"], (found["speed_m_s"] or 0.0) < STANDS_M_S
    is_short = short is not None and short > 0
    motion = "to start, at least" if is_short else "while it stands"
    motion = motion if stands else f"at {found['speed_m_s']:.2f} m/s"
    seen = seen_text(found["joints_not_seen"])
    yield (
        f"From person {found['person']}'s {part}{seen} to the robot's {link}, the pair that "
        f"decided, judged {_WAYS.get(found['way'], found['way'])}:"
    )
    yield _row("distance then, from surface to surface", found["separation_m"])
    if found["place_error_m"]:
        yield _row(
            "  already subtracted: stated error of the person's place", found["place_error_m"]
        )
    yield _row(f"distance that the robot needed {motion}", found["needed_m"])
    if found["widened"]:
        yield f"  (more than usual{found['widened']})"
    if found["way"] == "zones" and found["needed_m"] is not None:
        kept = sum(found["terms_m"][term] or 0.0 for term in ("c", "z_d", "z_r"))
        yield _row("  part used up by both until the robot stops", found["needed_m"] - kept)
        yield _row("  part kept between person and robot: C + Z_d + Z_r", kept)
    if short is not None:
        yield _row("missing" if short > 0 else "to spare", abs(short))
    if found["milder_slack_m"] is not None:
        spare, rule = found["milder_slack_m"], _WAYS.get(found["milder_way"], found["milder_way"])
        kind = "missing" if spare < 0 else "to spare"
        yield f"Judged {rule}, the robot needed less, so that decided: {abs(spare):.3f} m {kind}."
    if short is not None and short <= 0 and not found["limit_m_s"]:
        yield (
            "This distance is for the robot as it moved. To move on or to start, the robot needs "
            "more: room for its slowest speed (risk.min_speed_m_s) and risk.slow_margin_m, and "
            "risk.band_m to be released" + (", see below." if found["start_enough_m"] else ".")
        )
    yield "From any part of a body to any part of the robot:"
    yield _row("minimum distance then", found["nearest_m"])
    if found["predicted_separation_m"] is not None:
        meant = "minimum distance to the zones until the robot stops"
        yield _row(meant, found["predicted_separation_m"])
    if found["start_enough_m"] is not None:
        yield _row("distance that is enough to start or to move on", found["start_enough_m"])
        lacked = found["start_short_m"]
        if lacked is not None:
            yield _row("  missing of it" if lacked > 0 else "  to spare", abs(lacked))
            if lacked <= 0:
                yield "  (it starts once risk.release_captures new captures confirm it)"
    if found["full_speed_enough_m"] is not None:
        yield _row("distance that is enough for full speed", found["full_speed_enough_m"])
        yield (
            "  (for people no faster than the standard assumes, with risk.slow_margin_m and "
            "risk.band_m; the zones may permit it nearer)"
        )
    yield from _standard(found)


def _standard(found: Mapping[str, Any]) -> Iterator[str]:
    """Return the terms of the standard's distance, and whether it decided."""
    reaction, stopping = found["reaction_s"] or 0.0, found["stopping_s"] or 0.0
    is_milder = found["milder_way"] == "standard"
    decided = "which decided" if is_milder or found["way"] == "standard" else "for comparison only"
    yield (
        f"Protective separation distance of ISO/TS 15066 ({decided}), with the robot at "
        f"{found['speed_m_s'] or 0.0:.2f} m/s, reaction time T_r {reaction * 1e3:.0f} ms, stopping "
        f"time T_s {stopping * 1e3:.0f} ms:"
    )
    for name, meaning in TERMS.items():
        yield _row(meaning, found["terms_m"][name])
    if found["human_m_s"]:
        yield f"  (S_h with the person's own speed, {found['human_m_s']:.1f} m/s)"
    yield _row("S_p sum of these terms: distance required by the standard", found["protective_m"])


def _row(what: str, value: float | None) -> str:
    return f"  {what:<58}{metres(value, 3):>9}"


def _forecast(found: Mapping[str, Any] | None) -> Iterator[str]:
    if found is None:
        return
    if not found["errors"]:
        yield f"person {found['person']}: no later capture to compare with the forecast"
    for error in found["errors"]:
        if error["mean_m"] is None:
            yield f"{error['ahead_s']:.1f} s ahead: person {found['person']} was not seen then"
            continue
        of_part = error["segment_m"]
        name = in_words(found["segment"]) if found.get("segment") else "deciding part"
        part = "" if of_part is None else f"; of the {name} {of_part * 1e3:.0f} mm"
        yield (
            f"{error['ahead_s']:.1f} s ahead: off by {error['mean_m'] * 1e3:.0f} mm, mean of all "
            f"joints{part}"
        )


def _history(found: Mapping[str, Any] | None) -> Iterator[str]:
    if found is None:
        return
    came = f", from {found['before']}" if found["before"] else ""
    phases = found["phases"]
    yield f"slowed at {found['from']}{came}: {phases[0]['why']}"
    for phase in phases[:SHOWN_PHASES]:
        yield f"{phase['at']:>10}  {phase['level']:<7} {phase['seconds']:6.2f} s  {phase['reason']}"
    if len(phases) > SHOWN_PHASES:
        yield f"... and {len(phases) - SHOWN_PHASES} more changes (--json has them)"
    if found["to"] is None:
        yield "not released before the recording ends"
    else:
        waited = f"; it waited until {found['waited_for']}" if found["waited_for"] else ""
        yield f"released at {found['to']} to {found['after']}{waited}"


def _counters(found: Mapping[str, Any]) -> Iterator[str]:
    for each in found["counters"]:
        where = f"link {each['where']}" if each["link"] else each["where"]
        yield f"{where}: {each['name'].replace('_', ' ')} +{each['by']}"
    for link in found["links"]:
        if link["connected"] is False:
            yield f"link {link['name']}: not connected; {link['last_error'] or 'no error reported'}"
    if found["clock_moved_s"]:
        yield f"the wall clock was moved by {found['clock_moved_s']:+.3f} s"


def _faults(faults: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    for fault in faults:
        clears = f"; clears when {fault['clears_when']}" if fault["clears_when"] else ""
        yield f"{fault['reason']}: {fault['what']}{clears}"


HEAD = f"{'from':>10} {'for':>8} {'cost':>7}  robot, worst level, why then"
"""Head of a list of episodes; ``cost`` is lost working time."""


def line_of(episode: Mapping[str, Any], width: int | None = None) -> str:
    """Return an episode as one line of a list; ``width``: cut it there, ``None``: nowhere."""
    lasted = f"{episode['seconds']:.1f} s" + ("" if episode["is_over"] else "+")
    cost = "-" if episode["lost_s"] is None else f"{episode['lost_s']:.1f} s"
    head = f"{episode['from']:>10} {lasted:>8} {cost:>7}  "
    head += f"{episode['robot']} {episode['level']:<7} "
    if width is None:
        return head + str(episode["why"])
    room = max(20, width - len(head))
    return head + textwrap.shorten(episode["why"], room, placeholder=" …")
