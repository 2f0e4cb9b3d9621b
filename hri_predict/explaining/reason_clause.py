"""Reason for a slowdown, as a clause that follows "because"."""

import re
from collections.abc import Callable, Sequence
from itertools import pairwise

from hri_predict.base.skeleton import in_words, seen_text
from hri_predict.explaining.counters import DAMAGE, slow_ticks
from hri_predict.explaining.deciding import (
    distance_of,
    hidden_of,
    link_of,
    milder_slack_of,
    needed_by,
    part_of,
    person_of,
    way_of,
)
from hri_predict.explaining.episodes import WAITING, slows, waits
from hri_predict.explaining.full_speed import enough_m, full_speed, is_full, start_m
from hri_predict.explaining.situation import Situation, hidden_ends_in, situation
from hri_predict.explaining.times import NS, AskedTime
from hri_predict.explaining.values import listed, mapped, metres, number, text, whole
from hri_predict.protocol.reasons import RISING, Reason, widened_by
from hri_predict.recording import RecordingInfo, Told

STANDS_M_S = 0.01
_LATCH = re.compile(r"latch( \d+)?: ([^;]*)$")
_CAUSES = {
    "stop": "after a stop",
    "start": "because the node was started",
    "restart": "because the node was started again",
    "blind": "because the source was blind, or its scenes too old or frozen",
    "lost": "because a person was lost",
}
_WHEN_TOO_SLOW = ("INPUT_STALE", "CLOCK_JUMP", "CLOCK_DRIFT", "ROBOT_STATE_STALE")
"""Reasons that a machine which is too slow for the node also causes."""
_OWN_RULES = ("standard", "contact")
"""Rules for which zones play no part."""
_OBEYS_ADVICES = 12
"""Number of Advice messages, half a second, within which a robot must keep a lower limit."""


def because(about: Situation) -> str:
    """Return the reason for this advice. If the robot only waits, add the original cause."""
    reason = text(about.advice.data.get("reason"))
    if reason not in WAITING and waits(about.advice.data):
        return _released(about)
    told = _TELL.get(reason)
    why = reason_text(reason) if told is None else told(about)
    return why + (_too_slow(about) if reason in _WHEN_TOO_SLOW else "")


def brief(told: Told, info: RecordingInfo) -> str:
    """Return the reason from the advice alone, for a line of a list."""
    reason = text(told.data.get("reason"))
    part, person = part_of(told), person_of(told)
    if not part or person is None:
        return reason_text(reason).partition(";")[0]
    link = in_words(link_of(told, info))
    seen = seen_text(hidden_of(told, info), short=True)
    where = f"{in_words(part)}{seen} {metres(distance_of(told))} from {link}"
    short = Reason[reason].row.short if reason in Reason.__members__ else ""
    return f"person {person}'s {where}, {short or reason_text(reason)}"


def reason_text(reason: str) -> str:
    """Return a reason as text; its name if this version does not know it."""
    return Reason[reason].text if reason in Reason.__members__ else f"of {reason}"


def remedy(reason: str) -> str:
    """Return the remedy."""
    return Reason[reason].clears_when if reason in Reason.__members__ else ""


def _of_person(about: Situation) -> str:
    """``person 2's right hand was 0.42 m from the forearm; 0.78 m were needed at 0.6 m/s``."""
    return f"{_whereabouts(about)}; {_needed(about)}{_enough(about)}{_zones(about)}"


def _whereabouts(about: Situation) -> str:
    """``person 2's right hand was 0.42 m from the forearm``."""
    person, part = person_of(about.advice), part_of(about.advice)
    who = "a person" if person is None else f"person {person}"
    who += f"'s {in_words(part)}{seen_text(hidden_ends_in(about))}" if part else ""
    link = in_words(link_of(about.advice, about.info))
    return f"{who} was {metres(distance_of(about.advice))} from the {link or 'robot'}"


def _released(about: Situation) -> str:
    """Return the clause for a robot that waits only for its release although a person is
    present.
    """
    if RISING in text(about.advice.data.get("detail")):
        limit = number(about.advice.data.get("speed_limit_m_s")) or 0.0
        waited = f"it could move again, at first slowly: its limit had risen to {limit:.2f} m/s"
        if is_full(limit, full_speed(about)):
            waited = f"it could move again: its limit had risen to its full speed, {limit:.2f} m/s"
    else:
        waited = "it waited for new captures to confirm that it may continue"
    given = about.window.advice[about.robot]
    causes = [t for t in given if t.utc_ns < about.advice.utc_ns and slows(t.data)]
    causes = [told for told in causes if not waits(told.data)]
    if not causes:
        return f"{waited}; {_whereabouts(about)}"
    then = situation(about.recordings, AskedTime(causes[-1].utc_ns, 1), about.robot)
    return f"{waited}; before that, until {about.clock(causes[-1].utc_ns)}: {because(then)}"


