"""A robot that may move and never does: whoever is within its reach stops it until it moves."""

from typing import Any

import pytest

from hri_predict.protocol.messages import Level, OperatingMode
from hri_predict.protocol.reasons import Reason
from hri_predict.robots.model import RobotSettings
from tests.hri_predict.risk.engine_cell import READY, ROBOT, SETTINGS, TICK_NS, Cell
from tests.hri_predict.robots import mobile

FROZEN = Reason.ROBOT_STATE_FROZEN
STILL_S = 2.0
TICKS = round(STILL_S * 1e9 / TICK_NS)
NEAR_M, FAR_M = 1.7, 6.0
"""Within the reach of 1.0 m and S_p of 1.4 m, and beyond; at both the robot may move."""
BY_PLACE = pytest.mark.parametrize("mode", ["iso", "predictive", "reactive"])
"""Modes that judge people by where the robot is."""
MOVED = (0.1, *READY[1:])


def cell(mode: str, still_s: float | None = STILL_S, **more: Any) -> Cell:
    motion: dict[str, Any] = {"kind": "state", "still_s": still_s, **more.pop("motion", {})}
    data = ROBOT.model_dump(exclude_unset=True) | {"motion": motion, **more}
    risk = SETTINGS.model_copy(update={"mode": mode})
    return Cell(risk, robot=RobotSettings.model_validate(data))


@BY_PLACE
def test_a_person_within_its_reach_stops_it(mode: str) -> None:
    frozen, plain = cell(mode), cell(mode, still_s=None)
    for _ in range(TICKS):
        advice = frozen.step(NEAR_M)
        assert advice.level is plain.step(NEAR_M).level
    assert advice.level is Level.SLOW
    advice = frozen.settle(NEAR_M, ticks=30)
    assert (advice.level, advice.reason, advice.speed_limit_m_s) == (Level.STOP, FROZEN, 0.0)
    assert plain.settle(NEAR_M, ticks=30).level is Level.SLOW
    assert (
        "RobotState has not changed for 2 s during which the robot was free to move"
        in advice.detail
    )
    assert "a joint's position changes, or all people are over" in advice.detail


@BY_PLACE
def test_it_may_start_once_everybody_has_stepped_back_and_is_believed_again(mode: str) -> None:
    robot = cell(mode)
    assert robot.settle(NEAR_M, ticks=TICKS + 30).level is Level.STOP
    assert robot.settle(FAR_M).level is Level.CLEAR
    assert robot.settle(NEAR_M).reason is FROZEN
    robot.positions = MOVED
    assert robot.settle(NEAR_M, ticks=TICKS // 2).level is Level.SLOW


@BY_PLACE
def test_alone_it_is_never_stopped(mode: str) -> None:
    robot = cell(mode)
    assert robot.settle(ticks=5 * TICKS).level is Level.CLEAR
    assert all(robot.step(FAR_M).level is Level.CLEAR for _ in range(TICKS))


@BY_PLACE
def test_while_people_hold_it_it_need_not_move(mode: str) -> None:
    robot = cell(mode)
    assert robot.settle(0.4, ticks=5 * TICKS).reason is Reason.PERSON_NEAR
    assert robot.settle(NEAR_M, ticks=TICKS // 2).level is Level.SLOW


def test_it_does_not_back_out_of_an_unknown_place() -> None:
    modes = {"recovery": {"speed_m_s": 0.06}}
    robot = cell("predictive", motion={"plan": "pick_and_place"}, modes=modes)
    robot.settle(NEAR_M, ticks=TICKS + 30)
    advice = robot.settle(0.6, ticks=10, request=OperatingMode.RECOVERY)
    assert (advice.mode, advice.level) == (OperatingMode.AUTOMATIC, Level.STOP)
    assert "something other than people in view stops the robot" in advice.detail


def test_a_vehicle_may_be_anywhere() -> None:
    settings = mobile.settings_of(motion={"kind": "state", "still_s": STILL_S})
    risk = SETTINGS.model_copy(update={"mode": "iso"})
    vehicle = Cell(risk, robot=settings, horizon_steps=60)
    vehicle.said = {"base": mobile.standing()}
    advice = vehicle.settle(2 * FAR_M, ticks=TICKS + 30)
    assert (advice.level, advice.reason) == (Level.STOP, FROZEN)
    assert "or all people are gone" in advice.detail
    assert vehicle.settle(ticks=140).level is Level.CLEAR  # at 0.5 m/s more each second
