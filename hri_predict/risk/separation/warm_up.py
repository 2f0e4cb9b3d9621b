"""Call every compiled loop once, so that none is compiled while robots move."""

from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.risk import permitted
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.nearest import BodiesInTime, Courses
from hri_predict.robots.plan import OnPlan

_SPEED_M_S = 0.1


def warm_up(robots: Sequence[RobotConstants], times_s: Floats) -> None:
    """Assess a point-like person near slow robots, to compile the loops; the result is not used.

    Args:
        robots: the robots with the worst case of their tools; arrays of single tools have the same
            types.
        times_s: (K+1,) times of the zones.
    """
    point = np.zeros((1, len(times_s), 1, 3))
    bodies = BodiesInTime(Capsules(point, point.copy(), np.zeros(point.shape[:3])))
    for robot in robots:
        model, reaction_s = robot.model, robot.until_braking_s
        q, speeds = np.zeros(model.dof), np.array([_SPEED_M_S])
        now, _ = model.moving(q, q)
        bodies.standing([now], [len(times_s)])
        ways = [
            model.stopping_capsules(
                q,
                q,
                times_s=times_s,
                reaction_s=reaction_s,
                stopping_s=speeds,
                scale=speeds,
                speed_m_s=_SPEED_M_S,
            )
        ]
        if robot.plan is not None:
            start = OnPlan(0.0, 1.0)
            ways += [robot.plan.stopping_capsules(start, speeds, times_s, reaction_s)[0]]
        bodies.least([Courses(way, np.ones(1, np.int64), np.array([np.inf])) for way in ways])
        curve = robot.curve.arrays
        farthest = np.zeros((len(times_s), len(curve[0])))
        permitted.any_way(np.zeros(len(times_s)), farthest, 0.0, np.zeros(4))
        permitted.by_standard(curve, reaction_s, (0.0, 0.0), np.zeros(4))
