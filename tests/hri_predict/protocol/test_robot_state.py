"""RobotState on CAN: its bytes, the parts that a robot needs, and what is refused."""

from dataclasses import replace
from itertools import pairwise
from math import inf, nan, pi
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.codec import decode_payload, encode_payloads
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.messages import (
    Advice,
    BaseMotion,
    OperatingMode,
    RobotMode,
    RobotState,
)
from tests.hri_predict.protocol.drawn import sent_through
from tests.hri_predict.protocol.samples import ADVICE, NINE, SEVEN, SIX
from tests.messages import make_state

FAR_OFF = BaseMotion(x_m=0.0, y_m=33.0, yaw_rad=0.0, vx_m_s=0.0, vy_m_s=0.0, yaw_rate_rad_s=0.0)


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize(
    "change",
    [
        {"positions": (0.0,) * 6 + (8.2,)},
        {"positions": (-inf,) + (0.0,) * 6},
        {"base": FAR_OFF},
        {"base": replace(FAR_OFF, y_m=nan)},
        {"base": replace(FAR_OFF, y_m=0.0, yaw_rad=inf)},
    ],
)
def test_a_place_beyond_the_range_never_arrives_as_another_place(
    fd: bool, change: dict[str, Any]
) -> None:
    sender, receiver = CanSender(fd), CanReceiver(fd)
    state = replace(SEVEN, **change)
    assert [m for frame in sender.encode(state) for m in receiver.feed(frame)] == []
    assert receiver.counters.malformed == 1


@pytest.mark.parametrize("number", [-1, 255, 100_000])
def test_a_tool_beyond_the_range_is_none_instead_of_another(number: int) -> None:
    state = sent_through(replace(SEVEN, tool=number), False)
    advice = sent_through(replace(ADVICE, tool=number, robot_link=number), False)
    assert isinstance(state, RobotState)
    assert isinstance(advice, Advice)
    assert (state.tool, advice.tool, advice.robot_link) == (None, None, None)


def test_a_yaw_of_more_turns_is_the_same_yaw() -> None:
    for turns in (-3, -1, 1, 2):
        base = replace(FAR_OFF, y_m=0.0, yaw_rad=0.5 + turns * 2 * pi)
        state = sent_through(replace(SEVEN, base=base), False)
        assert isinstance(state, RobotState)
        assert state.base is not None
        assert state.base.yaw_rad == pytest.approx(0.5, abs=5.1e-5)  # half a step


def test_the_bytes_of_a_robot_state() -> None:
    """As PROTOCOL.md says: mode and joints, counter, requests, six joints, more, the base."""
    six = make_state((0.25,) * 6, (-0.001,) * 6, counter=0x1234)
    (payload,) = encode_payloads(six)
    none = "00 80"
    head = "61 34 12 00 FF 00"
    assert payload == bytes.fromhex(head + "E8 03" * 6 + "FF FF" * 6 + none * 12)
    nine = RobotState(
        robot=0,
        mode=RobotMode.MANUAL,
        counter=0x1234,
        positions=(0.0,) * 6 + (1.0, 2.0, 3.0),
        velocities=(0.0,) * 6 + (-1.0, -2.0, -3.0),
        request=OperatingMode.TEACH,
        enabling=True,
        tool=5,
        tool_confirmed=True,
        base=BaseMotion(
            x_m=1.0, y_m=-1.0, yaw_rad=0.5, vx_m_s=0.25, vy_m_s=-0.25, yaw_rate_rad_s=0.125
        ),
    )
    (payload,) = encode_payloads(nine)
    head = "92 34 12 01 05 15"
    more = "A0 0F 18 FC 40 1F 30 F8 E0 2E 48 F4"
    base = "E8 03 18 FC 88 13 FA 00 06 FF 7D 00"
    assert payload == bytes.fromhex(head + "00 00" * 12 + more + base)


