"""The mock controller of a robot with tools, with a rail, and on a moving base."""

from typing import Any

import numpy as np
import pytest

from hri_drivers.links.framed import SerialCodec
from hri_drivers.links.serial.link import SerialLinkSettings
from hri_predict.base.arrays import Floats
from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import ConfigError
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import Level, RobotState, Schema
from hri_predict.robots.model import RobotModel, load_robot
from hri_predict.robots.settings import RobotSettings
from hri_predict.robots.stopping import StoppingTable
from hri_predict.robots.trajectory import load_trajectory
from hri_sim.controllers.cell import MockCell
from hri_sim.controllers.station import Brakes, Drive
from hri_sim.controllers.tools import Mounted, ToolChange, ToolChanger
from tests.arms import arm_settings
from tests.hri_predict.robots import mobile
from tests.messages import make_advice

MS = 1_000_000
START = 5_000 * MS
HEAVY = {"name": "drum", "a": [0.0, 0.0, 0.05], "b": [0.0, 0.0, 0.2], "radius": 0.08}
TOOLS = [
    {"name": "light", "number": 1, "payload_kg": 0.0},
    {"name": "heavy", "number": 2, "payload_kg": 5.0, "tool": [HEAVY]},
]
ARM: dict[str, Any] = {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
WITH_TOOLS = RobotSettings.model_validate(ARM | {"tools": TOOLS})
CHANGES = [
    {"at_s": 0.2, "tool": 1},
    {"at_s": 0.6, "tool": 2, "confirmed_after_s": 0.3},
    {"at_s": 1.2, "tool": 1, "confirmed_after_s": None},
]


def played(
    robot: RobotSettings, simulate: dict[str, Any], ms: int
) -> tuple[MockCell, list[tuple[int, RobotState]]]:
    """What the drive of a cell says, ms by ms, when it is allowed to run."""
    link = SerialLinkSettings(name="drive", simulate={"role": "drive", **simulate})
    clock = VirtualClock(START)
    cell = MockCell(links=[link], robots=[robot], base_dir=None, clock=clock)
    end, codec = cell.transports()["drive"], SerialCodec(115200)
    end.open()
    said: list[tuple[int, RobotState]] = []
    echo: int | None = None
    while (now := clock.now_ns()) < START + ms * MS:
        for unit in end.read(0.0):
            for message in codec.decode(unit):
                if isinstance(message, RobotState):
                    echo = message.counter
                    said.append(((now - START) // MS, message))
        if (now - START) % (40 * MS) == 0:
            go = make_advice(Level.CLEAR, speed_limit_m_s=2.0, echo=echo, age_s=0.03)
            for message in (Schema(SCHEMA_VERSION, SCHEMA_HASH), go):
                for unit in codec.encode(message):
                    end.write(unit)
        while (due := cell.next_ns()) is not None and due <= now:
            cell.step(now)
        clock.advance_to(now + 8 * MS)
    return cell, said


def test_a_tool_is_said_at_once_and_confirmed_when_it_was_checked() -> None:
    changer = ToolChanger([ToolChange.model_validate(change) for change in CHANGES])
    at = [changer.at(START + ms * MS) for ms in (0, 250, 700, 950, 1300, 9000)]
    assert at == [
        Mounted(),
        Mounted(1, True),
        Mounted(2, False),
        Mounted(2, True),
        Mounted(1, False),
        Mounted(1, False),
    ]


def test_the_controller_says_its_tool_and_the_referee_knows_it() -> None:
    simulate = {"trajectory": "pick_and_place", "tools": CHANGES}
    cell, said = played(WITH_TOOLS, simulate, 1500)
    told = {(state.tool, state.tool_confirmed) for _, state in said}
    assert told == {(None, False), (1, True), (2, False), (2, True), (1, False)}
    assert cell.tool_of("arm") == 1
    assert all(state.base is None for _, state in said)
    cell.stop()


def test_a_tool_that_the_robot_lacks_is_refused() -> None:
    simulate = {"trajectory": "pick_and_place", "tools": [{"tool": 3}]}
    with pytest.raises(
        ConfigError, match=r"tools.0.tool: robot 'arm' has no tool number 3; .*1, 2"
    ):
        played(WITH_TOOLS, simulate, 0)


def test_a_base_is_said_where_it_is_and_joints_alone_are_joints() -> None:
    robot = mobile.settings_of(payload_kg=2.0)
    cell, said = played(robot, {"trajectory": "drive_and_pick", "start_s": 2.0}, 2500)
    model = load_robot(robot, None)
    path = load_trajectory("drive_and_pick", model, None)
    (q, qd) = cell.robot_truth(START + 2500 * MS)["amr"]
    assert q.shape == (9,)
    last = said[-1][1]
    assert len(last.positions) == len(last.velocities) == 6
    assert last.base is not None
    np.testing.assert_allclose(
        [last.base.x_m, last.base.y_m, last.base.yaw_rad],
        q[:3],
        atol=0.02 * np.abs(qd[:3]).max() + 1e-3,
    )
    assert np.hypot(last.base.vx_m_s, last.base.vy_m_s) > 0.05
    phase = cell.path_s()["amr"]
    np.testing.assert_allclose(path.at(phase)[0], cell.robot_truth(0)["amr"][0], atol=0.05)
    cell.stop()


def test_a_rail_is_a_joint_like_others() -> None:
    robot = arm_settings("ur10e_rail", payload_kg=5.0)
    cell, said = played(robot, {"trajectory": "rail_pick_and_place", "start_s": 2.0}, 1500)
    rails = [state.positions[0] for _, state in said]
    assert len(said[-1][1].positions) == 7
    assert rails[-1] > rails[0] + 0.05
    cell.stop()


def stops(table: StoppingTable, part: Floats, together: Floats, deceleration: float) -> None:
    """A part of the speed, stopped with all of it, keeps to its own table."""
    time_s = together / deceleration
    moving = part > 1e-3
    assert np.all(time_s[moving] <= table.times_s(part)[moving] + 1e-9)
    assert np.all((part * time_s / 2)[moving] <= table.distances_m(part)[moving] + 1e-9)


def test_arm_and_base_brake_together_within_both_tables() -> None:
    robot = mobile.settings_of(payload_kg=2.0)
    model = load_robot(robot, None)
    path = load_trajectory("drive_and_pick", model, None)
    deceleration = Brakes(Drive(model, path), None, 1.0).with_tool(None)
    q, qd = path.at(np.linspace(0.0, path.duration_s, 301))
    assert model.mobile is not None
    together, of_base = model.tip_speed(q, qd), model.mobile.speed(qd)
    for share in (0.1, 0.5, 1.0):
        stops(model.mobile.table, share * of_base, share * together, 1.02 * deceleration)
        stops(model.table, share * (together - of_base), share * together, 1.02 * deceleration)


def test_a_heavier_tool_brakes_later() -> None:
    model: RobotModel = load_robot(WITH_TOOLS, None)
    brakes = Brakes(Drive(model, load_trajectory("pick_and_place", model, None)), None, 1.0)
    assert brakes.with_tool(1) > brakes.with_tool(2) == brakes.with_tool(None)
