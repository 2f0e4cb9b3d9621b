"""Operating modes: granted where everything holds, refused where one condition is missing."""

import logging
from dataclasses import replace
from typing import Any

import pytest

from hri_predict.protocol.messages import Level, OperatingMode, RobotMode
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand
from hri_predict.risk.levels.modes import Decision, Modes, Situation
from hri_predict.robots.mode_request import NOTHING_ASKED, ModeRequest
from hri_predict.robots.modes import ModeSettings

AUTOMATIC, TEACH, RECOVERY, MUTED = OperatingMode
ALL = ModeSettings.model_validate({"teach": {}, "recovery": {}, "muting": {"max_s": 5}})
TICK_NS = 40_000_000
NEAR = replace(Demand.unknown(Reason.PERSON_NEAR), level=Level.STOP, release=Level.STOP)
FREE = Demand.nothing(1.0)
BLIND = Demand.unknown(Reason.SOURCE_BLIND)
ASKED = {
    AUTOMATIC: ModeRequest(heard=True),
    TEACH: ModeRequest(RobotMode.MANUAL, TEACH, enabling=True, heard=True),
    RECOVERY: ModeRequest(request=RECOVERY, heard=True),
    MUTED: ModeRequest(request=MUTED, heard=True),
}
SPEED = {TEACH: 0.25, RECOVERY: 0.1, MUTED: 1.0}
LEVEL = {TEACH: Level.SLOW, RECOVERY: Level.SLOW, MUTED: Level.WARN}
REASON = {TEACH: Reason.TEACH, RECOVERY: Reason.RECOVERY, MUTED: Reason.MUTED}
WANTED = pytest.mark.parametrize("mode", [TEACH, RECOVERY, MUTED])


class Robot:
    """One robot's modes, tick by tick; somebody stands near it."""

    def __init__(self, settings: ModeSettings = ALL):
        self.modes = Modes(settings, "arm", 1.0)
        self.now_ns = 10**9

    def tick(self, asked: ModeRequest, ticks: int = 1, **changes: Any) -> Decision:
        for _ in range(ticks):
            self.now_ns += TICK_NS
            situation = Situation(asked=asked, demand=NEAR, is_known=True)
            decision = self.modes.decide(replace(situation, **changes), self.now_ns)
        return decision

    def ready(self) -> "Robot":
        self.tick(ASKED[AUTOMATIC])
        return self


@WANTED
def test_a_mode_is_entered_used_and_left(mode: OperatingMode, caplog: Any) -> None:
    robot = Robot().ready()
    with caplog.at_level(logging.WARNING):
        decision = robot.tick(ASKED[mode], 3)
        assert decision.mode is robot.modes.mode is mode
        demand = decision.demand
        assert (demand.level, demand.release) == (LEVEL[mode], LEVEL[mode])
        assert (demand.limit_m_s, demand.release_limit_m_s) == (SPEED[mode], SPEED[mode])
        assert demand.reason is REASON[mode]
        assert "mode" in decision.note or "MUTED" in decision.note
        after = robot.tick(ASKED[AUTOMATIC], 3)
    assert (after.mode, after.demand, after.note) == (AUTOMATIC, NEAR, "")
    word = mode.name.lower()
    begins, ends = [record.message for record in caplog.records]
    assert begins.startswith(f"robot arm: {word} begins: ")
    assert ends == f"robot arm: {word} ends: the request was released"
    assert robot.modes.counters == {word: 1}


@WANTED
def test_nothing_is_allowed_by_default(mode: OperatingMode, caplog: Any) -> None:
    robot = Robot(ModeSettings()).ready()
    with caplog.at_level(logging.WARNING):
        decision = robot.tick(ASKED[mode], 60)
    key = {TEACH: "teach", RECOVERY: "recovery", MUTED: "muting"}[mode]
    why = f"{mode.name.lower()} refused: modes.{key} is not configured for this robot"
    assert decision.mode is AUTOMATIC
    assert decision.note == f"arm: {why}"
    assert [record.message for record in caplog.records] == [f"robot arm: {why}"]
    assert robot.modes.counters == {"refused": 1}


