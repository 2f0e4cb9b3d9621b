"""Separation at each time until the robot has stopped: modes ``predictive`` and ``reactive``.

Zone and stopping robot must be C + Z_d + Z_r apart at every moment. Both already include the motion
of people and robot.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.machine.compiled import plain
from hri_predict.risk import permitted
from hri_predict.risk.separation.nearest import NearestInTime
from hri_predict.risk.terms import Finding, closing_s, directed_limit, speed_levels, travel_m
from hri_predict.robots.stopping import StoppingCurve


@dataclass(frozen=True, slots=True, eq=False)
class DistanceCourse:
    """Distances of one hazard during the zones' K steps after now.

    Attributes:
        separation_m: distance now, as captured.
        standing: (K,) distances to the robot at its present position.
        at_speeds: (L,) speeds and (L,) distances -> (L,) smallest distance to the robot while it
            continues at each speed, along its plan or in its present direction, until it has
            stopped; or the given distance if smaller. ``None`` if the direction is unknown.
    """

    separation_m: float
    standing: NearestInTime
    at_speeds: Callable[[Floats, Floats], NearestInTime] | None = None


_NEVER_M = 1e9
"""Used instead of infinity, so that a distance of minus infinity is preserved."""


@dataclass(frozen=True, slots=True, eq=False)
class AnyWay:
    """Speed permitted in any direction, and the speeds to try in the robot's present direction.

    Attributes:
        limits: highest speed by margin.
        spare_m: distance beyond the clearance if the robot stays where it is.
        speeds_m_s: (L,) the present speed and those above the limits; empty if any direction
            permits enough.
        enough_m: (L,) distances that are sufficient; larger ones need not be computed.
    """

    limits: tuple[float, ...]
    spare_m: float
    speeds_m_s: Floats
    enough_m: Floats


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TimeByTime:
    """Compares zones with one stopping robot at each time, in two steps.

    First, the robot may move in *any* direction: the bound follows from its present distance and
    its maximum travel. If this permits its highest speed, the result is this bound. Otherwise the
    robot continues along its plan or in its *present* direction. The speed limit is then the larger
    of two values: the speed permitted in any direction, and the highest of ``SPEED_LEVELS`` speeds
    that is clear together with all slower ones. (A faster robot may pass a person before a slower
    robot would reach that person, so all slower speeds must be clear.) Each distance is the minimum
    over all links and people: a robot may be faster only if no link comes too close to a person.

    Attributes:
        times_s: (K+1,) as in ``Zones``; a course's steps are 1..K of these times.
        speed_m_s: present speed of the robot's fastest point.
        stopping: T_s and S_s at that speed.
        curve: the robot's stopping curve.
        reaction_s: time from *now* until the robot starts to brake.
        clearance_m: C + Z_d + Z_r.
        margins_m: margins for the limits, added to the clearance. The first two apply to the
            present direction; the others are for warnings only and apply to any direction.
        farthest_m: ``farthest(curve, times_s, reaction_s)``.
    """

    times_s: Floats
    speed_m_s: float
    stopping: tuple[float, float]
    curve: StoppingCurve
    reaction_s: float
    clearance_m: float
    margins_m: Sequence[float]
    farthest_m: Floats

    def judged(self, course: DistanceCourse) -> Finding:
        """Run both steps for one course."""
        any_way = self.any_way(course.standing, course.at_speeds is not None)
        ahead = None
        if course.at_speeds is not None and len(any_way.speeds_m_s):
            ahead = course.at_speeds(any_way.speeds_m_s, any_way.enough_m)
        return self.finding(course.separation_m, course.standing, any_way, ahead)

    def any_way(self, standing: NearestInTime, is_foreseen: bool) -> AnyWay:
        """Return the speed permitted in any direction by the distances to the robot's present
        position.

        Args:
            standing: (K,) distances for the steps after now.
            is_foreseen: whether the robot's direction is known.
        """
        top, reserve_m = self.curve.max_speed_m_s, self.clearance_m + max(self.margins_m[:2])
        spare_m, fits = permitted.any_way(
            plain(standing.distance),
            plain(self.farthest_m),
            self.clearance_m,
            np.array(self.margins_m, np.float64),
        )
        limits = self.curve.highest(fits)
        free = min(limits[:2]) >= top and self.speed_m_s <= top
        if free or not is_foreseen:
            return AnyWay(limits, spare_m, np.empty(0), np.empty(0))
        # If it may not even stand there, only the present speed is tried.
        levels = speed_levels(top, min(limits[:2])) if spare_m >= 0 else []
        speeds = np.array([self.speed_m_s, *levels])
        enough = np.full(len(speeds), reserve_m)
        enough[0] = np.inf
        return AnyWay(limits, spare_m, speeds, enough)

    def finding(
        self,
        separation_m: float,
        standing: NearestInTime,
        any_way: AnyWay,
        ahead: NearestInTime | None,
    ) -> Finding:
        """The finding.

        Args:
            separation_m: distance now, as captured.
            standing, any_way: argument and result of the method ``any_way``.
            ahead: (L,) distances at its speeds; ``None`` without speeds.
        """
        limits = list(any_way.limits)
        if ahead is None:
            nearest = standing
            begins, ends = self.times_s[:-1], self.times_s[1:]
            travel = travel_m(
                ends,
                reaction_s=self.reaction_s,
                speed_m_s=self.speed_m_s,
                stopping_s=self.stopping[0],
                stopping_m=self.stopping[1],
            )
            stands_s = self.reaction_s + self.stopping[0]
            then = np.where(begins <= stands_s, nearest.distance - travel, np.inf)
            which = int(then.argmin())
            predicted_m = float(then[which])
        else:
            nearest, which = ahead, 0
            predicted_m = float(nearest.distance[0])
            for i, margin in enumerate(self.margins_m[:2]):
                if any_way.spare_m >= margin:
                    limits[i] = directed_limit(
                        any_way.speeds_m_s[1:].tolist(),
                        nearest.distance[1:],
                        self.clearance_m + margin,
                        limits[i],
                    )
        slack = predicted_m - self.clearance_m
        return Finding(
            separation_m=separation_m,
            predicted_m=predicted_m,
            slack_m=slack,
            near=any_way.spare_m < 0,
            breach_s=closing_s(slack, self.speed_m_s),
            limits=tuple(limits),
            person=int(nearest.person[which]),
            segment=int(nearest.segment[which]),
            link=int(nearest.link[which]),
        )


def farthest(curve: StoppingCurve, times_s: Floats, reaction_s: float) -> Floats:
    """(K, N) how far the fastest point gets by the end of each step, at each of the curve's speeds.

    For steps that start after the robot has stopped: minus ``_NEVER_M``.
    """
    begins, ends = times_s[:-1, None], times_s[1:, None]
    travel = travel_m(
        ends,
        reaction_s=reaction_s,
        speed_m_s=curve.speed_m_s,
        stopping_s=curve.time_s,
        stopping_m=curve.distance_m,
    )
    return np.where(begins <= reaction_s + curve.time_s, travel, -_NEVER_M)
