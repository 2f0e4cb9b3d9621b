"""RobotState and Acknowledge in structured text: run as it stands, decoded by the node."""

from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.protocol.can import CanFrame, CanReceiver
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.generate.examples import EXAMPLES
from hri_predict.protocol.messages import Acknowledge, BaseMotion, Message, RobotState
from hri_predict.protocol.serial import SerialReceiver
from tests.hri_drivers.c.test_examples import Example
from tests.hri_drivers.plc.conftest import everything
from tests.hri_drivers.plc.structured_text import Unit, Units
from tests.hri_predict.protocol.drawn import assert_close, robot_states
from tests.messages import make_state

UNITS = everything()
NOT_AVAILABLE = -(2**31)


def micro(values: Any) -> list[int]:
    return [round(1e6 * v) for v in values]


def inputs(message: RobotState) -> dict[str, Any]:
    """What a program gives HRI_STATE to say ``message``."""
    n = len(message.positions)
    base = message.base or BaseMotion(x_m=0, y_m=0, yaw_rad=0, **AT_REST)
    place = micro((base.x_m, base.y_m, base.yaw_rad))
    speed = micro((base.vx_m_s, base.vy_m_s, base.yaw_rate_rad_s))
    names = ("BaseXUm", "BaseYUm", "BaseYawUrad", "BaseXUmS", "BaseYUmS", "BaseYawUradS")
    return {
        "RobotMode": message.mode,
        "Joints": n,
        "PositionUrad": micro(message.positions) + [7] * (9 - n),
        "VelocityUradS": micro(message.velocities) + [7] * (9 - n),
        "Request": message.request,
        "Enabling": message.enabling,
        "Tool": 255 if message.tool is None else message.tool,
        "ToolConfirmed": message.tool_confirmed,
        "BaseMoves": message.base is not None,
        **dict(zip(names, place + speed, strict=True)),
        "FirstCounter": (message.counter - 1) % 65536,
        "NowMs": 5,
    }


def encoded(message: RobotState | Acknowledge, **changes: Any) -> Unit:
    """The block that has encoded ``message``, just started."""
    if isinstance(message, RobotState):
        block = UNITS["HRI_STATE"].another()
        block(**inputs(message) | changes)
    else:
        block = UNITS["HRI_ACKNOWLEDGE"].another()
        block(LatchId=message.latch_id, AckId=message.ack_id)
    return block


def outputs(block: Unit, *names: str) -> dict[str, Any]:
    return {name: block.variables[name] for name in names}


def sender(name: str, message: Message) -> Unit:
    block = UNITS[name].another()
    block.variables["Number"] = BY_TYPE[type(message)].number
    block.variables["ROBOT"] = getattr(message, "robot", 0)
    return block


def frames(block: Unit, state: Unit) -> list[CanFrame]:
    block(**outputs(state, "Payload", "Needed", "Bytes"))
    v = block.variables
    return [
        CanFrame(v["Ids"][i], bytes(v["Frames"][8 * i : 8 * i + 8]), False)
        for i in range(v["FrameCount"])
    ]


def line(block: Unit, state: Unit, begins: bool = False) -> bytes:
    block(**outputs(state, "Payload", "Bytes"), Begins=begins)
    return bytes(block.variables["Line"][: block.variables["LineBytes"]])


def heard(message: RobotState | Acknowledge, wire: str, **changes: Any) -> list[Message]:
    """What the node hears, once structured text has sent it."""
    block = encoded(message, **changes)
    if wire == "serial":
        return SerialReceiver().feed(line(sender("HRI_SERIAL_SEND", message), block, begins=True))
    receiver = CanReceiver(False)
    return [m for f in frames(sender("HRI_CAN_SEND", message), block) for m in receiver.feed(f)]


@given(robot_states, st.sampled_from(["classic", "serial"]))
def test_the_node_hears_every_robot_state(message: RobotState, wire: str) -> None:
    (got,) = heard(message, wire)
    assert_close(got, message)


@settings(max_examples=25)
@given(st.integers(0, 65535), st.integers(0, 2**32 - 1), st.sampled_from(["classic", "serial"]))
def test_the_node_hears_every_acknowledge(latch: int, ack: int, wire: str) -> None:
    assert heard(Acknowledge(latch, ack), wire) == [Acknowledge(latch, ack)]


