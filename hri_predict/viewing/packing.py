"""Makes a picture of a tick, in the node's process but not in its loop."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, nearest_points
from hri_predict.base.skeleton import CANONICAL, in_words
from hri_predict.node.listeners import Tick
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import Grounds
from hri_predict.risk.wording import apart_text, clears_beside, reason_beside, troubles
from hri_predict.run.assemble import Assembly
from hri_predict.run.config import Config
from hri_predict.viewing.picture import Picture, Shapes, empty_shapes
from hri_predict.viewing.room import room_of, sees

STEPS = 8
"""Number of moments of the horizon that are sent, now and its end among them."""
_A = [segment.joint_a for segment in CANONICAL.segments]
_B = [segment.joint_b for segment in CANONICAL.segments]
_RADII = np.array([segment.radius for segment in CANONICAL.segments])


def picture_of(tick: Tick, assembly: Assembly) -> Picture:
    """The picture of a tick; what a failed stage did not find is missing from it."""
    snapshot, assessment = tick.snapshot, tick.assessment
    cut_off = [link.name for link in assembly.links if not link.connected]
    shapes, facts = empty_shapes(), facts_of(tick, assembly.config, cut_off)
    if snapshot is not None:
        places = [*snapshot.last_positions, *(lost.positions for lost in snapshot.lost)]
        shapes["bodies"] = bodies_of(np.array(places).reshape(-1, len(CANONICAL.joints), 3))
    if assessment is not None and assessment.zones.ids:
        zones = assessment.zones
        steps = steps_of(len(zones.times_s))
        facts["zones"] = list(zones.ids)
        facts["times_s"] = zones.times_s[steps].tolist()
        shapes["zones"] = _rows(zones.capsules)[:, steps]
        if tick.forecast is not None and snapshot is not None:
            rate_hz = assembly.config.predictor.rate_hz
            shapes["forecast"] = _forecast(
                tick.forecast.positions, snapshot, zones.times_s[steps], rate_hz
            )
    grounds = () if assessment is None else assessment.grounds
    robots = []
    for robot, advice in zip(facts["robots"], tick.advices, strict=True):
        rests_on = grounds[advice.robot] if advice.robot < len(grounds) else Grounds()
        known = rests_on.capsules
        rows = np.zeros((0, 7), np.float32) if known is None else _rows(known)
        robots.append(rows)
        robot["capsules"] = len(rows)
        names, link = assembly.robots[advice.robot].capsule_names, rests_on.link
        robot |= pair_facts(
            advice.level,
            advice.reason,
            advice.detail,
            line=None if rests_on.pair is None else np.stack(nearest_points(*rests_on.pair)),
            pair_m=rests_on.pair_m,
            needed_m=rests_on.pair_needed_m,
            speed_m_s=rests_on.speed_m_s,
            who=who_of(rests_on.person, rests_on.segment),
            link=names[link] if link is not None and 0 <= link < len(names) else "",
        )
    if robots:
        shapes["robots"] = np.concatenate(robots)
    return Picture(facts, **shapes)


def facts_of(tick: Tick, config: Config, cut_off: Sequence[str] = ()) -> dict[str, Any]:
    """Return the facts besides shapes: robots, people, the node's state, and the room's regions.

    ``cut_off``: the links that are not connected, by name.
    """
    snapshot, assessment = tick.snapshot, tick.assessment
    tracked = [] if snapshot is None else list(snapshot.ids)
    lost = [] if snapshot is None else [person.id for person in snapshot.lost]
    named = () if assessment is None else assessment.named_zones
    reasons = (*(() if snapshot is None else snapshot.reasons), *_reasons(assessment))
    return {
        "node_s": tick.now_ns * 1e-9,
        "places": [] if snapshot is None else _places(snapshot),
        "sees": snapshot is not None and sees(snapshot.reasons),
        **state_facts(tick.status.node_state, reasons, cut_off),
        "robots": [_robot(advice, config) for advice in tick.advices],
        "people": [*tracked, *lost],
        "tracked": len(tracked),
        "age_s": None if snapshot is None else snapshot.age_s,
        "named": {zone.name: [zone.occupied, zone.entry_s] for zone in named},
        "zones": [],
        "times_s": [0.0],
        "room": room_of(config),
    }


def _places(snapshot: PeopleSnapshot) -> list[list[float]]:
    """x and y of each tracked person: the mean of the joints that were seen last."""
    seen = (snapshot.joint_age_s <= 0) & np.isfinite(snapshot.last_positions).all(-1)
    return [
        joints[newest].mean(axis=0)[:2].round(3).tolist()
        for joints, newest in zip(snapshot.last_positions, seen, strict=True)
        if newest.any()
    ]


def state_facts(
    state: NodeState, reasons: Sequence[Reason], cut_off: Sequence[str] = ()
) -> dict[str, Any]:
    """The node's state, and why, in words."""
    return {"state": state.name, "reasons": troubles(state, reasons, cut_off)}


