"""Separation judged by where body and robot are now: modes ``iso`` and ``fixed``."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from hri_predict.risk.separation import (
    Finding,
    StoppingCurve,
    closing_s,
    directed_limit,
    person_travel,
    protective_distance,
    speed_levels,
)
from hri_predict.scene import Bools, Floats


def judge_iso(
    distance_m: float,
    speed_m_s: float,
    stopping: tuple[float, float],
    curve: StoppingCurve,
    reaction_s: float,
    clearance_m: float,
    margins_m: Sequence[float],
    who: tuple[int, int, int] = (-1, -1, -1),
    human_m_s: float = 0.0,
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
        human_m_s: of a person who is faster than the standard assumes; else 0.
    """
    needed = protective_distance(
        speed_m_s, reaction_s, *stopping, intrusion_m=clearance_m, human_m_s=human_m_s
    ).total
    slack = distance_m - needed
    assumed = curve.required_m(reaction_s, clearance_m)
    required = curve.required_m(reaction_s, clearance_m, human_m_s) if human_m_s else assumed
    limits = curve.speed_limits([distance_m - m for m in margins_m], required)
    return Finding(
        separation_m=distance_m,
        predicted_m=distance_m - (needed - clearance_m),
        slack_m=slack,
        near=distance_m < float(assumed[0]),
        breach_s=closing_s(slack, speed_m_s),
        limits=limits,
        person=who[0],
        segment=who[1],
        link=who[2],
    )


def judge_retreat(
    found: Finding,
    retreats: Callable[[Floats], Bools],
    speed_m_s: float,
    stopping_s: float,
    curve: StoppingCurve,
    reaction_s: float,
    clearance_m: float,
    margins_m: Sequence[float],
    human_m_s: float = 0.0,
) -> Finding:
    """Let a robot that gets away from everybody be as fast as the people alone permit.

    While every link's distance to every person grows until the robot stands, it moves towards
    nobody: S_r and S_s are 0, and S_h + C + Z_d + Z_r must fit. As in ``TimeByTime`` a speed is
    permitted only with every slower one, and warnings regard any direction.

    Args:
        found: as ``judge_iso`` found it.
        retreats: (L,) speeds -> whether the robot gets away until it stands, at each.
        speed_m_s, stopping_s: of the robot now, T_s.
        curve, reaction_s, clearance_m, margins_m, human_m_s: as for ``judge_iso``.
    """
    levels = speed_levels(curve.max_speed_m_s, min(found.limits[:2]))
    away = retreats(np.append(speed_m_s, levels))
    if not away.any():
        return found
    times = reaction_s + np.append(stopping_s, np.interp(levels, curve.speed_m_s, curve.time_s))
    come = person_travel(times, clearance_m, human_m_s)
    left = np.where(away, found.separation_m - come, -np.inf)
    limits = [
        directed_limit(levels, left[1:], clearance_m + margin, limit)
        for margin, limit in zip(margins_m[:2], found.limits[:2], strict=True)
    ]
    result = replace(found, limits=(*limits, *found.limits[2:]))
    if not away[0]:
        return result
    slack = float(left[0]) - clearance_m
    return replace(
        result,
        predicted_m=float(left[0]),
        slack_m=slack,
        breach_s=closing_s(slack, speed_m_s),
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
