"""CAN frames with wrong bits, and frames that nobody of ours sent."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.codec import Malformed, decode_payload
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    Pose,
    RobotState,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.protocol.samples import ADVICE


def flipped(data: bytes, bits: tuple[int, ...]) -> bytes:
    whole = int.from_bytes(data, "little")
    for bit in bits:
        whole ^= 1 << bit
    return whole.to_bytes(len(data), "little")


@pytest.mark.parametrize("fd", [False, True])
def test_every_single_bit_error_of_an_advice_is_refused(fd: bool) -> None:
    frames = CanSender(fd).encode(ADVICE)
    for i, frame in enumerate(frames):
        for bit in range(8 * len(frame.data)):
            receiver = CanReceiver(fd)
            broken = CanFrame(frame.arbitration_id, flipped(frame.data, (bit,)), fd)
            got = [m for f in (*frames[:i], broken, *frames[i + 1 :]) for m in receiver.feed(f)]
            assert got == []
            assert receiver.counters.crc_errors == 1


def test_double_and_triple_bit_errors_of_a_classic_frame_are_refused() -> None:
    """CRC-8 0x2F detects all of up to three wrong bits; the C decoder's test tries every triple."""
    frames = CanSender().encode(ADVICE)
    rng = np.random.default_rng(5)
    doubles = list(combinations(range(64), 2))
    triples = [tuple(rng.choice(64, 3, replace=False).tolist()) for _ in range(3000)]
    for bits in (*doubles, *triples):
        receiver = CanReceiver()
        broken = CanFrame(frames[0].arbitration_id, flipped(frames[0].data, bits))
        assert [m for f in (broken, *frames[1:]) for m in receiver.feed(f)] == []
        assert receiver.counters.crc_errors == 1, bits


@given(
    st.booleans(),
    st.lists(
        st.builds(
            CanFrame,
            st.integers(DEFAULT_BASE_ID - 2, DEFAULT_BASE_ID + 0x50) | st.integers(0, 0x1FFFFFFF),
            st.binary(max_size=64),
            st.booleans(),
            st.booleans(),
        ),
        max_size=30,
    ),
)
def test_a_receiver_survives_anything(fd: bool, frames: list[CanFrame]) -> None:
    receiver = CanReceiver(fd)
    received = 0
    for frame in frames:
        for message in receiver.feed(frame):
            assert isinstance(message, Message)
            received += 1
    assert receiver.counters.received == received


@given(st.sampled_from([Advice, RobotState, Status, Zone, Pose]), st.binary(max_size=61))
def test_any_payload_under_a_right_crc_decodes_or_is_malformed(kind: type, payload: bytes) -> None:
    definition = BY_TYPE[kind]
    data = e2e.protect_profile5(0, payload, e2e.data_id_16(definition.number))
    receiver = CanReceiver(True)
    got = receiver.feed(CanFrame(DEFAULT_BASE_ID + definition.number, data, True))
    assert len(got) + receiver.counters.malformed == 1
    for message in got:
        assert "nan" not in repr(message)


_ZONE = BY_TYPE[Zone]
HEAD = bytes((1, *bytes(_ZONE.fixed_bytes - 4)))  # of a Zone, up to FIRST, TOTAL, COUNT
_CAPSULE = _ZONE.item_bytes


@pytest.mark.parametrize(
    ("kind", "payload"),
    [
        (RobotState, bytes((10 << 4, 0)) + bytes(52)),  # ten JOINTS
        (RobotState, bytes((6 << 4, 0, 0, 0, 0, 2 << 4)) + bytes(48)),  # BASE 2
        (RobotState, bytes((7 << 4, 0)) + bytes(28)),  # without the seventh joint
        (RobotState, bytes((6 << 4, 0, 0, 0, 0, 1 << 4)) + bytes(36)),  # without its base
        (RobotState, bytes(5)),
        (Zone, HEAD + bytes((2, 3, 2)) + bytes(2 * _CAPSULE)),  # items beyond TOTAL
        (Zone, HEAD + bytes((0, 9, 4)) + bytes(4 * _CAPSULE)),  # more than a frame carries
        (Zone, HEAD + bytes((0, 3, 3)) + bytes(3 * _CAPSULE - 1)),  # one byte too short
        (Status, bytes(5)),
    ],
)
def test_values_that_cannot_be_are_malformed(kind: type[Message], payload: bytes) -> None:
    with pytest.raises(Malformed):
        decode_payload(BY_TYPE[kind], 0, payload)


def test_a_level_that_nobody_knows_is_unknown_not_clear() -> None:
    payload = bytes((77, 250)) + bytes(16)
    data = e2e.protect_profile5(0, payload, e2e.data_id_16(0))
    (got,) = CanReceiver(True).feed(CanFrame(DEFAULT_BASE_ID, data, True))
    assert isinstance(got, Advice)
    assert (got.level, got.reason) == (Level.UNKNOWN, Reason.NODE_FAULT)