def said_of(level: Level, reason: Reason, detail: str, band_m: float | None) -> dict[str, str]:
    """Return an advice's words, as on screens. ``band_m``: ``risk.band_m``."""
    return {
        "level": level.name,
        "reason": reason_beside(level, reason),
        "clears": clears_beside(level, reason, detail, band_m),
        "detail": detail,
    }


def pair_facts(
    level: Level,
    reason: Reason,
    detail: str,
    *,
    line: Floats | None = None,
    pair_m: float | None = None,
    needed_m: float | None = None,
    speed_m_s: float | None = None,
    who: str = "",
    link: str = "",
) -> dict[str, Any]:
    """The deciding pair: its nearest points (2, 3), how far they are and, at the robot's speed,
    have to be apart, and the names of both; ``None`` and "": not known.

    "near" is for the person who stands there, and "" unless a person decides the level.
    """
    by_distance = level is not Level.CLEAR and reason.row.by_distance
    decides = bool(who) and pair_m is not None and by_distance
    near = f"{who}, {max(0.0, pair_m or 0.0):.2f} m from the {in_words(link) or 'robot'}"
    return {
        "speed_m_s": speed_m_s,
        "line": None if line is None or not np.isfinite(line).all() else line.round(4).tolist(),
        "apart": apart_text(
            pair_m=pair_m,
            needed_m=needed_m,
            speed_m_s=speed_m_s,
            level=level,
            reason=reason,
            detail=detail,
        ),
        "near": near if decides else "",
        "pair": f"{who} - {in_words(link)}" if who and link else who,
    }


def who_of(person: int | None, segment: str) -> str:
    """``person 2's left hand``."""
    return "" if person is None else f"person {person}'s {in_words(segment)}"


def bodies_of(joints: Floats) -> Shapes:
    """(P, J, 3) joints as (P, S, 7) capsules; a segment without both of its joints is NaN."""
    if not len(joints):
        return empty_shapes()["bodies"]
    radii = np.broadcast_to(_RADII[:, None], (*joints.shape[:-2], len(_RADII), 1))
    rows = np.concatenate((joints[..., _A, :], joints[..., _B, :], radii), axis=-1)
    return rows.astype(np.float32)


def steps_of(count: int) -> list[int]:
    """At most ``STEPS`` of ``count`` steps, spread evenly, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(STEPS, count)).round().astype(int)).tolist()


def _rows(capsules: Capsules) -> Shapes:
    radius = np.asarray(capsules.radius)[..., None]
    return np.concatenate((capsules.a, capsules.b, radius), axis=-1).astype(np.float32)


def _forecast(
    positions: Floats, snapshot: PeopleSnapshot, times_s: Floats, rate_hz: float
) -> Shapes:
    """Bodies at ``times_s`` after the tick; (P, K, S, 7). Step k is at capture + (k + 1) / rate."""
    since_s = (snapshot.now_ns - snapshot.capture_ns) * 1e-9
    step = np.round((times_s + since_s[:, None]) * rate_hz).astype(int) - 1
    people = min(len(positions), len(step))
    step = step[:people].clip(0, positions.shape[1] - 1)
    return bodies_of(positions[np.arange(people)[:, None], step])


def _robot(advice: Advice, config: Config) -> dict[str, Any]:
    return {
        "name": config.node.robots[advice.robot].name,
        **said_of(advice.level, advice.reason, advice.detail, config.node.risk.band_m),
        "latch": advice.latch_id,
        "limit_m_s": advice.speed_limit_m_s,
        "separation_m": advice.separation_m,
        "capsules": 0,
        **pair_facts(advice.level, advice.reason, advice.detail),
    }


def _reasons(assessment: Any) -> tuple[Reason, ...]:
    return () if assessment is None else assessment.reasons
