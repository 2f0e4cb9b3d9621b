"""The registers of the robot's server, as its first lines describe them."""

import math
import struct

import pytest

from hri_sim.robot_server.robot import JOINTS, Robot

modbus = pytest.importorskip("hri_sim.robot_server.modbus", reason="needs pymodbus")


def floats(registers):
    return struct.unpack(f">{2 * JOINTS}f", struct.pack(f">{4 * JOINTS}H", *registers[2:]))


def test_heartbeat_and_mode_come_first_then_positions_and_velocities():
    robot = Robot("none", 0.0)
    robot.beat = 7
    robot.velocities = [0.1 * k for k in range(JOINTS)]
    registers = modbus.words(robot)
    assert len(registers) == modbus.COUNT
    assert registers[:2] == [7, 1]
    assert floats(registers) == pytest.approx([*robot.positions, *robot.velocities])


@pytest.mark.parametrize("fault", ["not a number", "wrong type", "mode"])
def test_a_fault_is_seen_once_a_client_has_come(fault):
    robot = Robot(fault, 0.0)
    right = modbus.words(robot)
    robot.seen()
    wrong = modbus.words(robot)
    assert wrong != right
    assert (wrong[1] == 2) == (fault == "mode")
    assert math.isnan(floats(wrong)[2]) == (fault == "not a number")
