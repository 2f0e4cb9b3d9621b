"""Framing and recipes of RTDE: any bytes, cut anywhere, and every refusal in one line."""

import contextlib
import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.rtde.link import RtdeCodec
from hri_drivers.links.rtde.packets import (
    Kind,
    Packet,
    Recipe,
    Splitter,
    asks_outputs,
    framed,
    recipe_number,
    text_of,
    versions_of,
)
from hri_drivers.links.rtde.robot import OUTPUTS, mode_of
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import RobotMode, RobotState

TWO = Recipe(("a", "b"), ("UINT32", "DOUBLE"))


def state_data(stamp: float = 1.0, q: float = 0.5, robot_mode: int = 7) -> bytes:
    return struct.pack(">d6d6diiI", stamp, *[q] * 6, *[0.1] * 6, robot_mode, 1, 2)


def test_the_bytes_of_the_published_tables():
    """Size of 5 bytes, 'V', version 2; size of 12 bytes plus a name, 'O', 125 as a double."""
    assert framed(Kind.VERSION, b"\0\2") == bytes.fromhex("0005 56 0002")
    asked = framed(Kind.OUTPUTS, asks_outputs(Recipe(("actual_q",), ("VECTOR6D",)), 125))
    assert asked == bytes.fromhex("0013 4f 405f400000000000") + b"actual_q"


@given(
    packets=st.lists(st.tuples(st.sampled_from(list(Kind)), st.binary(max_size=200)), max_size=8),
    cuts=st.lists(st.integers(0, 1700), max_size=8),
)
def test_packets_are_found_wherever_the_stream_is_cut(packets, cuts):
    stream = b"".join(framed(kind, data) for kind, data in packets)
    places = [0, *sorted(min(cut, len(stream)) for cut in cuts), len(stream)]
    splitter = Splitter()
    found = [packet for a, b in pairwise(places) for packet in splitter.feed(stream[a:b])]
    assert found == [(int(kind), data) for kind, data in packets]


@given(st.lists(st.binary(max_size=300), max_size=6))
def test_any_bytes_are_packets_or_one_error(pieces):
    splitter, codec = Splitter(), RtdeCodec()
    with contextlib.suppress(LinkError):
        for piece in pieces:
            for kind, data in splitter.feed(piece):
                for message in codec.decode(Packet(kind, data)):
                    assert isinstance(message, RobotState)


@given(kind=st.integers(0, 255), data=st.binary(max_size=200))
def test_any_packet_is_decoded_or_counted(kind, data):
    codec = RtdeCodec()
    found = codec.decode(Packet(kind, data))
    counters = codec.counters
    assert len(found) + counters.malformed + counters.ignored == 1


@given(st.binary(max_size=600))
def test_any_reply_is_a_number_a_text_or_one_line(data):
    assert text_of(data).isprintable()
    assert len(versions_of(data)) in (0, 4)
    with contextlib.suppress(LinkError):
        assert recipe_number(TWO, data, "input") == data[0]


@pytest.mark.parametrize(
    ("types", "said"),
    [
        (b"UINT32,IN_USE", "input 'b' is in use"),
        (b"NOT_FOUND,DOUBLE", "does not know the input 'a'"),
        (b"UINT32,INT32", "input 'b' is of type 'INT32', not DOUBLE"),
        (b"UINT32", "answers 2 input names with 1 types"),
    ],
)
def test_a_recipe_that_is_refused_says_which_name(types, said):
    with pytest.raises(LinkError, match=said):
        recipe_number(TWO, b"\1" + types, "input")


def test_a_state_has_joints_mode_and_a_counter_that_follows_the_time_stamp():
    codec = RtdeCodec()
    codec.robot = 3
    first, again, later = (
        codec.decode(Packet(Kind.DATA, state_data(stamp)))[0] for stamp in (1.0, 1.0, 1.008)
    )
    assert isinstance(first, RobotState)
    assert (first.robot, first.mode, first.positions) == (3, RobotMode.AUTOMATIC, (0.5,) * 6)
    assert first.velocities == (0.1,) * 6
    assert isinstance(again, RobotState)
    assert isinstance(later, RobotState)
    assert (again.counter - first.counter, later.counter - first.counter) == (0, 1)


def test_a_time_that_goes_back_repeats_the_counter_until_a_new_connection():
    codec = RtdeCodec()

    def counter(stamp: float) -> int:
        (state,) = codec.decode(Packet(Kind.DATA, state_data(stamp)))
        assert isinstance(state, RobotState)
        return state.counter

    first = counter(200.0)
    assert [counter(stamp) for stamp in (199.0, 200.0, 199.0)] == [first] * 3
    codec.reset()
    assert counter(1.0) == first + 1


def test_a_recipe_with_the_number_0_is_refused():
    with pytest.raises(LinkError, match="number 0, so it accepts none"):
        recipe_number(TWO, b"\0UINT32,DOUBLE", "input")


def test_a_data_package_of_another_length_is_counted():
    codec = RtdeCodec()
    assert codec.decode(Packet(Kind.DATA, state_data()[:-1])) == []
    assert codec.decode(Packet(Kind.DATA, state_data(float("nan")))) == []
    assert codec.counters.malformed == 2
    assert OUTPUTS.layout.size == len(state_data())


@pytest.mark.parametrize(
    ("robot_mode", "safety_mode", "runtime_state", "mode"),
    [
        (7, 1, 2, RobotMode.AUTOMATIC),
        (7, 2, 4, RobotMode.AUTOMATIC),
        (7, 1, 1, RobotMode.MANUAL),
        (7, 3, 2, RobotMode.UNKNOWN),
        (7, 5, 4, RobotMode.UNKNOWN),
        (7, 4, 2, RobotMode.MANUAL),
        (7, 99, 2, RobotMode.UNKNOWN),
        (6, 1, 1, RobotMode.MANUAL),
        (3, 1, 1, RobotMode.DRIVES_OFF),
        (-1, 1, 1, RobotMode.UNKNOWN),
    ],
)
def test_only_a_robot_that_its_program_moves_is_automatic(
    robot_mode, safety_mode, runtime_state, mode
):
    assert mode_of(robot_mode, safety_mode, runtime_state) is mode