def _needed(about: Situation) -> str:
    advice, data = about.advice, about.advice.data
    separation, needed = distance_of(advice), needed_by(advice)
    speed, limit = number(data.get("speed_m_s")), number(data.get("speed_limit_m_s"))
    safe = f"no more than {limit or 0.0:.2f} m/s was safe"
    if is_full(limit, full_speed(about)):
        safe = f"its full speed, {limit:.2f} m/s, was safe"
    if separation is None or needed is None or speed is None:
        return safe if limit else "no motion was safe"
    stands = speed < STANDS_M_S
    milder_m = milder_slack_of(advice)
    if (needed > separation) if milder_m is None else (milder_m < 0):
        at = "before the standing robot may start" if stands else f"at {speed:.2f} m/s"
        by = f"{needed:.2f} m were" if milder_m is None else f"{-milder_m:.2f} m more were"
        return f"{by} needed {at}{widened(about, way_of(about.advice))}"
    if not limit:
        near = "too near for the standing robot to start" if stands else "too near to keep moving"
        return f"{near}{widened(about, way_of(about.advice))}"
    near = safe if is_full(limit, full_speed(about)) else f"near enough that {safe}"
    return f"{near}{widened(about, way_of(about.advice))}"


def widened(about: Situation, way: str) -> str:
    """Return the causes of zones larger than usual; "" for a distance by another rule, ``way``."""
    there = [] if about.status is None else listed(about.status.data.get("reasons"))
    known = [Reason[name] for name in map(text, there) if name in Reason.__members__]
    return widened_by(known) if way not in _OWN_RULES else ""


def _zones(about: Situation) -> str:
    """Return why the zones did not decide: they were larger than usual."""
    why = widened(about, "zones") if way_of(about.advice) in _OWN_RULES else ""
    return f"; the zones were larger than usual{why}" if why else ""


def _enough(about: Situation) -> str:
    """Return the distances that would have been enough to start and for full speed, if known."""
    enough, has_m = enough_m(about), distance_of(about.advice)
    if enough is None or has_m is None or has_m >= enough:  # another pair was nearer
        return ""
    start = None if number(about.advice.data.get("speed_limit_m_s")) else start_m(about)
    if start is not None:
        then = "" if has_m < start else ", once new captures confirm it"
        return f"; {start:.2f} m are enough to start{then}, and {enough:.2f} m for full speed"
    return f"; {enough:.2f} m are enough for full speed"


def _lost(about: Situation) -> str:
    person = person_of(about.advice)
    seen = next((p for p in about.people if p["id"] == person), None)
    ago_s = None if seen is None else seen["last_seen_s"]
    since = "" if ago_s is None else f" {ago_s:.1f} s before"
    link = in_words(link_of(about.advice, about.info)) or "robot"
    return (
        f"person {person if person is not None else '?'} vanished{since} and may still be here "
        f"(lost): at worst {metres(distance_of(about.advice))} from the {link}; "
        f"{_needed(about)}"
    )


def _speed_unknown(about: Situation) -> str:
    person = person_of(about.advice)
    who = "a person" if person is None else f"person {person}"
    return f"the speed of {who} was not known yet, so the fastest counts: " + _of_person(about)


def _zone(about: Situation) -> str:
    is_inside = text(about.advice.data.get("reason")) == "ZONE_OCCUPIED"
    told = {} if about.status is None else mapped(about.status.data.get("named_zones"))
    names = [
        f"'{text(name)}'"
        for name, state in told.items()
        if (mapped(state).get("occupied") is True) == is_inside
        and mapped(state).get("entry_s") is not None
    ]
    who = f"person {about.people[0]['id']}" if len(about.people) == 1 else "a person"
    verb = "was in" if is_inside else "was about to enter"
    return f"{who} {verb} the zone {', '.join(names) or '(unnamed)'}"


def _robot_state(about: Situation) -> str:
    """Return why there is no RobotState: damaged messages, a broken link, or silence."""
    sums: dict[str, int] = {}
    for each in about.moved:
        if each.is_link and each.name in DAMAGE:
            sums[each.where] = sums.get(each.where, 0) + each.by
    crc = [m for m in about.moved if m.is_link and m.name == "crc_errors"]
    if crc:
        where = ", ".join(f"{m.by} on {m.where}" for m in crc)
        return f"CRC errors damaged what the robot's controller sent ({where}): no fresh RobotState"
    if sums:
        where = ", ".join(f"{count} on {link}" for link, count in sums.items())
        return f"damaged messages ({where}): no fresh RobotState arrived"
    cut = [link for link in about.links if link.connected is False]
    if cut:
        said = ", ".join(f"{c.name} ({c.last_error or 'no error reported'})" for c in cut)
        return f"no fresh RobotState arrived: link not connected: {said}"
    silent = {
        link: max((ns for ns in times if ns <= about.advice.utc_ns), default=None)
        for link, times in about.window.received.items()
    }
    if not silent:
        return "no RobotState has arrived: no controller sends one"
    last = ", ".join(
        link if ns is None else f"{link} {(about.advice.utc_ns - ns) / NS:.1f} s"
        for link, ns in silent.items()
    )
    return f"no fresh RobotState arrived; links connected but silent: {last}"


