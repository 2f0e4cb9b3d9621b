"""Operating modes in the engine: what they advise beside a person, and what always wins."""

from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.messages import Level, OperatingMode, RobotMode
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.sets import SetSettings
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.model import RobotSettings
from tests.hri_predict.risk.engine_cell import MODES, ROBOT, SETTINGS, Cell

NEAR_M = 0.7
QUICK = SETTINGS.model_copy(update={"speed_rise_m_s2": 100.0})
TICKS = 8
"""Enough for a release, with these settings."""
TEACH: dict[str, Any] = {
    "mode": RobotMode.MANUAL,
    "request": OperatingMode.TEACH,
    "enabling": True,
}
MUTE: dict[str, Any] = {"request": OperatingMode.MUTED}


def robot(**modes: Any) -> RobotSettings:
    return RobotSettings.model_validate({**ROBOT.model_dump(), "modes": modes})


def cell(mode: str = "iso", **modes: Any) -> Cell:
    made = Cell(QUICK.model_copy(update={"mode": mode}), robot=robot(**modes))
    made.turn = 0.0
    made.settle(NEAR_M, ticks=4)
    return made


@MODES
def test_teaching_permits_reduced_speed_beside_a_person_and_no_more(mode: str) -> None:
    one = cell(mode, teach={})
    advice = one.settle(NEAR_M, ticks=TICKS, **TEACH)
    assert (advice.level, advice.mode) == (Level.SLOW, OperatingMode.TEACH)
    assert (advice.speed_limit_m_s, advice.reason) == (0.25, Reason.TEACH)
    assert Reason.TEACH in one.assessment.reasons
    assert "arm: mode teach" in advice.detail
    advice = one.step(NEAR_M, **TEACH | {"enabling": False})  # let go, or gripped in panic
    assert (advice.level, advice.mode) == (Level.UNKNOWN, OperatingMode.AUTOMATIC)
    assert (advice.speed_limit_m_s, advice.reason) == (0.0, Reason.ROBOT_NOT_AUTOMATIC)
    assert "teach refused: the enabling device is not held" in advice.detail
    assert one.engine.robot_counters["mode_teach"] == 1
    assert one.engine.robot_counters["mode_refused"] == 1


def test_muting_permits_full_speed_beside_a_person_loudly_and_for_its_time() -> None:
    one = cell(muting={"max_s": 1})
    advice = one.settle(NEAR_M, ticks=TICKS, **MUTE)
    assert (advice.level, advice.mode) == (Level.WARN, OperatingMode.MUTED)
    assert (advice.speed_limit_m_s, advice.reason) == (1.0, Reason.MUTED)
    assert advice.detail.startswith("arm: MUTED, people do not stop it for another ")
    assert Reason.MUTED in one.assessment.reasons
    advice = one.settle(NEAR_M, ticks=26, **MUTE)
    assert (advice.level, advice.mode) == (Level.STOP, OperatingMode.AUTOMATIC)
    assert "its 1 s are over; release the request" in advice.detail
    assert one.assessment.reasons == ()


@pytest.mark.parametrize("asked", [TEACH, MUTE, {"request": OperatingMode.RECOVERY}])
def test_by_default_a_request_changes_nothing(asked: dict[str, Any]) -> None:
    asking, other = cell(), cell()
    advice = asking.settle(NEAR_M, ticks=TICKS, **asked)
    wanted = other.settle(NEAR_M, ticks=TICKS, mode=asked.get("mode", RobotMode.AUTOMATIC))
    assert advice.mode is OperatingMode.AUTOMATIC
    assert (advice.level, advice.speed_limit_m_s) == (wanted.level, wanted.speed_limit_m_s)
    assert " refused: modes." in advice.detail


@pytest.mark.parametrize("asked", [TEACH, MUTE])
@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        ({"reasons": (Reason.SOURCE_BLIND,)}, Reason.SOURCE_BLIND),
        ({"newest_capture_ns": None}, Reason.NO_INPUT),
        ({"reasons": (Reason.SECOND_SENDER,)}, Reason.SECOND_SENDER),
    ],
)
def test_a_scene_that_cannot_be_trusted_wins(
    asked: dict[str, Any], trouble: dict[str, Any], reason: Reason
) -> None:
    one = cell(teach={}, muting={"max_s": 60})
    assert one.settle(NEAR_M, ticks=TICKS, **asked).mode is asked["request"]
    advice = one.step(NEAR_M, **asked, **trouble)
    assert (advice.level, advice.mode) == (Level.UNKNOWN, OperatingMode.AUTOMATIC)
    assert (advice.speed_limit_m_s, advice.reason) == (0.0, reason)