@WANTED
def test_what_nobody_asks_for_is_not_in_force(mode: OperatingMode) -> None:
    for demand in (NEAR, FREE, BLIND):
        decision = Robot().tick(ASKED[AUTOMATIC], demand=demand)
        assert (decision.mode, decision.demand, decision.note) == (AUTOMATIC, demand, "")
    assert Robot().tick(NOTHING_ASKED).mode is AUTOMATIC


CASES: list[tuple[OperatingMode, dict[str, Any], dict[str, Any], str]] = [
    (TEACH, {"mode": RobotMode.AUTOMATIC}, {}, "the controller is not in manual mode"),
    (TEACH, {"mode": RobotMode.MAINTENANCE}, {}, "the controller is not in manual mode"),
    (TEACH, {"mode": RobotMode.UNKNOWN}, {}, "the controller is not in manual mode"),
    (TEACH, {"enabling": False}, {}, "the enabling device is not held"),
    (RECOVERY, {"mode": RobotMode.MANUAL}, {}, "the controller is not in automatic mode"),
    (RECOVERY, {}, {"demand": FREE}, "people do not stop the robot"),
    (
        RECOVERY,
        {},
        {"demand": replace(NEAR, level=Level.SLOW)},
        "people are not near enough to stop the robot again; a stop that holds clears when they "
        "are farther away by risk.band_m",
    ),
    (RECOVERY, {}, {"beside_unseen": True}, "something other than people in view stops the robot"),
    (
        RECOVERY,
        {},
        {"demand": replace(NEAR, reason=Reason.PERSON_LOST)},
        "something other than people in view stops the robot",
    ),
    (
        RECOVERY,
        {},
        {"demand": replace(NEAR, reason=Reason.SPEED_UNKNOWN)},
        "something other than people in view stops the robot",
    ),
    (RECOVERY, {}, {"not_backing_out": "it does not move backwards"}, "it does not move backwards"),
    (MUTED, {"mode": RobotMode.MANUAL}, {}, "the controller is not in automatic mode"),
    *(
        (mode, {"agreed": False}, {}, "not all of its controllers request it")
        for mode in (TEACH, RECOVERY, MUTED)
    ),
    *(
        (mode, {}, {"demand": BLIND, "is_known": False}, "the situation is unknown")
        for mode in (TEACH, RECOVERY, MUTED)
    ),
]


@pytest.mark.parametrize(("mode", "asked", "changes", "why"), CASES)
def test_each_missing_condition_refuses_it_and_ends_it(
    mode: OperatingMode, asked: dict[str, Any], changes: dict[str, Any], why: str, caplog: Any
) -> None:
    wrong = replace(ASKED[mode], **asked)
    fresh = Robot().ready().tick(wrong, **changes)
    assert fresh.mode is AUTOMATIC
    assert fresh.note == f"arm: {mode.name.lower()} refused: {why}"
    robot = Robot().ready()
    assert robot.tick(ASKED[mode]).mode is mode
    if changes.get("demand") is not None and changes["demand"].level is Level.SLOW:
        return  # recovery goes on until people would release the robot
    with caplog.at_level(logging.WARNING):
        ended = robot.tick(wrong, **changes)
    assert ended.mode is AUTOMATIC
    assert ended.demand.limit_m_s <= (1.0 if ended.demand is FREE else 0.0)
    assert f"robot arm: {mode.name.lower()} ends: {why}" in caplog.messages


@WANTED
@pytest.mark.parametrize("asked", [ASKED[AUTOMATIC], NOTHING_ASKED])
def test_the_unknown_always_wins(mode: OperatingMode, asked: ModeRequest) -> None:
    robot = Robot().ready()
    robot.tick(ASKED[mode])
    for each in (asked, ASKED[mode]):
        decision = robot.tick(each, demand=BLIND, is_known=False)
        assert (decision.mode, decision.demand) == (AUTOMATIC, BLIND)


def test_a_robot_in_manual_mode_that_is_not_taught_is_never_advised_to_run() -> None:
    """The situation is known then: the scene is, and the robot only lacks the automatic mode."""
    for asked in (ModeRequest(RobotMode.MANUAL, heard=True), replace(ASKED[TEACH], enabling=False)):
        decision = Robot().ready().tick(asked, demand=FREE)
        assert decision.demand == Demand.unknown(Reason.ROBOT_NOT_AUTOMATIC)


