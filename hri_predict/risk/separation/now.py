"""Separation at the present positions of body and robot: modes ``iso`` and ``fixed``."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import Capsules, horizontal_distance
from hri_predict.risk import permitted
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.nearest import NearestInTime, nearest_in_time
from hri_predict.risk.separation.receding import receding_steps
from hri_predict.risk.terms import (
    Finding,
    closing_s,
    directed_limit,
    protective_distance,
    speed_levels,
    worst_of,
)
from hri_predict.robots.motion import RobotMotion
from hri_predict.robots.stopping import StoppingCurve
from hri_predict.zones.body_zones import BodyZones


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Braking:
    """Data on how one robot stops.

    Attributes:
        speed_m_s: present speed of its fastest point.
        stopping: T_s and S_s at that speed.
        curve: its stopping curve.
        reaction_s: T_r from the capture.
        clearance_m: C + Z_d + Z_r.
        margins_m: margins for the limits.
    """

    speed_m_s: float
    stopping: tuple[float, float]
    curve: StoppingCurve
    reaction_s: float
    clearance_m: float
    margins_m: Sequence[float]

    @classmethod
    def of(cls, robot: RobotConstants, motion: RobotMotion, age_s: float) -> "Braking":
        """Return the stopping data of a moving robot, starting at the capture."""
        return cls(
            speed_m_s=motion.speed_m_s,
            stopping=(motion.stopping_s, motion.stopping_m),
            curve=robot.curve,
            reaction_s=robot.reaction_s(age_s),
            clearance_m=motion.clearance_m,
            margins_m=robot.risk.margins_m,
        )


def judge_iso(
    robot: Braking,
    distance_m: float,
    *,
    who: tuple[int, int, int] = (-1, -1, -1),
    human_m_s: float = 0.0,
) -> Finding:
    """Compare one distance with the protective separation distance.

    Args:
        robot: how the robot would stop.
        distance_m: distance between body as captured and robot now.
        who: person, segment and robot capsule of that distance.
        human_m_s: speed of a person who is faster than the standard assumes; else 0.
    """
    needed = protective_distance(
        robot.speed_m_s,
        robot.reaction_s,
        *robot.stopping,
        intrusion_m=robot.clearance_m,
        human_m_s=human_m_s,
    ).total
    slack = distance_m - needed
    at_rest_m, fits = permitted.by_standard(
        robot.curve.arrays,
        robot.reaction_s,
        (robot.clearance_m, float(human_m_s)),
        distance_m - np.array(robot.margins_m, np.float64),
    )
    return Finding(
        separation_m=distance_m,
        predicted_m=distance_m - (needed - robot.clearance_m),
        slack_m=slack,
        near=distance_m < at_rest_m,
        breach_s=closing_s(slack, robot.speed_m_s),
        limits=robot.curve.highest(fits),
        person=who[0],
        segment=who[1],
        link=who[2],
    )


def judge_receding(
    robot: Braking, found: Finding, recedes: Callable[[Floats], Bools], human_m_s: float
) -> Finding:
    """Limit a robot that recedes from all people only by the motion of the people.

    If every link's distance to every person increases until the robot stops, the robot does not
    move towards a person: S_r and S_s are 0, and only S_h + C + Z_d + Z_r is required. As in
    ``TimeByTime``, a speed is permitted only if every slower speed is permitted, and warnings
    assume any direction.

    Args:
        robot, human_m_s: as for ``judge_iso``.
        found: result of ``judge_iso``.
        recedes: (L,) speeds -> (L,) whether the robot keeps receding until it stops.
    """
    curve, clearance_m = robot.curve, robot.clearance_m
    levels = speed_levels(curve.max_speed_m_s, min(found.limits[:2]))
    away = recedes(np.array([robot.speed_m_s, *levels]))
    if not away.any():
        return found
    later_s = np.append(robot.stopping[0], np.interp(levels, curve.speed_m_s, curve.time_s))
    come = permitted.person_travel(robot.reaction_s + later_s, clearance_m, human_m_s)
    left = np.where(away, found.separation_m - come, -np.inf)
    limits = [
        directed_limit(levels, left[1:], clearance_m + margin, limit)
        for margin, limit in zip(robot.margins_m[:2], found.limits[:2], strict=True)
    ]
    result = replace(found, limits=(*limits, *found.limits[2:]))
    if not away[0]:
        return result
    slack = float(left[0]) - clearance_m
    breach_s = closing_s(slack, robot.speed_m_s)
    return replace(result, predicted_m=float(left[0]), slack_m=slack, breach_s=breach_s)


def judge_fixed(
    *,
    found: Finding,
    from_base_m: float,
    radius_m: float,
    max_speed_m_s: float,
    margins_m: Sequence[float],
    speed_m_s: float,
) -> Finding:
    """Check a circle around the robot's base: stop if a person is inside, otherwise full speed.

    Args:
        found: the separation from ``judge_iso``; its distances are kept.
        from_base_m: horizontal distance of the nearest body's surface from the base's axis.
        radius_m: radius of the circle.
        max_speed_m_s: the robot's highest speed.
        margins_m: margins for the limits. The first one is the circle's edge, because mode
            ``fixed`` has no slow speed.
        speed_m_s: present speed of the robot's fastest point.
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


# -- one robot and everybody -----------------------------------------------------------------------


