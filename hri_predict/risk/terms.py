"""Terms of separation: required distance between robot and people, and speed at a given distance.

The protective separation distance of ISO/TS 15066:2016 (scitepress 2020/94464, eq. 2) is

    S_p = S_h + S_r + S_s + C + Z_d + Z_r

``now`` uses it. ``in_time`` requires instead that zone and stopping robot are C + Z_d + Z_r apart
at every moment until the robot has stopped.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.risk.permitted import REACH_SPEED_M_S, come_m

SPEED_LEVELS = 4
"""Number of speeds to try in a known direction, evenly spaced up to the robot's highest speed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ProtectiveDistance:
    """The protective separation distance term by term, metres (ISO/TS 15066:2016, 5.5.4.2.3).

    Attributes:
        s_h: the person's travel over T_r + T_s, until the robot has stopped.
        s_r: the robot's travel over T_r, before it brakes.
        s_s: the robot's braking distance.
        c: intrusion distance.
        z_d: uncertainty of the person's position.
        z_r: uncertainty of the robot's position.
    """

    s_h: float
    s_r: float
    s_s: float
    c: float
    z_d: float
    z_r: float

    @property
    def total(self) -> float:
        """S_p."""
        return self.s_h + self.s_r + self.s_s + self.c + self.z_d + self.z_r


def protective_distance(
    speed_m_s: float,
    reaction_s: float,
    stopping_s: float,
    stopping_m: float,
    *,
    intrusion_m: float = 0.0,
    person_uncertainty_m: float = 0.0,
    robot_uncertainty_m: float = 0.0,
    human_m_s: float = 0.0,
) -> ProtectiveDistance:
    """Return S_p of a robot at ``speed_m_s``, the speed of its fastest point.

    Args:
        speed_m_s: v_r.
        reaction_s: T_r, from the capture until the robot starts to brake.
        stopping_s: T_s, from then until it stops.
        stopping_m: S_s, its travel in T_s.
        intrusion_m: C.
        person_uncertainty_m: Z_d.
        robot_uncertainty_m: Z_r.
        human_m_s: speed of a person faster than the standard assumes; otherwise 0.
    """
    s_r = speed_m_s * reaction_s
    other = s_r + stopping_m + intrusion_m + person_uncertainty_m + robot_uncertainty_m
    s_h = come_m(reaction_s + stopping_s, other, human_m_s)
    return ProtectiveDistance(
        s_h=s_h,
        s_r=s_r,
        s_s=stopping_m,
        c=intrusion_m,
        z_d=person_uncertainty_m,
        z_r=robot_uncertainty_m,
    )


def travel_m(
    times_s: Floats,
    *,
    reaction_s: float,
    speed_m_s: Floats | float,
    stopping_s: Floats | float,
    stopping_m: Floats | float,
) -> Floats:
    """Return the maximum travel of the robot's fastest point by ``times_s``, metres.

    It keeps its speed for ``reaction_s``, then decelerates uniformly over T_s along S_s (or along
    v T_s / 2, if that is longer). Arguments broadcast.
    """
    braking_m = np.maximum(stopping_m, 0.5 * np.multiply(speed_m_s, stopping_s))
    coasting = np.minimum(times_s, reaction_s) * speed_m_s
    part = np.minimum(np.maximum(times_s - reaction_s, 0.0) / np.maximum(stopping_s, 1e-9), 1.0)
    result: Floats = coasting + braking_m * (1.0 - (1.0 - part) ** 2)
    return result


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Demand of one hazard (the people, or the unseen space) on one robot.

    Attributes:
        separation_m: distance now, as captured; negative where bodies overlap.
        predicted_m: smallest distance until the robot has stopped, at its present speed.
        slack_m: distance of the hazard beyond the distance that the present motion requires.
        near: whether the present distance is too small even for a standing robot.
        breach_s: seconds until the separation may be violated; 0 if it is violated.
        limits: for each margin, the highest permitted speed if the hazard were nearer by the
            margin.
        person: index of the deciding person; -1: no person.
        segment: index (in the zones) of the deciding body segment.
        link: index of the deciding robot capsule.
        pair_m: present distance of the deciding segment and link if other pairs are nearer;
            otherwise ``None``.
    """

    separation_m: float
    predicted_m: float
    slack_m: float
    near: bool
    breach_s: float
    limits: tuple[float, ...]
    person: int = -1
    segment: int = -1
    link: int = -1
    pair_m: float | None = None


def closing_s(slack_m: float, speed_m_s: float) -> float:
    """Return the time, s, until ``slack_m`` is used up at full approach speed."""
    return max(0.0, slack_m) / (REACH_SPEED_M_S + speed_m_s)


def worst_of(findings: Sequence[Finding]) -> Finding:
    """Return the finding with the least slack, with the lowest limits of all findings."""
    if len(findings) == 1:
        return findings[0]
    worst = min(findings, key=lambda f: f.slack_m)
    return replace(
        worst,
        near=any(f.near for f in findings),
        breach_s=min(f.breach_s for f in findings),
        limits=tuple(min(each) for each in zip(*(f.limits for f in findings), strict=True)),
    )


def speed_levels(top_m_s: float, above_m_s: float) -> list[float]:
    """Return the speeds to try in a known direction: those above ``above_m_s``."""
    levels = (top_m_s * i / SPEED_LEVELS for i in range(1, SPEED_LEVELS + 1))
    return [level for level in levels if level > above_m_s]


def directed_limit(
    levels_m_s: Sequence[float], distance_m: Floats, needed_m: float, any_way_m_s: float
) -> float:
    """Return the highest speed that is clear with all slower ones, at least ``any_way_m_s``.

    Args:
        levels_m_s: (L,) ascending.
        distance_m: (L,) smallest distance at each speed until the robot stops.
        needed_m: minimum distance for a clear speed.
        any_way_m_s: speed permitted in any direction; speeds up to it need no check.
    """
    limit = any_way_m_s
    for level, distance in zip(levels_m_s, distance_m.tolist(), strict=True):
        if level > any_way_m_s:
            if not distance >= needed_m:
                break
            limit = level
    return limit
