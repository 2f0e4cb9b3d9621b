"""The whole answer to "why did it slow?", as plain data."""

from collections.abc import Mapping
from typing import Any

from hri_predict.explaining.counters import AFTER_NS, BEFORE_NS
from hri_predict.explaining.deciding import (
    distance_of,
    link_of,
    milder_slack_of,
    needed_by,
    part_of,
    person_of,
    way_of,
)
from hri_predict.explaining.episodes import WAITING, Episode, level_of
from hri_predict.explaining.full_speed import enough_m, full_speed, full_speeds, start_m
from hri_predict.explaining.hindsight import hindsight
from hri_predict.explaining.reason_clause import (
    because,
    brief,
    reason_text,
    remedy,
    widened,
)
from hri_predict.explaining.recordings import Recordings
from hri_predict.explaining.situation import Situation, hidden_ends_in, nearest_episodes
from hri_predict.explaining.times import NS, dated, shown
from hri_predict.explaining.values import listed, mapped, number, text
from hri_predict.protocol.messages import Level

TERMS = {
    "s_h": "S_h person's travel until the robot stops",
    "s_r": "S_r robot's travel before it brakes",
    "s_s": "S_s robot's travel while it brakes",
    "c": "C   intrusion distance",
    "z_d": "Z_d uncertainty of the person's position",
    "z_r": "Z_r uncertainty of the robot's position",
}
"""The terms of ISO/TS 15066:2016, 5.5.4.2.3."""
DRIFT_S = 0.01
"""Minimum step within a second that shows that the wall clock was set: clocks drift by at most 0.5
ms.
"""
_QUIET = ("NONE", "PERSON_NEAR", "PERSON_APPROACHING", *WAITING)


def explain(about: Situation) -> dict[str, Any]:
    """Return all data about one moment: see the keys; lengths in metres, times in seconds."""
    advice, data = about.advice, about.advice.data
    said = [text(reason) for reason in _reasons(about)]
    return {
        "answer": _answer(about),
        "at": about.clock(advice.utc_ns),
        "at_utc_ns": advice.utc_ns,
        "robot": about.robot,
        "level": level_of(data),
        "reason": text(data.get("reason")),
        "detail": text(data.get("detail")),
        "speed_m_s": number(data.get("speed_m_s")),
        "speed_limit_m_s": number(data.get("speed_limit_m_s")),
        "full_speed_m_s": full_speed(about),
        "age_s": number(data.get("age_s")),
        "also": about.also,
        "people": about.people,
        "separation": separation(about),
        "forecast": hindsight(
            about.window,
            about.info,
            advice.utc_ns,
            person=person_of(advice),
            segment=part_of(advice),
        ),
        "history": None if about.episode is None else history(about, about.episode),
        "counters": [
            {"where": m.where, "name": m.name, "by": m.by, "link": m.is_link} for m in about.moved
        ],
        "counted_s": (BEFORE_NS + AFTER_NS) / NS,
        "links": [
            {"name": link.name, "connected": link.connected, "last_error": link.last_error}
            for link in about.links
        ],
        "clock_moved_s": _clock_moved(about),
        "faults": [
            {"reason": reason, "what": reason_text(reason), "clears_when": remedy(reason)}
            for reason in dict.fromkeys(said)
            if reason not in _QUIET
        ],
        "notes": list(about.recordings.notes),
    }


def _answer(about: Situation) -> str:
    level, when = level_of(about.advice.data), about.clock(about.advice.utc_ns)
    if Level[level].rank < Level.SLOW.rank:
        return f"{when} {about.robot} {level}: it was neither slowed nor stopped"
    return f"{when} {about.robot} {level} because {because(about)}"


def _reasons(about: Situation) -> list[Any]:
    status = {} if about.status is None else about.status.data
    grounds = mapped(about.advice.data.get("grounds"))
    own = [about.advice.data.get("reason"), *listed(grounds.get("unknown"))]
    return [*own, status.get("reason"), *listed(status.get("reasons"))]