@pytest.mark.parametrize("asked", [TEACH, MUTE])
def test_a_stale_or_impossible_robot_wins(asked: dict[str, Any]) -> None:
    one = cell(teach={}, muting={"max_s": 60})
    one.settle(NEAR_M, ticks=TICKS, **asked)
    advice = one.settle(NEAR_M, ticks=4, report=False)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.ROBOT_STATE_STALE)
    assert advice.mode is OperatingMode.AUTOMATIC
    one.settle(NEAR_M, ticks=TICKS)
    one.settle(NEAR_M, ticks=TICKS, **asked)
    one.turn = 100.0
    advice = one.step(NEAR_M, **asked)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.ROBOT_STATE_INVALID)
    assert advice.mode is OperatingMode.AUTOMATIC


@pytest.mark.parametrize("asked", [TEACH, MUTE])
def test_no_mode_moves_a_robot_while_no_configuration_set_is_chosen(asked: dict[str, Any]) -> None:
    sets = [SetSettings(number=1, name="setting up", max_speed_m_s=0.2)]
    modes = robot(teach={}, muting={"max_s": 60})
    one = Cell(QUICK.model_copy(update={"sets": sets}), robot=modes)
    one.turn = 0.0
    advice = one.settle(NEAR_M, ticks=TICKS)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.SET_UNKNOWN)
    advice = one.settle(NEAR_M, ticks=TICKS, **asked)
    assert (advice.level, advice.mode) == (Level.UNKNOWN, OperatingMode.AUTOMATIC)
    assert (advice.speed_limit_m_s, advice.reason) == (0.0, Reason.SET_UNKNOWN)
    assert " refused: the situation is unknown" in advice.detail


def test_a_latched_stop_stays_latched_in_every_mode() -> None:
    latching = QUICK.model_copy(update={"latch": ["stop"]})
    one = Cell(latching, robot=robot(teach={}, muting={"max_s": 60}))
    one.turn = 0.0
    assert one.settle(NEAR_M, ticks=TICKS).detail.endswith("; latch: stop")
    for asked in (TEACH, MUTE):
        advice = one.settle(NEAR_M, ticks=TICKS, **asked)
        assert (advice.level, advice.reason) == (Level.STOP, Reason.LATCHED)


def test_people_who_are_muted_are_still_the_cause_of_a_latch() -> None:
    latching = QUICK.model_copy(update={"latch": ["stop"]})
    one = Cell(latching, robot=robot(teach={}, muting={"max_s": 60}))
    one.turn = 0.0
    one.settle(NEAR_M, ticks=TICKS)
    near = one.settle(NEAR_M, ticks=TICKS, **MUTE)
    assert (near.mode, near.latch_id) == (OperatingMode.MUTED, 0)
    away = one.settle(6.0, ticks=TICKS, **MUTE)
    assert one.engine.acknowledge(away.latch_id)
    assert one.settle(NEAR_M, ticks=TICKS, **MUTE).level is Level.WARN


def test_a_robot_is_taught_beside_people_so_they_are_no_cause_of_a_latch_then() -> None:
    latching = QUICK.model_copy(update={"latch": ["stop"]})
    one = Cell(latching, robot=robot(teach={}))
    one.turn = 0.0
    one.settle(NEAR_M, ticks=TICKS)
    advice = one.settle(NEAR_M, ticks=TICKS, **TEACH)
    assert one.engine.acknowledge(advice.latch_id)
    assert one.settle(NEAR_M, ticks=TICKS, **TEACH).level is Level.SLOW


def test_a_tick_that_fails_ends_the_mode() -> None:
    one = cell(muting={"max_s": 60})
    one.settle(NEAR_M, ticks=TICKS, **MUTE)
    with pytest.raises(ValueError):
        one.step(NEAR_M, **MUTE, last_positions=np.zeros((1, 2)))
    assert one.settle(NEAR_M, ticks=TICKS, **MUTE).mode is OperatingMode.AUTOMATIC


@pytest.mark.parametrize(
    ("key", "mode"), [("teach", {"speed_m_s": 0.1}), ("muting", {"max_s": 1, "speed_m_s": 0.1})]
)
def test_a_mode_that_could_never_move_the_robot_is_refused(key: str, mode: dict[str, Any]) -> None:
    slow = RiskSettings(min_speed_m_s=0.2)
    with pytest.raises(ConfigError, match=f"arm: modes.{key}.speed_m_s 0.1 is below risk.min_spe"):
        Cell(slow, robot=robot(**{key: mode}))
