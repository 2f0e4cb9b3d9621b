"""Check that reports of several controllers of one robot, or a state and a plan, are consistent.

There is no common clock, so two positions are compared at one moment, each extrapolated with its
velocities. Correct positions then differ by the unknown delays times the speed, the change of speed
during that time, and noise. This difference is added to the robot's uncertainty; a larger
difference is a contradiction, and it is unknown which report is correct.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.robots.model import RobotModel

NOISE_M = 0.02
"""Noise of encoders and rounding, at a point of the robot far from its joints."""
JITTER_S = 0.02
"""Allowance for the cycles of both senders; the observed jitter is added."""


@dataclass(frozen=True, slots=True, eq=False)
class RobotPlace:
    """Position of a robot at one instant, from one controller or from a plan.

    Attributes:
        q, qd: (N,) rad, m and per second, extrapolated to that moment.
        ahead_s: maximum extrapolation time.
        delay_s: maximum difference between the true and the assumed age.
    """

    q: Floats
    qd: Floats
    ahead_s: float = 0.0
    delay_s: float = 0.0


def apart_m(model: RobotModel, a: RobotPlace, b: RobotPlace) -> float:
    """Return the maximum distance of any robot point between two places, metres: an upper bound to
    first order."""
    off = a.q - b.q
    if model.mobile is not None:  # a full turn of its heading is none
        off[2] = np.remainder(off[2] + np.pi, 2 * np.pi) - np.pi
    return float(model.tip_speed(a.q, off))


def permitted_m(
    model: RobotModel, a: RobotPlace, b: RobotPlace, *, speed_m_s: float, acceleration_m_s2: float
) -> float:
    """Return the maximum distance between two places if both are true, metres.

    Args:
        model: the robot.
        a, b: the positions.
        speed_m_s: speed of the robot's fastest point, the higher of the two.
        acceleration_m_s2: maximum acceleration of that point.
    """
    delay_s = JITTER_S + a.delay_s + b.delay_s
    since_s = delay_s + max(a.ahead_s, b.ahead_s)
    off_m = 0.0 if model.mobile is None else 2 * model.mobile.uncertainty_m
    return NOISE_M + off_m + speed_m_s * delay_s + acceleration_m_s2 * since_s**2 / 2
