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


def judge_in_time(
    course: Course,
    times_s: Floats,
    speed_m_s: float,
    stopping: tuple[float, float],
    curve: StoppingCurve,
    reaction_s: float,
    clearance_m: float,
    margins_m: Sequence[float],
    farthest_m: Floats | None = None,
) -> Finding:
    """Judge zones against the stopping robot, time by time.

    First the robot may move in *any* direction: a bound from its distance where it is now and how
    far it can come. Where that permits its highest speed nothing more is asked, and the figures
    are of that bound. Else it moves on along its plan or in its *present* direction, and the speed
    limit is the larger of what any direction permits and the highest of ``SPEED_LEVELS`` speeds up
    to which every one is clear: each distance is the smallest of every link and person, so that a
    robot may go faster only if no link comes too near to anybody. (A faster robot may be past a
    person whom a slower one would meet: hence every one.)

    Args:
        course: the hazard's distances.
        times_s: (K+1,) as in ``Zones``; the course's steps are 1..K of it.
        speed_m_s: of the robot's fastest point now.
        stopping: T_s and S_s at that speed.
        curve: the robot's stopping curve.
        reaction_s: from *now* until the robot begins to brake.
        clearance_m: C + Z_d + Z_r.
        margins_m: for the limits, each counted on top of the clearance. The first two regard the
            present direction; the others, which only warn, any.
        farthest_m: ``farthest(curve, times_s, reaction_s)``, where it is known already.
    """
    begins, ends = times_s[:-1], times_s[1:]
    top = curve.max_speed_m_s
    if farthest_m is None:
        farthest_m = farthest(curve, times_s, reaction_s)
    left = (course.standing.distance[:, None] - farthest_m).min(0)
    any_way = np.minimum.accumulate(left) - clearance_m  # (N,) falls with speed
    fits = np.searchsorted(-any_way, -np.asarray(margins_m), side="right")
    limits = [float(curve.speed_m_s[f - 1]) if f > 0 else 0.0 for f in fits]

    if course.at_speeds is None or (min(limits[:2]) >= top and speed_m_s <= top):
        nearest = course.standing
        then = nearest.distance - travel_m(ends, reaction_s, speed_m_s, *stopping)
        then = np.where(begins <= reaction_s + stopping[0], then, np.inf)
        which = int(then.argmin())
        predicted_m = float(then[which])
    else:
        # Where it may not even stand there is nothing to try but the present speed.
        levels = speed_levels(top, min(limits[:2])) if any_way[0] >= 0 else np.empty(0)
        needed = clearance_m + np.asarray(margins_m[:2])
        enough = np.full(len(levels), needed.max())
        nearest = course.at_speeds(np.append(speed_m_s, levels), np.append(np.inf, enough))
        which = 0
        predicted_m = float(nearest.distance[0])
        for i in range(len(needed)):
            if fits[i] > 0:
                limits[i] = directed_limit(
                    levels, nearest.distance[1:], float(needed[i]), limits[i]
                )
    slack = predicted_m - clearance_m
    return Finding(
        separation_m=course.separation_m,
        predicted_m=predicted_m,
        slack_m=slack,
        near=bool(any_way[0] < 0),
        breach_s=closing_s(slack, speed_m_s),
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
