"""Separation judged time by time until the robot has stopped: modes ``predictive``, ``reactive``.

At every moment zone and stopping robot are C + Z_d + Z_r apart; how far people and robot move is in
the zones and in the stopping robot already.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.risk.nearest_in_time import NearestInTime
from hri_predict.risk.separation import (
    Finding,
    StoppingCurve,
    closing_s,
    directed_limit,
    speed_levels,
    travel_m,
)
from hri_predict.scene import Floats


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """One hazard's distances over the zones' steps after now. K steps.

    Attributes:
        separation_m: distance now, as captured.
        standing: to the robot where it is now.
        at_speeds: (L,) speeds and (L,) distances -> (L,) to the robot as it moves on at each, along
            its plan or in its present direction, until it has stopped: the smallest, or the given
            distance if that is smaller. ``None`` where the direction means nothing, so that any may
            come.
    """

    separation_m: float
    standing: NearestInTime
    at_speeds: Callable[[Floats, Floats], NearestInTime] | None = None


_NEVER_M = 1e9
"""Stands for infinity where a distance that is minus infinity must stay so."""


@dataclass(frozen=True, slots=True, eq=False)
class AnyWay:
    """What a robot may do in any direction, and what is to be tried in its present one.

    Attributes:
        limits: highest speed by margin.
        spare_m: what is left beyond the clearance if it stands where it is.
        speeds_m_s: (L,) the present speed and those above the limits; none where any direction
            permits enough.
        enough_m: (L,) a distance above it need not be known.
    """

    limits: tuple[float, ...]
    spare_m: float
    speeds_m_s: Floats
    enough_m: Floats


@dataclass(frozen=True, slots=True, eq=False)
class TimeByTime:
    """Judges zones against one stopping robot, time by time, in two steps.

    First the robot may move in *any* direction: a bound from its distance where it is now and how
    far it can come. Where that permits its highest speed nothing more is asked, and the figures
    are of that bound. Else it moves on along its plan or in its *present* direction, and the speed
    limit is the larger of what any direction permits and the highest of ``SPEED_LEVELS`` speeds up
    to which every one is clear: each distance is the smallest of every link and person, so that a
    robot may go faster only if no link comes too near to anybody. (A faster robot may be past a
    person whom a slower one would meet: hence every one.)

    Attributes:
        times_s: (K+1,) as in ``Zones``; a course's steps are 1..K of it.
        speed_m_s: of the robot's fastest point now.
        stopping: T_s and S_s at that speed.
        curve: the robot's stopping curve.
        reaction_s: from *now* until the robot begins to brake.
        clearance_m: C + Z_d + Z_r.
        margins_m: for the limits, each counted on top of the clearance. The first two regard the
            present direction; the others, which only warn, any.
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

    def judged(self, course: Course) -> Finding:
        """Both steps, of one course."""
        any_way = self.any_way(course.standing, course.at_speeds is not None)
        ahead = None
        if course.at_speeds is not None and len(any_way.speeds_m_s):
            ahead = course.at_speeds(any_way.speeds_m_s, any_way.enough_m)
        return self.finding(course.separation_m, course.standing, any_way, ahead)

    def any_way(self, standing: NearestInTime, is_foreseen: bool) -> AnyWay:
        """What the distances to the robot where it is now permit, whichever way it goes.

        Args:
            standing: (K,) of the steps after now.
            is_foreseen: whether it is known which way it goes on.
        """
        curve, top = self.curve, self.curve.max_speed_m_s
        left = (standing.distance[:, None] - self.farthest_m).min(0)
        any_way = np.minimum.accumulate(left) - self.clearance_m  # (N,) falls with speed
        fits = np.searchsorted(-any_way, -np.asarray(self.margins_m), side="right")
        limits = tuple(float(curve.speed_m_s[f - 1]) if f > 0 else 0.0 for f in fits)
        free = min(limits[:2]) >= top and self.speed_m_s <= top
        spare_m = float(any_way[0])
        if free or not is_foreseen:
            return AnyWay(limits, spare_m, np.empty(0), np.empty(0))
        # Where it may not even stand there is nothing to try but the present speed.
        levels = speed_levels(top, min(limits[:2])) if spare_m >= 0 else np.empty(0)
        enough = np.full(1 + len(levels), self.clearance_m + max(self.margins_m[:2]))
        enough[0] = np.inf
        return AnyWay(limits, spare_m, np.append(self.speed_m_s, levels), enough)

    def finding(
        self,
        separation_m: float,
        standing: NearestInTime,
        any_way: AnyWay,
        ahead: NearestInTime | None,
    ) -> Finding:
        """What follows.

        Args:
            separation_m: distance now, as captured.
            standing, any_way: as for and from ``any_way``.
            ahead: (L,) what was found at its speeds; ``None`` where there are none.
        """
        limits = list(any_way.limits)
        if ahead is None:
            nearest = standing
            begins, ends = self.times_s[:-1], self.times_s[1:]
            travel = travel_m(ends, self.reaction_s, self.speed_m_s, *self.stopping)
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
                        any_way.speeds_m_s[1:],
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
    """(K, N) how far the fastest point comes by the end of each step, at each of its speeds.

    Steps that begin when it stands again do not count: minus ``_NEVER_M``.
    """
    begins, ends = times_s[:-1, None], times_s[1:, None]
    travel = travel_m(ends, reaction_s, curve.speed_m_s, curve.time_s, curve.distance_m)
    return np.where(begins <= reaction_s + curve.time_s, travel, -_NEVER_M)