def separation(about: Situation) -> dict[str, Any] | None:
    """Return the terms of the protective separation distance; ``None``: the robot's position was
    unknown.

    ``short_m`` is the missing distance; negative if the distance was larger than required.
    ``milder_way``: rule that required less than ``way``, and so decided; ``None``: ``way`` decided.
    ``full_speed_enough_m``: see ``enough_m``. ``start_enough_m``: see ``start_m``;
    ``start_short_m``: what ``nearest_m`` lacked of it. Both are ``None`` if the robot may move.
    """
    data, grounds = about.advice.data, mapped(about.advice.data.get("grounds"))
    terms = mapped(grounds.get("terms_m"))
    if not terms:
        return None
    has_m, needed_m = distance_of(about.advice), needed_by(about.advice)
    milder_m = milder_slack_of(about.advice)
    nearest_m = number(data.get("separation_m"))
    start = None if number(data.get("speed_limit_m_s")) else start_m(about)
    short = None if start is None or nearest_m is None else start - nearest_m
    return {
        "person": person_of(about.advice),
        "body_part": part_of(about.advice) or text(grounds.get("segment")),
        "robot_part": link_of(about.advice, about.info) or text(grounds.get("robot_capsule")),
        "way": text(grounds.get("way")),
        "milder_way": None if milder_m is None else way_of(about.advice),
        "milder_slack_m": milder_m,
        "joints_not_seen": hidden_ends_in(about),
        "separation_m": has_m,
        "nearest_m": nearest_m,
        "predicted_separation_m": number(data.get("predicted_separation_m")),
        "needed_m": _rounded(needed_m),
        "short_m": None if has_m is None or needed_m is None else round(needed_m - has_m, 4),
        "widened": widened(about, text(grounds.get("way"))),
        "start_enough_m": _rounded(start),
        "start_short_m": _rounded(short),
        "full_speed_enough_m": _rounded(enough_m(about)),
        "speed_m_s": number(data.get("speed_m_s")),
        "limit_m_s": number(data.get("speed_limit_m_s")),
        "reaction_s": number(grounds.get("reaction_s")),
        "stopping_s": number(grounds.get("stopping_s")),
        "human_m_s": number(grounds.get("human_m_s")),
        "place_error_m": number(grounds.get("place_error_m")),
        "terms_m": {name: number(terms.get(name)) for name in TERMS},
        "protective_m": number(grounds.get("protective_m")),
    }


def _rounded(length_m: float | None) -> float | None:
    return None if length_m is None else round(length_m, 4)


def history(about: Situation, episode: Episode) -> dict[str, Any]:
    """Return the level's history: time and reason of its start, its phases, and its release."""
    last = episode.phases[-1]
    return {
        "before": episode.before,
        "from_utc_ns": episode.start_ns,
        "from": about.clock(episode.start_ns),
        "to_utc_ns": episode.end_ns,
        "to": None if episode.end_ns is None else about.clock(episode.end_ns),
        "after": episode.after,
        "waited_for": None if episode.end_ns is None else remedy(last.reason),
        "phases": [
            {
                "at": about.clock(phase.first.utc_ns),
                "seconds": round((phase.last_ns - phase.first.utc_ns) / NS, 2),
                "level": phase.level,
                "reason": phase.reason,
                "why": brief(phase.first, about.info),
            }
            for phase in episode.phases
        ],
    }


def _clock_moved(about: Situation) -> float:
    """Return the wall clock's step in these seconds; 0 for normal drift."""
    near = [t for t in about.window.clock if abs(t.utc_ns - about.advice.utc_ns) <= BEFORE_NS]
    moved = [number(told.data.get("utc_moved_s")) or 0.0 for told in near]
    most = max(moved, key=abs, default=0.0)
    return most if abs(most) >= DRIFT_S else 0.0


def neighbours(about: Situation) -> dict[str, Any]:
    """Return the nearest slowdowns before and after a moment without one."""
    before, after = nearest_episodes(about.recordings, about.robot, about.advice.utc_ns)
    return {
        "before": None if before is None else listing(before, about.recordings),
        "after": None if after is None else listing(after, about.recordings),
    }


def listing(episode: Episode, recordings: Recordings) -> dict[str, Any]:
    """Return an episode as an entry of a list; ``at`` is valid for ``--at``.

    ``lost_s`` is the lost working time; ``None`` if the robot's full speed is unknown.
    """
    worst, info = episode.worst, recordings.info_at(episode.start_ns)
    full_m_s = full_speeds(info).get(episode.robot)
    return {
        "at": dated(worst.first.utc_ns, recordings),
        "from": shown(episode.start_ns, recordings),
        "from_utc_ns": episode.start_ns,
        "worst_utc_ns": worst.first.utc_ns,
        "seconds": round((episode.last_ns - episode.start_ns) / NS, 1),
        "lost_s": None if full_m_s is None else round(episode.lost_s(full_m_s), 1),
        "is_over": episode.end_ns is not None,
        "robot": episode.robot,
        "level": worst.level,
        "reason": worst.reason,
        "why": brief(worst.first, info),
        "least_m": episode.least_m,
    }


def is_slowed(found: Mapping[str, Any]) -> bool:
    """Whether an explanation concerns a slowdown or stop."""
    return Level[found["level"]].rank >= Level.SLOW.rank
