"""Creates a picture of a tick, in the node's process but not in its loop."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, nearest_points
from hri_predict.base.skeleton import CANONICAL, in_words, seen_text
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
"""Number of instants of the horizon that are sent, including now and its end."""
_A = [segment.joint_a for segment in CANONICAL.segments]
_B = [segment.joint_b for segment in CANONICAL.segments]
_RADII = np.array([segment.radius for segment in CANONICAL.segments])


def picture_of(tick: Tick, assembly: Assembly) -> Picture:
    """Return the picture of a tick, without the results of failed stages."""
    snapshot, assessment = tick.snapshot, tick.assessment
    cut_off = [link.name for link in assembly.links if not link.connected]
    shapes, facts = empty_shapes(), _facts(tick, assembly.config, cut_off)
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
    robots = []
    band_m = assembly.config.node.risk.band_m
    for advice in tick.advices:
        why, robot = tick.grounds(advice.robot) or Grounds(), assembly.robots[advice.robot]
        rows = shapes["robots"][:0] if why.capsules is None else _rows(why.capsules)
        names, link = robot.capsule_names, why.link
        said = robot_facts(
            assembly.config.node.robots[advice.robot].name,
            advice,
            why,
            link=names[link] if link is not None and 0 <= link < len(names) else "",
            band_m=band_m,
        )
        facts["robots"].append(said | {"capsules": len(rows)})
        robots.append(rows)
    if robots:
        shapes["robots"] = np.concatenate(robots)
    return Picture(facts, **shapes)


def _facts(tick: Tick, config: Config, cut_off: Sequence[str]) -> dict[str, Any]:
    """Return the facts other than shapes and robots: people, the node's state, the room's regions.

    ``cut_off``: the links that are not connected, by name.
    """
    snapshot = tick.snapshot
    tracked = [] if snapshot is None else list(snapshot.ids)
    lost = [] if snapshot is None else [person.id for person in snapshot.lost]

    return {
        "node_s": tick.now_ns * 1e-9,
        "places": [] if snapshot is None else _places(snapshot),
        "sees": snapshot is not None and sees(snapshot.reasons),
        **state_facts(tick.status.node_state, tick.reasons, cut_off),
        "robots": [],
        "people": [*tracked, *lost],
        "tracked": len(tracked),
        "age_s": None if snapshot is None else snapshot.age_s,
        "named": {zone.name: [zone.occupied, zone.entry_s] for zone in tick.named_zones},
        "zones": [],
        "times_s": [0.0],
        "room": room_of(config),
    }


def _places(snapshot: PeopleSnapshot) -> list[list[float]]:
    """Return x and y of each tracked person, the mean of the joints last seen."""
    seen = (snapshot.joint_age_s <= 0) & np.isfinite(snapshot.last_positions).all(-1)
    return [
        joints[newest].mean(axis=0)[:2].round(3).tolist()
        for joints, newest in zip(snapshot.last_positions, seen, strict=True)
        if newest.any()
    ]


def state_facts(
    state: NodeState, reasons: Sequence[Reason], cut_off: Sequence[str] = ()
) -> dict[str, Any]:
    """Return the node's state and its reasons, in words."""
    return {"state": state.name, "reasons": troubles(state, reasons, cut_off)}


def said_of(advice: Advice, band_m: float | None) -> dict[str, Any]:
    """Return an advice in words, for screens. ``band_m``: ``risk.band_m``."""
    return {
        "level": advice.level.name,
        "reason": reason_beside(advice),
        "clears": clears_beside(advice, band_m),
        "detail": advice.detail,
        "latch": advice.latch_id,
    }


def robot_facts(
    name: str, advice: Advice, why: Grounds, *, link: str, band_m: float | None
) -> dict[str, Any]:
    """Return the facts of a robot: its advice and the deciding pair.

    "line" joins the nearest points of the pair; "near" is text for that person, or "" unless a
    person decides the level.

    Args:
        name, advice: the robot's name and advice.
        why: the known grounds of the advice.
        link: name of the robot's capsule in the pair; "": not known.
        band_m: the configured ``risk.band_m``; ``None``: not known.
    """
    who = "" if why.person is None else f"person {why.person}'s {in_words(why.segment)}"
    seen, short = seen_text(why.hidden_ends), seen_text(why.hidden_ends, short=True)
    by_distance = advice.level is not Level.CLEAR and advice.reason.row.by_distance
    near, line = "", None
    if who and why.pair_m is not None and by_distance:
        near = f"{who}{seen}, {max(0.0, why.pair_m):.2f} m from the {in_words(link) or 'robot'}"
    if why.pair is not None:
        line = np.stack(nearest_points(*why.pair))
    return {
        "name": name,
        **said_of(advice, band_m),
        "limit_m_s": advice.speed_limit_m_s,
        "separation_m": advice.separation_m,
        "speed_m_s": why.speed_m_s,
        "line": None if line is None or not np.isfinite(line).all() else line.round(4).tolist(),
        "apart": apart_text(advice, why),
        "near": near,
        "pair": f"{who}{short} - {in_words(link)}" if who and link else who,
    }


def bodies_of(joints: Floats) -> Shapes:
    """Convert (P, J, 3) joints to (P, S, 7) capsules; NaN for a segment without both joints."""
    if not len(joints):
        return empty_shapes()["bodies"]
    radii = np.broadcast_to(_RADII[:, None], (*joints.shape[:-2], len(_RADII), 1))
    rows = np.concatenate((joints[..., _A, :], joints[..., _B, :], radii), axis=-1)
    return rows.astype(np.float32)


def steps_of(count: int) -> list[int]:
    """Return at most ``STEPS`` of ``count`` steps, evenly spread, including first and last."""
    return np.unique(np.linspace(0, count - 1, min(STEPS, count)).round().astype(int)).tolist()


def _rows(capsules: Capsules) -> Shapes:
    radius = np.asarray(capsules.radius)[..., None]
    return np.concatenate((capsules.a, capsules.b, radius), axis=-1).astype(np.float32)


def _forecast(
    positions: Floats, snapshot: PeopleSnapshot, times_s: Floats, rate_hz: float
) -> Shapes:
    """Bodies ``times_s`` after the tick (P, K, S, 7). Step k is at capture + (k + 1) / rate."""
    since_s = (snapshot.now_ns - snapshot.capture_ns) * 1e-9
    step = np.round((times_s + since_s[:, None]) * rate_hz).astype(int) - 1
    people = min(len(positions), len(step))
    step = step[:people].clip(0, positions.shape[1] - 1)
    return bodies_of(positions[np.arange(people)[:, None], step])
