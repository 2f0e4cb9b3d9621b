"""Text of an advice: the problem and its remedy."""

from collections.abc import Iterator, Sequence
from itertools import compress, count

from hri_predict.base.skeleton import JOINTS, in_words, seen_text
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import CLEARED, RISING, Reason, widened_by
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.machine import Advised
from hri_predict.risk.levels.pair import hidden_ends_of, pair_m
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import RobotFindings
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.risk.wording import NOTE, STANDS_M_S, off_text
from hri_predict.robots.model import StateMotion
from hri_predict.zones.body_zones import BodyZones

_TOO_CLOSE = "too close for the robot's present speed"
_TOO_NEAR_TO_START = "too close for the standing robot to start"


def detail_of(
    robot: RobotConstants,
    bodies: BodyZones,
    zones: Sequence[str],
    *,
    demand: Demand,
    advised: Advised,
    reason: Reason,
    who: Finding | None,
    found: RobotFindings,
) -> str:
    """Return the problem and its remedy as text; at *clear*, notes only.

    ``zones``: the named zones whose request is the demand's reason.
    """
    if reason is Reason.NONE:
        return ""
    ids, speeds = bodies.zones.ids, bodies.speeds
    is_clear = advised.level is Level.CLEAR
    text, clears_when = why_and_until(robot, found, advised, reason)
    parts = [f"{robot.name}: {NOTE if is_clear else ''}{text}"]
    if demand.reason not in (Reason.NONE, reason):
        later = advised.reason is Reason.RELEASE_PENDING and demand.release.may_move
        after = f"{demand.release.name.lower()} after that: " if later else ""
        parts.append(f"{after}{demand.reason.text}")
    if who is not None:
        segment, apart_m = bodies.zones.segments[who.segment], who.pair_m
        if apart_m is None and found.motion is not None:
            apart_m = pair_m(who, bodies, found.motion)
        part, off = in_words(segment), off_text(bodies.error_m(who.person))
        part += seen_text(hidden_ends_of(who, bodies))
        parts.append(f"person {ids[who.person]}{off}, {part}, {where(robot, who, apart_m)}")
        parts += _short_by(who, bodies, found, reason)
    for i in compress(count(), speeds.fast.tolist()):
        joint = in_words(JOINTS[speeds.fastest_joint[i]])
        parts.append(f"person {ids[i]} is fast: {joint} {speeds.fastest_m_s[i]:.1f} m/s")
    parts += [
        f"speed of person {ids[i]} unknown" for i in compress(count(), speeds.unknown.tolist())
    ]
    if zones:
        parts.append("zone " + ", ".join(zones))
    if robot.tools and found.tool is None:
        parts.append("no tool is confirmed: the worst case over all tools is used")
    return "; ".join(parts if is_clear else [*parts, f"clears when {clears_when}"])


def _short_by(
    who: Finding, bodies: BodyZones, found: RobotFindings, reason: Reason
) -> Iterator[str]:
    """Return the missing distance by the milder rule, and why it is more than usual."""
    _, milder = found.mildest
    slack_m = who.slack_m if milder is None else max(who.slack_m, milder.slack_m)
    by_zones = slack_m <= who.slack_m
    if slack_m >= 0:
        return
    for_what = _TOO_NEAR_TO_START if found.speed_m_s < STANDS_M_S else _TOO_CLOSE
    why = widened_by(bodies.reasons) if by_zones else ""
    if not why and by_zones and bodies.speeds.unknown[who.person]:
        is_said = reason is Reason.SPEED_UNKNOWN
        why = ", by physical limits" if is_said else ", because the person's speed is not known yet"
    yield f"{-slack_m:.2f} m {for_what}{why}"


def where(robot: RobotConstants, people: Finding, apart_m: float | None = None) -> str:
    """Return the deciding pair's distance and its reference, as text.

    ``apart_m``: that distance; by default the minimum distance of all pairs.
    """
    if robot.risk.mode == "fixed":
        return f"{max(people.slack_m + robot.fixed_radius_m, 0.0):.2f} m from the base's axis"
    link = in_words(robot.model.capsule_names[people.link])
    return f"{max(people.separation_m if apart_m is None else apart_m, 0.0):.2f} m from {link}"


def why_and_until(
    robot: RobotConstants, found: RobotFindings, advised: Advised, reason: Reason
) -> tuple[str, str]:
    """Why the robot is stopped or slow, and the condition that ends this."""
    special = _released(advised, robot.risk) or _unproven(robot, found, reason)
    return special or (reason.text, reason.clears_when)


def _released(advised: Advised, risk: RiskSettings) -> tuple[str, str] | None:
    """Return why a robot that may move again, now or soon, still waits, and what ends this."""
    if advised.reason is not Reason.RELEASE_PENDING:
        return None
    if advised.level is not Level.SLOW:
        confirm = f"{risk.release_captures} new captures in a row confirm it"
        is_warning = advised.level is Level.WARN
        cleared = "the cause of the warning has cleared" if is_warning else CLEARED
        return f"waiting to release: {cleared}", confirm
    return (
        f"{RISING}: the speed limit rises by {risk.speed_rise_m_s2:g} m/s each second",
        "it has risen to the value that people allow",
    )


def _unproven(
    robot: RobotConstants, found: RobotFindings, reason: Reason
) -> tuple[str, str] | None:
    """Return, as text, why a robot is judged for all possible positions, and what ends this."""
    motion = robot.robot.motion
    if found.wherever is None or reason is not Reason.ROBOT_STATE_FROZEN:
        return None
    assert isinstance(motion, StateMotion)  # no other is doubted
    far = "gone" if robot.model.base is None else f"over {robot.anywhere_m:.2f} m from its base"
    return (
        f"RobotState has not changed for {motion.still_s:g} s during which the robot was free to "
        "move: its position is not certain",
        f"a joint's position changes, or all people are {far}",
    )
