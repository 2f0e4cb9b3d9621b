"""Separation judged by where body and robot are now: modes ``iso`` and ``fixed``."""

from collections.abc import Sequence
from dataclasses import replace

from hri_predict.risk.separation import Finding, StoppingCurve, closing_s, protective_distance


def judge_iso(
    distance_m: float,
    speed_m_s: float,
    stopping: tuple[float, float],
    curve: StoppingCurve,
    reaction_s: float,
    clearance_m: float,
    margins_m: Sequence[float],
    who: tuple[int, int, int] = (-1, -1, -1),
) -> Finding:
    """Judge one distance by the protective separation distance.

    Args:
        distance_m: between body as captured and robot now.
        speed_m_s: of the robot's fastest point now.
        stopping: T_s and S_s at that speed.
        curve: the robot's stopping curve.
        reaction_s: T_r from the capture.
        clearance_m: C + Z_d + Z_r.
        margins_m: for the limits.
        who: person, segment and robot capsule of that distance.
    """
    needed = protective_distance(speed_m_s, reaction_s, *stopping, intrusion_m=clearance_m).total
    slack = distance_m - needed
    standing = float(curve.required_m(reaction_s, clearance_m)[0])
    limits = curve.speed_limits([distance_m - m for m in margins_m], reaction_s, clearance_m)
    return Finding(
        separation_m=distance_m,
        predicted_m=distance_m - (needed - clearance_m),
        slack_m=slack,
        near=distance_m < standing,
        breach_s=closing_s(slack, speed_m_s),
        limits=limits,
        person=who[0],
        segment=who[1],
        link=who[2],
    )


def judge_fixed(
    found: Finding,
    from_base_m: float,
    radius_m: float,
    max_speed_m_s: float,
    margins_m: Sequence[float],
    speed_m_s: float,
) -> Finding:
    """Judge a circle around the robot's base: who is inside stops it, else it is at full speed.

    Args:
        found: the separation, as ``judge_iso`` found it; its distances are kept.
        from_base_m: horizontal distance of the nearest body's surface from the base's axis.
        radius_m: of the circle.
        max_speed_m_s: of the robot.
        margins_m: for the limits; the circle itself has the first as its edge, because a robot
            that knows no slow speed has nothing to slow down for.
        speed_m_s: of the robot's fastest point now.
    """
    slack = from_base_m - radius_m
    beyond = [slack - (margin - margins_m[0]) for margin in margins_m]
    return replace(
        found,
        slack_m=slack,
        near=slack < 0,
        breach_s=closing_s(slack, speed_m_s),
        limits=tuple(max_speed_m_s if left >= 0 else 0.0 for left in beyond),
    )
