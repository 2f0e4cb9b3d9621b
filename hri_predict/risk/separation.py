"""Separation: what distance a robot needs to people, and how fast it may be at the one it has.

The protective separation distance of ISO/TS 15066:2016 (scitepress 2020/94464, eq. 2) is

    S_p = S_h + S_r + S_s + C + Z_d + Z_r

``separation_now`` judges by it; ``separation_in_time`` asks instead that zone and stopping robot
are C + Z_d + Z_r apart at every moment until the robot has stopped.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from hri_predict.scene import Floats

REACH_SPEED_M_S = 2.0
"""K of ISO 13855:2010 for a separation of up to ``NEAR_M``."""
WALK_SPEED_M_S = 1.6
"""K of ISO 13855:2010 beyond; the separation is then at least ``NEAR_M``."""
NEAR_M = 0.5

SPEED_LEVELS = 4
"""How many speeds in a known direction are tried, evenly up to the robot's highest."""
_SPEED_STEPS = 256
"""A speed limit is one of this many steps up to the robot's highest speed, rounded down."""


@dataclass(frozen=True, slots=True)
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


def person_travel(
    time_s: Floats | float, other_m: Floats | float, human_m_s: float = 0.0
) -> Floats:
    """S_h: how far a person comes in ``time_s``, where S_p's other terms sum to ``other_m``.

    v_h is 2.0 m/s as long as S_p comes to at most 0.5 m; else 1.6 m/s, with S_p at least 0.5 m
    (ISO 13855:2010). The result is continuous and grows with both arguments' sum. Somebody who is
    seen to be faster counts at ``human_m_s``, about which the standard says nothing.
    """
    near = REACH_SPEED_M_S * np.asarray(time_s)
    far = np.maximum(WALK_SPEED_M_S * np.asarray(time_s), NEAR_M - other_m)
    assumed = np.where(near + other_m <= NEAR_M, near, far)
    return np.maximum(assumed, human_m_s * np.asarray(time_s))


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
    """S_p of a robot whose fastest point moves at ``speed_m_s``.

    Args:
        speed_m_s: v_r.
        reaction_s: T_r, from the capture until the robot begins to brake.
        stopping_s: T_s, from then until it stands.
        stopping_m: S_s, its travel in T_s.
        intrusion_m: C.
        person_uncertainty_m: Z_d.
        robot_uncertainty_m: Z_r.
        human_m_s: of a person who is faster than the standard assumes; else 0.
    """
    s_r = speed_m_s * reaction_s
    other = s_r + stopping_m + intrusion_m + person_uncertainty_m + robot_uncertainty_m
    s_h = float(person_travel(reaction_s + stopping_s, other, human_m_s))
    return ProtectiveDistance(
        s_h, s_r, stopping_m, intrusion_m, person_uncertainty_m, robot_uncertainty_m
    )


def speed_limit(
    distance_m: float, reaction_s: float, deceleration_m_s2: float, clearance_m: float
) -> float:
    """Highest speed whose S_p fits into ``distance_m`` at constant deceleration, closed form.

    S_p solved for the speed with T_s = v / a and S_s = v^2 / 2a:
    v_max = sqrt(v_h^2 + (a T_r)^2 + 2a(d - C)) - a T_r - v_h, where C holds Z_d and Z_r too; the
    same expression as in CNR-STIIMA-IRAS/ssm_safety, ``ssm15066.h``. 0 where no speed fits.
    """
    v_h = WALK_SPEED_M_S if distance_m >= NEAR_M - 1e-9 else REACH_SPEED_M_S
    a_t = deceleration_m_s2 * reaction_s
    square = v_h**2 + a_t**2 + 2.0 * deceleration_m_s2 * (distance_m - clearance_m)
    return max(0.0, float(np.sqrt(max(square, 0.0))) - a_t - v_h)