def by_standard(
    robot: RobotConstants,
    motion: RobotMotion,
    bodies: BodyZones,
    *,
    who: Ints | None = None,
    standing: NearestInTime | None = None,
    by_motion: bool = True,
) -> Finding:
    """Apply the protective separation distance to all people, and to each fast person alone.

    For a fast person, only the fast segments are checked separately, at their own speed. A person
    of unknown speed is treated as fast in all segments.

    Args:
        robot, motion: the robot and how it moves.
        bodies: the people.
        who: indices of the people to consider, at least one; ``None``: all people.
        standing: the distances of the zones over time to the robot at its present position, if all
            people are considered; ``None``: unknown.
        by_motion: whether to check for a receding robot; zones over time already take its motion
            into account.
    """
    groups: list[tuple[Ints | None, Ints | None, float]] = [(who, None, 0.0)]
    beyond_m_s = bodies.speeds.beyond_standard_m_s
    for person, human_m_s in enumerate(beyond_m_s.max(1, initial=0.0).tolist()):
        if human_m_s > 0 and (who is None or person in who):
            segments = np.flatnonzero(beyond_m_s[person] > 0)
            groups.append((np.array([person]), segments, human_m_s))
    found, braking = [], Braking.of(robot, motion, bodies.age_s)
    for people, some, human_m_s in groups:
        near = standing
        if near is None or human_m_s > 0:
            near = _nearest_now(bodies.zones.capsules, motion, people, some)
        alone = judge_iso(
            braking,
            float(near.distance[0]),
            who=(int(near.person[0]), int(near.segment[0]), int(near.link[0])),
            human_m_s=human_m_s,
        )
        if by_motion:
            alone = _receding(robot, motion, bodies, alone, human_m_s=human_m_s)
        found.append(alone)
    return worst_of(found)


def wherever_it_is(robot: RobotConstants, motion: RobotMotion, bodies: BodyZones) -> Finding:
    """Check all positions that the robot can reach, because its reported position may be wrong.

    Around a standing base, this is the circle of mode ``fixed``. A moving base may be anywhere.
    """
    radius_m = robot.anywhere_m if motion.model.mobile is None else math.inf
    return by_circle(robot, motion, bodies, radius_m)


def by_circle(
    robot: RobotConstants, motion: RobotMotion, bodies: BodyZones, radius_m: float | None = None
) -> Finding:
    """Check the circle around the base for the nearest person.

    The circle is wider for fast people, and if a body was captured longer ago than ``stale_s``: the
    newest scenes lacked it, but it is not lost yet. The circle moves with a moving base. With
    tools, the worst case is used. ``radius_m``: default: the radius of mode ``fixed``.
    """
    zones = bodies.zones.capsules
    human_m_s = bodies.speeds.beyond_standard_m_s.max(1, initial=0.0)
    near = _nearest_now(zones, motion)
    who = int(near.person[0]), int(near.segment[0]), int(near.link[0])
    braking = Braking.of(robot, motion, bodies.age_s)
    found = judge_iso(braking, float(near.distance[0]), who=who)
    now = zones[:, 0]
    from_base = horizontal_distance(now, motion.model.base_at(motion.q))  # (P, S)
    if motion.model.mobile is not None:  # where the circle is, is uncertain, too
        from_base -= motion.clearance_m - robot.risk.clearance_m
    late_s = max(bodies.age_s - robot.budget.stale_s, 0.0)
    worst_m = robot.needed_m()
    late_m = robot.needed_m(0.0, late_s) - worst_m if late_s > 0 else 0.0
    wider_m = [robot.needed_m(float(v), late_s) - worst_m if v > 0 else late_m for v in human_m_s]
    from_base[: len(human_m_s)] -= np.array(wider_m)[:, None]
    person, segment = np.unravel_index(int(from_base.argmin()), from_base.shape)
    return judge_fixed(
        found=replace(found, person=int(person), segment=int(segment), link=0),
        from_base_m=float(from_base[person, segment]),
        radius_m=robot.fixed_radius_m if radius_m is None else radius_m,
        max_speed_m_s=robot.max_speed_m_s,
        margins_m=robot.risk.margins_m,
        speed_m_s=motion.speed_m_s,
    )


def _receding(
    robot: RobotConstants,
    motion: RobotMotion,
    bodies: BodyZones,
    found: Finding,
    *,
    human_m_s: float,
) -> Finding:
    """Return the finding, improved if the robot recedes from all people until it stops."""
    is_free = found.slack_m >= 0 and min(found.limits[:2]) >= robot.max_speed_m_s
    if is_free or not motion.is_foreseen or not motion.is_one_path:
        return found
    people = bodies.captured

    def recedes(speeds_m_s: Floats) -> Bools:
        ends = motion.ends_at(speeds_m_s)
        farthest_end = float(ends.max())
        steps = receding_steps(people, motion.at_places(farthest_end, len(motion.times_s)))
        part = steps / (len(motion.times_s) - 1)
        until = motion.place + part * (farthest_end - motion.place)
        return ends <= until + 1e-12

    return judge_receding(Braking.of(robot, motion, bodies.age_s), found, recedes, human_m_s)


def _nearest_now(
    zones: Capsules, motion: RobotMotion, who: Ints | None = None, segments: Ints | None = None
) -> NearestInTime:
    """Return the nearest pair of people and robot as captured.

    Args:
        zones: (P, K+1, S).
        motion: the robot's motion.
        who, segments: indices of the people and segments to consider; ``None``: all.
    """
    persons, _, count = zones.radius.shape
    who = np.arange(persons) if who is None else who
    segments = np.arange(count) if segments is None else segments
    some = np.ix_(who, np.zeros(1, np.intp), segments)
    robot = motion.capsules
    near = nearest_in_time(
        zones[some],
        robot[None],
    )
    return replace(near, person=who[near.person], segment=segments[near.segment])