SENT = [m for m in EXAMPLES if isinstance(m, RobotState | Acknowledge)]


@pytest.mark.parametrize("message", SENT, ids=lambda m: type(m).__name__)
def test_the_bytes_are_those_of_the_worked_example(message: RobotState | Acknowledge) -> None:
    example = Example(message)
    sent = frames(sender("HRI_CAN_SEND", message), encoded(message))
    assert [(f.arbitration_id, f.data) for f in sent] == example.units["classic"]
    assert (
        line(sender("HRI_SERIAL_SEND", message), encoded(message)) == example.units["serial"][0][1]
    )


STILL = make_state((0.5,) * 6, counter=9)
AT_REST = {"vx_m_s": 0.0, "vy_m_s": 0.0, "yaw_rate_rad_s": 0.0}


@pytest.mark.parametrize("urad", [NOT_AVAILABLE, 32_768 * 250, -32_768 * 250, 2**31 - 1])
@pytest.mark.parametrize("wire", ["classic", "serial"])
def test_a_position_beyond_the_range_voids_the_message(wire: str, urad: int) -> None:
    assert heard(STILL, wire, PositionUrad=[urad] + [0] * 8) == []


@pytest.mark.parametrize(
    ("urad_s", "raw"), [(2**31 - 1, 32767), (-(2**31) + 1, 32769), (-500, 65535), (500, 1)]
)
def test_a_velocity_saturates_and_halves_go_away_from_zero(urad_s: int, raw: int) -> None:
    payload = encoded(STILL, VelocityUradS=[urad_s] + [0] * 8).variables["Payload"]
    assert payload[18] + 256 * payload[19] == raw


def test_a_line_that_begins_ends_what_came_before() -> None:
    for begins in (False, True):
        receiver, block = SerialReceiver(), sender("HRI_SERIAL_SEND", STILL)
        receiver.feed(b"rest of something")
        assert len(receiver.feed(line(block, encoded(STILL), begins))) == begins


def test_too_many_joints_send_nothing_and_count_nothing() -> None:
    block = encoded(STILL, Joints=10)
    assert block.variables["Bytes"] == 0
    assert (block.variables["StateCounter"], block.variables["Sent"]) == (0, 0)
    assert frames(sender("HRI_CAN_SEND", STILL), block) == []
    assert line(sender("HRI_SERIAL_SEND", STILL), block) == b""


def test_a_moving_base_beyond_the_fourth_robot_has_no_frames_on_classic_can() -> None:
    moving = replace(STILL, base=BaseMotion(x_m=1, y_m=2, yaw_rad=0.5, **AT_REST))
    assert len(heard(replace(moving, robot=3), "classic")) == 1
    assert heard(replace(moving, robot=4), "classic") == []
    assert len(heard(replace(moving, robot=4), "serial")) == 1


@pytest.mark.parametrize("name", ["HRI_CAN_SEND", "HRI_SERIAL_SEND"])
def test_counters_advance_across_their_wrap(name: str) -> None:
    block = sender(name, STILL)
    state, full = encoded(STILL), 255 if name == "HRI_CAN_SEND" else 65535
    block.variables["MessageCounter"] = full - 1
    serial, can = SerialReceiver(), CanReceiver(False)
    for _ in range(4):
        if name == "HRI_CAN_SEND":
            assert len([m for f in frames(block, state) for m in can.feed(f)]) == 1
        else:
            assert len(serial.feed(line(block, state))) == 1
    assert (can.counters.counter_errors, serial.counters.counter_errors) == (0, 0)


def test_the_times_of_sending_are_kept_and_void_after_a_pause(units: Units) -> None:
    block = units["HRI_STATE"]
    message = inputs(replace(STILL, counter=65_530))
    for n in range(40):
        block(**message | {"NowMs": (2**32 - 300 + 20 * n) % 2**32})
    v = block.variables
    assert (v["StateCounter"], v["Sent"]) == (33, 32)
    assert v["SentMs"][33 % 32] == 480
    assert v["SentMs"][(33 - 31) % 32] == (480 - 31 * 20) % 2**32
    block(**message | {"NowMs": 480 + 1000})
    assert v["Sent"] == 1