@dataclass(frozen=True, slots=True, eq=False)
class StoppingCurve:
    """Stopping time and distance over speed, tabled so that a speed can be looked up.

    Attributes:
        speed_m_s: (N,) ascending from 0 to the robot's highest speed.
        time_s: (N,) T_s, never falling.
        distance_m: (N,) S_s, never falling.
    """

    speed_m_s: Floats
    time_s: Floats
    distance_m: Floats

    @classmethod
    def of(cls, stopping: Callable[[float], tuple[float, float]], max_speed_m_s: float) -> Self:
        """Table of ``stopping`` (speed -> time, distance), made monotone from below."""
        speeds = np.linspace(0.0, max_speed_m_s, _SPEED_STEPS + 1)
        table = np.array([stopping(float(speed)) for speed in speeds], dtype=np.float64)
        if not (np.isfinite(table).all() and (table >= 0).all()):
            raise ValueError("stopping time and distance must be finite and not negative")
        time_s, distance_m = np.maximum.accumulate(table, axis=0).T
        return cls(speeds, time_s, distance_m)

    @property
    def max_speed_m_s(self) -> float:
        """The highest speed in the table."""
        return float(self.speed_m_s[-1])

    def at(self, speed_m_s: float) -> tuple[float, float]:
        """T_s and S_s at a speed, between the table's speeds by interpolation."""
        time_s = np.interp(speed_m_s, self.speed_m_s, self.time_s)
        return float(time_s), float(np.interp(speed_m_s, self.speed_m_s, self.distance_m))

    def required_m(self, reaction_s: float, clearance_m: float, human_m_s: float = 0.0) -> Floats:
        """(N,) S_p at each speed; ``clearance_m`` is C + Z_d + Z_r."""
        other = self.speed_m_s * reaction_s + self.distance_m + clearance_m
        return other + person_travel(reaction_s + self.time_s, other, human_m_s)

    def speed_limits(self, distances_m: Sequence[float], required_m: Floats) -> tuple[float, ...]:
        """Highest tabled speed whose S_p (N,) fits into each distance; 0 where none does."""
        fits = np.searchsorted(required_m, np.asarray(distances_m), side="right")
        return tuple(float(v) for v in np.where(fits > 0, self.speed_m_s[fits - 1], 0.0))


def travel_m(
    times_s: Floats,
    reaction_s: float,
    speed_m_s: Floats | float,
    stopping_s: Floats | float,
    stopping_m: Floats | float,
) -> Floats:
    """How far the robot's fastest point has come at most by ``times_s``, metres.

    Constant speed for ``reaction_s``, then at most uniform deceleration over T_s along S_s (or
    along v T_s / 2, should that be longer). Arguments broadcast.
    """
    braking_m = np.maximum(stopping_m, 0.5 * np.multiply(speed_m_s, stopping_s))
    coasting = np.minimum(times_s, reaction_s) * speed_m_s
    part = np.minimum(np.maximum(times_s - reaction_s, 0.0) / np.maximum(stopping_s, 1e-9), 1.0)
    result: Floats = coasting + braking_m * (1.0 - (1.0 - part) ** 2)
    return result


@dataclass(frozen=True, slots=True)
class Finding:
    """What one hazard (the people, or what the sensor does not see) asks of one robot.

    Attributes:
        separation_m: distance now, as captured; negative where bodies overlap.
        predicted_m: smallest distance until the robot has stopped, at its present speed.
        slack_m: how much further away the hazard is than the present motion needs.
        near: the present distance is too small even for a robot that stands.
        breach_s: seconds until the separation may be violated, 0 when it is.
        limits: highest permitted speed if the hazard were nearer by each of the margins asked for.
        person: index of the person that decides; -1 for none.
        segment: index (in the zones) of the body segment that decides.
        link: index of the robot capsule that decides.
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


def closing_s(slack_m: float, speed_m_s: float) -> float:
    """Seconds until ``slack_m`` is used up if person and robot close in at their fastest."""
    return max(0.0, slack_m) / (REACH_SPEED_M_S + speed_m_s)


def worst_of(findings: Sequence[Finding]) -> Finding:
    """All findings as one: that with the least slack, with the lowest limits of any."""
    if len(findings) == 1:
        return findings[0]
    worst = min(findings, key=lambda f: f.slack_m)
    return replace(
        worst,
        near=any(f.near for f in findings),
        breach_s=min(f.breach_s for f in findings),
        limits=tuple(min(each) for each in zip(*(f.limits for f in findings), strict=True)),
    )


def speed_levels(top_m_s: float, above_m_s: float) -> Floats:
    """The few speeds in a known direction that are tried: those above ``above_m_s``."""
    levels: Floats = top_m_s * np.arange(1, SPEED_LEVELS + 1) / SPEED_LEVELS
    return levels[levels > above_m_s]


def directed_limit(
    levels_m_s: Floats, distance_m: Floats, needed_m: float, any_way_m_s: float
) -> float:
    """The highest of the speeds up to which each is clear, at least ``any_way_m_s``.

    Args:
        levels_m_s: (L,) ascending.
        distance_m: (L,) smallest distance at each until the robot stands.
        needed_m: what is clear.
        any_way_m_s: what any direction permits; speeds up to it need no look.
    """
    limit = any_way_m_s
    for level, distance in zip(levels_m_s.tolist(), distance_m.tolist(), strict=True):
        if level > any_way_m_s:
            if not distance >= needed_m:
                break
            limit = level
    return limit