@pytest.mark.parametrize(
    ("joints", "base", "frames"), [(6, False, 5), (7, False, 6), (9, False, 7), (9, True, 9)]
)
def test_a_state_has_the_parts_that_its_robot_needs(joints: int, base: bool, frames: int) -> None:
    state = replace(
        SEVEN,
        positions=(0.0,) * joints,
        velocities=(0.0,) * joints,
        base=replace(FAR_OFF, y_m=0.0) if base else None,
    )
    sent = CanSender().encode(state)
    assert len(sent) == frames
    for lost in range(frames):
        receiver = CanReceiver()
        assert not [m for i, f in enumerate(sent) if i != lost for m in receiver.feed(f)]


@given(st.permutations(range(9)))
def test_parts_of_a_state_come_in_any_order(order: list[int]) -> None:
    state = replace(NINE, counter=4711)
    frames = CanSender().encode(state)
    receiver = CanReceiver()
    got = [receiver.feed(frames[i]) for i in order]
    assert got[:-1] == [[]] * 8
    assert got[-1] == [state]


@given(st.lists(st.tuples(st.integers(0, 7), st.integers(0, 8)), max_size=80))
def test_parts_of_states_of_different_length_never_mix(order: list[tuple[int, int]]) -> None:
    """Whatever parts are lost, late or repeated: what comes out was sent so, whole."""
    sender, receiver = CanSender(), CanReceiver()
    shapes = (SIX, SEVEN, NINE, replace(SIX, base=NINE.base))
    sent = [
        replace(
            shapes[i % 4],
            counter=i,
            positions=tuple(0.25 * i for _ in shapes[i % 4].positions),
        )
        for i in range(8)
    ]
    groups = [sender.encode(state) for state in sent]
    got = [
        m
        for group, part in order
        if part < len(groups[group])
        for m in receiver.feed(groups[group][part])
    ]
    assert all(m in sent for m in got)
    assert all(a != b for a, b in pairwise(got))


def test_a_part_that_part_0_does_not_ask_for_makes_the_state_void() -> None:
    """Two senders of one id, one with six joints and one with nine, at equal counters."""
    six, nine = CanSender().encode(SIX), CanSender().encode(NINE)
    for early in (True, False):
        receiver = CanReceiver()
        stray = [nine[5], *six] if early else [*six[1:], nine[5], six[0]]
        assert not [m for f in stray for m in receiver.feed(f)]
        assert receiver.counters.counter_errors >= 1


def test_a_shorter_fd_state_than_ours_is_refused() -> None:
    """As version 1 sent it: of seven joints it would have been read at other places."""
    (frame,) = CanSender(fd=True).encode(SEVEN)
    number = frame.arbitration_id - DEFAULT_BASE_ID
    payload = frame.data[3:48]
    receiver = CanReceiver(fd=True)
    short = e2e.protect_profile5(0, payload, e2e.data_id_16(number))
    assert receiver.feed(CanFrame(frame.arbitration_id, short, True)) == []
    assert receiver.counters.malformed == 1


@pytest.mark.parametrize(
    ("byte", "value", "field"),
    [
        (3, 4, {"request": OperatingMode.AUTOMATIC}),
        (3, 255, {"request": OperatingMode.AUTOMATIC}),
        (5, 0x02, {"enabling": False}),
        (5, 0x03, {"enabling": False}),
        (5, 0x08, {"tool_confirmed": False}),
        (5, 0x0C, {"tool_confirmed": False}),
        (4, 255, {"tool": None}),
    ],
)
def test_a_code_that_nobody_knows_permits_nothing(
    byte: int, value: int, field: dict[str, Any]
) -> None:
    asking = replace(SEVEN, request=OperatingMode.TEACH, enabling=True, tool=3, tool_confirmed=True)
    payload = bytearray(encode_payloads(asking)[0])
    payload[byte] = value
    got = decode_payload(BY_TYPE[RobotState], 0, bytes(payload))
    assert {name: getattr(got, name) for name in field} == field
