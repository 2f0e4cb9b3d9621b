"""Tools that change: the worst case applies until the controller has confirmed one."""

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from hri_predict.base.errors import RobotError
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import RobotState
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.robots.settings import RobotSettings
from hri_predict.robots.tracker import RobotTracker
from tests.messages import make_state

MS = 1_000_000
CLAW = {"name": "claw", "a": [0, 0, 0], "b": [0, 0, 0.1], "radius": 0.05}
LANCE = {"name": "lance", "a": [0, 0, 0], "b": [0, 0, 0.4], "radius": 0.05}
TOOLS: list[dict[str, Any]] = [
    {"name": "small", "number": 1, "tool": [CLAW], "payload_kg": 0.0},
    {"name": "long", "number": 2, "tool": [LANCE], "payload_kg": 2.5},
    {"name": "heavy", "tool": [CLAW], "payload_kg": 5.0},
]


def settings_of(tools: list[dict[str, Any]] | None = None, **more: Any) -> RobotSettings:
    data = {"name": "arm", "model": "ur5e", "room_from_robot": Pose(), "max_speed_m_s": 1.5}
    return RobotSettings.model_validate({**data, "tools": tools or TOOLS, **more})


WORST = load_robot(settings_of(), None)


def carrying(payload_kg: float) -> RobotModel:
    return load_robot(settings_of([TOOLS[0] | {"payload_kg": payload_kg}]), None)


def test_the_worst_has_every_capsule_the_longest_stop_and_the_largest_reach() -> None:
    assert WORST.capsule_names[-3:] == ("small/claw", "long/lance", "heavy/claw")
    assert "gripper" not in WORST.capsule_names  # the robot file's own tool is replaced
    for own in WORST.tools.values():
        assert own.reach_m <= WORST.reach_m
        for speed in np.linspace(0.0, 3.0, 31):
            assert np.all(np.array(own.stopping(speed)) <= np.array(WORST.stopping(speed)))
    assert WORST.reach_m == WORST.tools["long"].reach_m
    assert WORST.stopping(1.0) == WORST.tools["heavy"].stopping(1.0) == (0.384, 0.2167)
    assert WORST.counting(2).stopping(1.0) == (0.3, 0.175)
    assert WORST.counting(1).reach_m == pytest.approx(WORST.reach_m - 0.3)


def test_a_tools_capsules_are_numbered_as_among_all() -> None:
    for own in WORST.tools.values():
        assert own.numbering is not None
        assert own.capsule_names == tuple(WORST.capsule_names[i] for i in own.numbering)


def test_a_stop_measured_late_counts_for_every_tool() -> None:
    worst = load_robot(settings_of(), None)
    worst.stretch = 2.0
    assert worst.counting(1).stopping(1.0)[0] == pytest.approx(
        2 * WORST.counting(1).stopping(1.0)[0]
    )


def state(counter: int, tool: Any = None, confirmed: Any = False) -> RobotState:
    return make_state((0.0,) * 6, counter=counter, tool=tool, tool_confirmed=confirmed)


@pytest.mark.parametrize(
    ("tool", "confirmed", "counted"),
    [
        (1, True, 1),
        (2, True, 2),
        (1, False, None),
        (None, True, None),
        (9, True, None),
        (True, True, None),
        (1.0, True, None),
        (1, 1, None),
        (float("nan"), True, None),
    ],
)
def test_only_a_known_and_confirmed_tool_counts(tool: Any, confirmed: Any, counted: Any) -> None:
    tracker = RobotTracker(settings_of(), WORST)
    tracker.update(state(1, tool, confirmed), 0)
    now = tracker.at(MS)
    assert now.tool == counted
    assert now.capsules is not None
    assert len(now.capsules.radius) == len(WORST.counting(counted).capsule_names)


def test_a_change_counts_at_once_as_the_worst_and_as_the_tool_when_confirmed() -> None:
    tracker = RobotTracker(settings_of(), WORST)
    said = [(1, True), (2, False), (2, False), (2, True), (1, True)]
    counted = []
    for i, (tool, confirmed) in enumerate(said):
        tracker.update(state(i, tool, confirmed), i * 20 * MS)
        counted.append(tracker.at(i * 20 * MS + MS).tool)
    assert counted == [1, None, None, 2, 1]


def test_two_links_must_agree_while_both_are_fresh() -> None:
    tracker = RobotTracker(settings_of(), WORST)
    tracker.update(state(1, 1, True), 0, "drive")
    assert tracker.at(MS).tool == 1
    tracker.update(state(1), 2 * MS, "monitor")
    assert tracker.at(3 * MS).tool is None
    tracker.update(state(2, 1, True), 90 * MS, "drive")
    assert tracker.at(95 * MS).tool is None
    assert tracker.at(103 * MS).tool == 1  # the monitor is silent


def test_a_robot_without_tools_ignores_the_number() -> None:
    plain = RobotSettings(name="arm", model="ur5e", room_from_robot=Pose(), max_speed_m_s=1)
    tracker = RobotTracker(plain, load_robot(plain, None))
    tracker.update(state(1, 1, True), 0)
    now = tracker.at(MS)
    assert now.tool is None
    assert not now.reasons


@pytest.mark.parametrize(
    ("tools", "more", "message"),
    [
        ([TOOLS[0], TOOLS[0] | {"number": 3}], {}, "two tools have the name 'small'"),
        ([TOOLS[0], TOOLS[1] | {"number": 1}], {}, "two tools have the number 1"),
        ([TOOLS[0] | {"number": 255}], {}, "number"),
        ([TOOLS[0] | {"number": True}], {}, "number"),
        ([TOOLS[0] | {"payload": [CLAW]}], {}, "two capsules with the same name"),
        ([TOOLS[0] | {"weight": 3}], {}, "weight"),
        (TOOLS, {"payload_kg": 1.0}, "belongs in each of its tools"),
        ([{"name": "grip", "number": 1, "payload_kg": 4.0}], {}, "tool 'grip' has no capsules"),
        ([{"name": "grip", "number": 1}], {}, "tool 'grip' has no capsules"),
    ],
)
def test_mistakes(tools: list[dict[str, Any]], more: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        settings_of(tools, **more)


def test_nothing_may_be_mounted() -> None:
    bare = {"name": "none", "number": 0, "payload_kg": 0}
    assert settings_of([bare, TOOLS[0]]).tools is not None


def test_no_tools_at_all_is_a_mistake() -> None:
    with pytest.raises(ValidationError, match="tools"):
        RobotSettings.model_validate(settings_of().model_dump() | {"tools": []})


def test_a_tool_heavier_than_the_table_is_refused() -> None:
    with pytest.raises(RobotError, match=r"tools.0.payload_kg: 7 .*ends at 5 kg"):
        carrying(7.0)