def test_muting_ends_by_itself_and_must_be_released_before_it_counts_again(caplog: Any) -> None:
    robot = Robot().ready()
    with caplog.at_level(logging.WARNING):
        decision = robot.tick(ASKED[MUTED])
        assert decision.note == "arm: MUTED, people do not stop it for another 5.0 s"
        assert robot.tick(ASKED[MUTED], 124).mode is MUTED  # 4.96 s later
        assert robot.tick(ASKED[MUTED]).mode is AUTOMATIC
        for _ in range(500):
            decision = robot.tick(ASKED[MUTED])
            assert (decision.mode, decision.demand) == (AUTOMATIC, NEAR)
    assert decision.note == "arm: muted refused: its 5 s are over; release the request"
    assert caplog.messages[1] == "robot arm: muted ends: its 5 s are over; release the request"
    assert len(caplog.messages) == 3  # begins, ends, refused
    robot.tick(ASKED[AUTOMATIC], 1126)  # 45 s between ticks that see it released
    assert robot.tick(ASKED[MUTED], 125).mode is MUTED
    assert robot.modes.counters == {"muted": 2, "refused": 1}


def muted_ticks(robot: Robot, on: int, off: int, times: int) -> int:
    """Ticks in which a robot is muted whose request comes and goes."""
    count = 0
    for _ in range(times):
        count += sum(robot.tick(ASKED[MUTED]).mode is MUTED for _ in range(on))
        robot.tick(ASKED[AUTOMATIC], off)
    return count


@pytest.mark.parametrize(("on", "off"), [(50, 1), (124, 1), (10, 1), (3, 3), (200, 2)])
def test_a_request_that_is_released_for_a_moment_does_not_begin_the_time_again(
    on: int, off: int
) -> None:
    times = 500 // (on + off) + 1  # at least 20 s
    muted_s = muted_ticks(Robot().ready(), on, off, times) * TICK_NS * 1e-9
    seconds = times * (on + off) * TICK_NS * 1e-9
    assert muted_s <= 5 + seconds * 5 / (5 + 45)


@pytest.mark.parametrize(("max_s", "rest_s"), [(1, 1), (2, 8), (5, None)])
def test_in_the_long_run_the_share_of_muted_time_is_as_check_says(
    max_s: int, rest_s: int | None
) -> None:
    muting = {"max_s": max_s} | ({} if rest_s is None else {"rest_s": rest_s})
    allowed = ModeSettings.model_validate({"muting": muting})
    assert allowed.muting is not None
    robot = Robot(allowed).ready()
    on, off = 25 * max_s, round(25 * allowed.muting.recovery_s) + 2
    count, times = muted_ticks(robot, on, off, 20), 20
    assert count == on * times  # who rests as long as stated has all of it each time
    share = count / (times * (on + off))
    assert share == pytest.approx(allowed.muting.share, abs=0.02)  # two ticks of each rest


def test_part_of_the_time_may_be_used_at_once_and_all_of_it_only_after_the_rest() -> None:
    robot = Robot().ready()
    robot.tick(ASKED[MUTED], 51)  # 2 s
    robot.tick(ASKED[AUTOMATIC])
    decision = robot.tick(ASKED[MUTED])
    assert decision.note == "arm: MUTED, people do not stop it for another 3.0 s"
    robot.tick(ASKED[MUTED], 80)
    robot.tick(ASKED[AUTOMATIC], 1000)  # 40 of the 45 s
    decision = robot.tick(ASKED[MUTED])
    assert decision.mode is AUTOMATIC
    assert decision.note == (
        "arm: muted refused: its 5 s are used up; it counts again after 45 s without a request"
    )


@pytest.mark.parametrize(
    "asked", [NOTHING_ASKED, ModeRequest(heard=True, agreed=False), ASKED[MUTED]], ids=str
)
def test_the_time_recovers_only_while_the_request_is_seen_released(asked: ModeRequest) -> None:
    robot = Robot().ready()
    robot.tick(ASKED[MUTED], 130)
    robot.tick(asked, 3000)
    assert robot.ready().tick(ASKED[MUTED]).mode is AUTOMATIC


