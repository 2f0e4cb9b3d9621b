"""Unseen space: a person may stand just outside the sensor's field of view and enter it."""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.risk.areas import FieldOfView, approach_m
from hri_predict.risk.robot_constants import RobotConstants
from hri_predict.risk.separation.in_time import DistanceCourse, TimeByTime
from hri_predict.risk.separation.nearest import NearestInTime
from hri_predict.risk.separation.now import Braking, judge_iso
from hri_predict.risk.terms import Finding
from hri_predict.robots.motion import RobotMotion


def beside_view(
    robot: RobotConstants,
    motion: RobotMotion,
    view: FieldOfView,
    *,
    age_s: float,
    judging: TimeByTime | None = None,
    margin_m: float = 0.0,
) -> Finding:
    """Return the finding for a person who may have been just outside the view since the capture.

    Args:
        robot, motion: the robot and how it moves.
        view: space that the sensor sees.
        age_s: age of that capture.
        judging: check of distances over time; ``None``: use only the present distance.
        margin_m: required distance beyond C + Z_d + Z_r.
    """
    distance_m = float(view.distance_outside(motion.capsules).min()) - margin_m
    if judging is None:
        return judge_iso(Braking.of(robot, motion, age_s), distance_m)
    come_m = approach_m(motion.times_s[1:] + age_s)
    come_ahead_m = come_m + margin_m

    def at_speeds(speeds_m_s: Floats, enough_m: Floats) -> NearestInTime:
        capsules, until = motion.stopping_at(speeds_m_s)
        outside = view.distance_outside(capsules).min(-1)[:, 1:] - come_ahead_m
        counts = np.arange(1, len(come_m) + 1) <= until[:, None]
        return _nobody(np.minimum(np.where(counts, outside, np.inf).min(1), enough_m))

    ahead = at_speeds if motion.is_foreseen else None
    return judging.judged(DistanceCourse(distance_m, _nobody(distance_m - come_m), ahead))


def _nobody(distance_m: Floats) -> NearestInTime:
    """Return distances that belong to no specific person."""
    unknown = np.full(len(distance_m), -1)
    return NearestInTime(distance_m, unknown, unknown, unknown)
