"""A robot that hardly moves has no direction: noise of its velocities permits nothing."""

import numpy as np
import pytest

from hri_predict.robots.motion import DIRECTED_M_S
from hri_predict.robots.tracker import RobotNow
from tests.hri_predict.risk.separation.test_modes import CELLS, MODEL, READY, spheres


def creeping(speed_m_s, sign):
    qd = np.array([sign * 0.1, 0, 0, 0, 0, 0])
    qd *= speed_m_s / float(MODEL.tip_speed(READY, qd))
    return RobotNow(q=READY, qd=qd, speed_m_s=speed_m_s)


@pytest.mark.parametrize("mode", ["iso", "predictive"])
def test_only_a_speed_beyond_noise_is_a_direction(mode):
    cell = CELLS[mode]
    differs = {0.03: 0, 2 * DIRECTED_M_S: 0}
    for y in np.arange(-2.0, 2.1, 0.25):
        bodies = spheres((0.6, y, 0.6))
        for speed in differs:
            there, back = (cell.people(creeping(speed, s), bodies).limits for s in (1, -1))
            differs[speed] += there != back
    assert differs[0.03] == 0
    assert mode == "iso" or differs[2 * DIRECTED_M_S] > 0