def test_a_restart_does_not_give_the_time_back() -> None:
    before, after = Robot().ready(), Robot()
    before.tick(ASKED[MUTED], 76)  # 3 s
    assert before.modes.muted_time is not None
    assert after.modes.muted_time is not None
    after.modes.muted_time.recall(before.modes.muted_time.used_s)
    after.ready()
    assert sum(after.tick(ASKED[MUTED]).mode is MUTED for _ in range(200)) <= 52  # 2 s
    with pytest.raises(ValueError, match="muting"):
        after.modes.muted_time.recall(float("nan"))


def test_a_request_for_muting_that_was_there_before_the_node_does_not_count() -> None:
    robot = Robot()
    decision = robot.tick(ASKED[MUTED], 10)
    assert decision.mode is AUTOMATIC
    assert "the request was already active; release it first" in decision.note
    assert robot.ready().tick(ASKED[MUTED]).mode is MUTED


@pytest.mark.parametrize("pause", [{"is_known": False, "demand": BLIND}, {"asked": NOTHING_ASKED}])
def test_after_a_fault_or_silence_muting_does_not_go_on(pause: dict[str, Any]) -> None:
    robot = Robot().ready()
    robot.tick(ASKED[MUTED])
    robot.tick(**({"asked": ASKED[MUTED]} | pause))
    assert robot.tick(ASKED[MUTED], 10).mode is AUTOMATIC
    assert robot.ready().tick(ASKED[MUTED]).mode is MUTED


def test_muting_may_have_a_speed_limit() -> None:
    slow = ModeSettings.model_validate({"muting": {"max_s": 5, "speed_m_s": 0.3}})
    demand = Robot(slow).ready().tick(ASKED[MUTED]).demand
    assert (demand.level, demand.limit_m_s) == (Level.SLOW, 0.3)


def test_recovery_goes_on_within_the_band_and_ends_beyond_it() -> None:
    robot = Robot().ready()
    robot.tick(ASKED[RECOVERY])
    within = replace(NEAR, level=Level.SLOW, limit_m_s=0.2)
    assert robot.tick(ASKED[RECOVERY], demand=within).mode is RECOVERY
    beyond = replace(within, release=Level.SLOW)
    assert robot.tick(ASKED[RECOVERY], demand=beyond).demand == beyond


def test_the_reason_that_lasts_is_logged_and_not_a_short_one_before_it(caplog: Any) -> None:
    robot = Robot().ready()
    with caplog.at_level(logging.WARNING):
        robot.tick(replace(ASKED[RECOVERY], agreed=False))
        for _ in range(20):
            robot.tick(ASKED[RECOVERY], not_backing_out="it does not move backwards")
    assert caplog.messages == ["robot arm: recovery refused: it does not move backwards"]


def test_a_reason_that_comes_soon_after_another_is_logged_later(caplog: Any) -> None:
    robot = Robot().ready()
    with caplog.at_level(logging.WARNING):
        for why in ("it does not move backwards", "a person is lost"):
            for _ in range(8):
                robot.tick(ASKED[RECOVERY], not_backing_out=why)
        assert len(caplog.messages) == 1
        for _ in range(20):
            robot.tick(ASKED[RECOVERY], not_backing_out="a person is lost")
    assert caplog.messages[1:] == ["robot arm: recovery refused: a person is lost"]


def test_a_controller_that_flickers_does_not_fill_the_log(caplog: Any) -> None:
    robot = Robot(ModeSettings()).ready()
    with caplog.at_level(logging.WARNING):
        for _ in range(50):  # 4 s
            robot.tick(ASKED[MUTED])
            robot.tick(ASKED[TEACH])
    assert len(caplog.messages) <= 5
    assert robot.modes.counters["refused"] == 100


@WANTED
def test_a_tick_that_failed_ends_every_mode(mode: OperatingMode) -> None:
    robot = Robot().ready()
    robot.tick(ASKED[mode])
    robot.modes.reset()
    assert robot.modes.mode is AUTOMATIC
    assert robot.tick(ASKED[MUTED]).mode is AUTOMATIC
