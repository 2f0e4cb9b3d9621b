"""Text of an advice: the problem and its remedy."""

from collections.abc import Sequence
from itertools import compress, count

from hri_predict.base.skeleton import JOINTS, in_words
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.machine import Advised
from hri_predict.risk.levels.pair import pair_m
from hri_predict.risk.levels.waiting import why_and_until
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.stage import RobotFindings
from hri_predict.risk.terms import Finding
from hri_predict.risk.types import NamedZoneState
from hri_predict.risk.wording import NOTE, STANDS_M_S, off_text
from hri_predict.zones.body_zones import BodyZones

_TOO_CLOSE = "too close for the robot's present speed"
_TOO_NEAR_TO_START = "too close for the standing robot to start"


def detail_of(
    robot: RobotConstants,
    bodies: BodyZones,
    named: Sequence[NamedZoneState],
    *,
    demand: Demand,
    advised: Advised,
    reason: Reason,
    who: Finding | None,
    found: RobotFindings,
) -> str:
    """Return the problem and its remedy as text; at *clear*, notes only."""
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
        parts.append(f"person {ids[who.person]}{off}, {part}, {where(robot, who, apart_m)}")
        if who.slack_m < 0:
            stands = found.speed_m_s < STANDS_M_S
            parts.append(f"{-who.slack_m:.2f} m {_TOO_NEAR_TO_START if stands else _TOO_CLOSE}")
    for i in compress(count(), speeds.fast.tolist()):
        joint = in_words(JOINTS[speeds.fastest_joint[i]])
        parts.append(f"person {ids[i]} is fast: {joint} {speeds.fastest_m_s[i]:.1f} m/s")
    parts += [
        f"speed of person {ids[i]} unknown" for i in compress(count(), speeds.unknown.tolist())
    ]
    if demand.reason in (Reason.ZONE_OCCUPIED, Reason.ZONE_ENTRY_PREDICTED):
        inside = demand.reason is Reason.ZONE_OCCUPIED
        names = [z.name for z in named if z.occupied == inside and z.entry_s is not None]
        parts.append("zone " + ", ".join(names))
    if robot.tools and found.tool is None:
        parts.append("no tool is confirmed: the worst case over all tools is used")
    return "; ".join(parts if is_clear else [*parts, f"clears when {clears_when}"])


def where(robot: RobotConstants, people: Finding, apart_m: float | None = None) -> str:
    """Return the deciding pair's distance and its reference, as text.

    ``apart_m``: that distance; by default the minimum distance of all pairs.
    """
    if robot.risk.mode == "fixed":
        return f"{max(people.slack_m + robot.fixed_radius_m, 0.0):.2f} m from the base's axis"
    link = in_words(robot.model.capsule_names[people.link])
    return f"{max(people.separation_m if apart_m is None else apart_m, 0.0):.2f} m from {link}"