def _stale(about: Situation) -> str:
    arrived = [told for told in about.window.scenes if told.utc_ns <= about.advice.utc_ns]
    if not arrived:
        return "the newest scene was too old: none arrived for a long time"
    ago_s = (about.advice.utc_ns - arrived[-1].utc_ns) / NS
    if ago_s > 0.1:
        return f"the newest scene was too old: none has arrived for {ago_s:.2f} s"
    age = number(None if about.status is None else about.status.data.get("age_s"))
    return "the newest scene was too old: scenes arrived late" + (f", {age:.2f} s" if age else "")


def _too_slow(about: Situation) -> str:
    """Return that the node's machine was too slow, which alone may have been the cause."""
    slow = slow_ticks(about.window, about.moved, about.advice.utc_ns)
    if slow is None:
        return ""
    late, missed = slow
    return f"; the node's machine was too slow: {late} ticks late and {missed} missed around then"


def _clock_jump(about: Situation) -> str:
    jump_s = max(_steps(about.window.scenes, about.advice.utc_ns), key=abs, default=0.0)
    by = f" by {jump_s:+.1f} s" if abs(jump_s) > 0.05 else ""
    return f"the source's clock jumped{by}"


def _steps(scenes: Sequence[Told], until_ns: int) -> list[float]:
    """Return the shifts of capture stamps against their receipt within the last seconds, in
    seconds.
    """
    recent = [t for t in scenes if until_ns - 5 * NS <= t.utc_ns <= until_ns]
    pairs = [(whole(t.data.get("capture_ns")), t.node_ns) for t in recent]
    known = [(stamp, receipt) for stamp, receipt in pairs if stamp is not None]
    return [((b[0] - a[0]) - (b[1] - a[1])) / NS for a, b in pairwise(known)]


def _too_fast(about: Situation) -> str:
    given = [t for t in about.window.advice[about.robot] if t.utc_ns <= about.advice.utc_ns]
    limits = [number(t.data.get("speed_limit_m_s")) or 0.0 for t in given]
    worst, most = "", 0.0
    for k in range(_OBEYS_ADVICES, len(given)):
        speed = number(given[k].data.get("speed_m_s")) or 0.0
        limit = max(limits[k - _OBEYS_ADVICES : k + 1])
        if speed - limit > most:
            most, when = speed - limit, about.clock(given[k].utc_ns)
            worst = f" ({speed:.2f} m/s at {when}, where {limit:.2f} was advised)"
    return f"the robot was faster than it was advised{worst}, so it may only run or stand"


def _pending(about: Situation) -> str:
    if about.advice.data.get("level") == "SLOW":
        waited = "it could move again, at first slowly: the speed limit rose step by step"
        if is_full(number(about.advice.data.get("speed_limit_m_s")), full_speed(about)):
            waited = "its limit was its full speed again, and new captures had to confirm it"
    else:
        waited = "it waited for new captures to confirm that it may continue"
    return f"{waited}; {_origin(about)}"


def _latched(about: Situation) -> str:
    match = _LATCH.search(text(about.advice.data.get("detail")))
    number_, causes = (match[1] or "", match[2].split(", ")) if match else (" ?", [])
    why = "; ".join(_CAUSES.get(cause.split(" (")[0], text(cause)) for cause in causes)
    return f"latch{number_} waits for an acknowledge{f', {why}' if why else ''}; {_origin(about)}"


def _origin(about: Situation) -> str:
    """Return the last earlier phase with a reason other than waiting, after its time."""
    phase = None if about.episode is None else about.episode.cause_before(about.advice.utc_ns)
    if phase is None:
        return "before that, nothing else was recorded"
    then = situation(about.recordings, AskedTime(phase.first.utc_ns, 1), about.robot)
    return f"before that, until {about.clock(phase.last_ns)}: {because(then)}"


_TELL: dict[str, Callable[[Situation], str]] = {
    "PERSON_NEAR": _of_person,
    "PERSON_APPROACHING": _of_person,
    "CONTACT_POSSIBLE": _of_person,
    "PERSON_LOST": _lost,
    "SPEED_UNKNOWN": _speed_unknown,
    "ZONE_OCCUPIED": _zone,
    "ZONE_ENTRY_PREDICTED": _zone,
    "ROBOT_STATE_STALE": _robot_state,
    "INPUT_STALE": _stale,
    "CLOCK_JUMP": _clock_jump,
    "ROBOT_TOO_FAST": _too_fast,
    "RELEASE_PENDING": _pending,
    "LATCHED": _latched,
}
