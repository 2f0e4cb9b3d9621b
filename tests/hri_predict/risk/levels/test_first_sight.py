"""Somebody of unknown speed appears: the robot slows at once, and goes on when it is known."""

import pytest

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.machine import LevelMachine
from hri_predict.risk.settings import RiskSettings
from tests.hri_predict.risk.demands import asks

MS = 1_000_000
FREE = Demand.nothing(1.0)
CAPTURES = RiskSettings().release_captures


def stop(reason):
    return asks(Level.STOP, 0.0, reason)


def slow(limit, release=None):
    return asks(Level.SLOW, limit, release_limit_m_s=limit if release is None else release)


class Robot:
    """One robot's machine at full speed, a capture at each tick."""

    def __init__(self, **settings):
        self.machine = LevelMachine(RiskSettings(**settings), 1.0, lambda: 1)
        self.captures = 0
        for _ in range(200):
            self.see(FREE)

    def see(self, demand, times=1):
        for _ in range(times):
            self.captures += 1
            advised = self.machine.update(demand, self.captures, self.captures * 40 * MS)
        return advised


UNKNOWN, NEAR = stop(Reason.SPEED_UNKNOWN), stop(Reason.PERSON_NEAR)


@pytest.mark.parametrize("known", [FREE, slow(0.6)])
def test_what_was_advised_holds_again_as_soon_as_the_speed_is_known(known):
    robot = Robot()
    assert robot.see(UNKNOWN, 3).level is Level.STOP
    advised = robot.see(known)
    assert advised.level is known.level
    assert advised.limit_m_s == known.limit_m_s


def test_no_more_than_the_demand_with_its_band_permits():
    robot = Robot()
    robot.see(UNKNOWN, 3)
    assert robot.see(slow(0.6, release=0.4)).limit_m_s == pytest.approx(0.4)
    assert robot.see(NEAR).level is Level.STOP


def test_a_stop_that_was_there_before_stays():
    robot = Robot()
    robot.see(NEAR, 20)
    robot.see(UNKNOWN, 3)
    assert robot.see(FREE, CAPTURES - 1).level is Level.STOP


def test_a_speed_that_is_unknown_for_long_or_again_is_released_like_everything_else():
    robot = Robot()
    robot.see(UNKNOWN, CAPTURES + 1)
    assert robot.see(FREE).level is Level.STOP
    robot = Robot()
    robot.see(UNKNOWN, 2)
    assert robot.see(FREE).level is Level.CLEAR
    robot.see(UNKNOWN, 2)
    assert robot.see(FREE).level is Level.STOP


def test_a_latched_stop_stays():
    robot = Robot(latch=["stop"])
    robot.machine.acknowledge(1)
    robot.see(FREE, 200)
    robot.see(UNKNOWN, 2)
    assert robot.see(FREE, 100).level is Level.STOP
