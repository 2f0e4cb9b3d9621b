"""Serial frames: round trips, resynchronisation, bit errors, hostile input."""

from dataclasses import replace
from math import nan

import pytest
from cobs import cobs
from fastcrc import crc32
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import MAX_ENCODED, SerialReceiver, SerialSender
from hri_predict.protocol.wire import wire_bits
from tests.hri_predict.protocol.samples import ADVICE
from tests.messages import make_state

CAPSULES = tuple(
    ZoneCapsule(i, (0.125 * i, -1.0, 2.0), (0.25, 0.5, 1.0 + i), 0.1 + i / 8) for i in range(17)
)
JOINTS = tuple((i, 0.5 * i, -0.25 * i, 1.0) for i in range(21))
MESSAGES: list[Message] = [
    ADVICE,
    Status(
        node_state=NodeState.DEGRADED,
        reason=Reason.PREDICTOR_LATE,
        people=3,
        predictor=2,
        cycle=99,
        age_s=None,
    ),
    make_state((0.5, -1.25, 3.0), (0.0, 0.125, -2.0), counter=65535, robot=7),
    Schema(1, 0xDEADBEEF),
    Acknowledge(5, 1 << 31),
]


def advice(i: int) -> Advice:
    return Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, latch_id=i)


def ids(messages: list[Message]) -> list[int]:
    return [m.latch_id for m in messages if isinstance(m, Advice)]


def test_round_trip() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    stream = b"".join(sender.encode(m) for m in MESSAGES)
    assert receiver.feed(stream) == MESSAGES
    assert receiver.counters.received == len(MESSAGES)


def test_long_messages_come_as_pieces_that_stand_alone() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    got = receiver.feed(
        sender.encode(Zone(person=9, step=4, horizon_s=0.16, capsules=CAPSULES, age_s=0.02))
    )
    assert [m for m in got if isinstance(m, Zone)] == [
        Zone(person=9, step=4, horizon_s=0.16, capsules=CAPSULES[i : i + 3], age_s=0.02)
        for i in range(0, 17, 3)
    ]
    got = receiver.feed(sender.encode(Pose(person=9, step=4, horizon_s=0.16, joints=JOINTS)))
    assert [m for m in got if isinstance(m, Pose)] == [
        Pose(person=9, step=4, horizon_s=0.16, joints=JOINTS[i : i + 7]) for i in range(0, 21, 7)
    ]


def test_who_reads_no_zones_gets_them_counted_and_without_capsules() -> None:
    zone = Zone(person=9, step=4, horizon_s=0.16, capsules=CAPSULES, age_s=0.02)
    receiver = SerialReceiver(with_items=False)
    got = receiver.feed(SerialSender().encode(zone))
    assert got == [replace(zone, capsules=())] * 6
    assert receiver.counters.received == 6


@given(st.lists(st.integers(1, 40), max_size=40))
def test_bytes_may_come_in_any_pieces(sizes: list[int]) -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    stream = b"".join(sender.encode(m) for m in MESSAGES)
    got: list[Message] = []
    for size in sizes:
        got += receiver.feed(stream[:size])
        stream = stream[size:]
    assert got + receiver.feed(stream) == MESSAGES


@given(st.lists(st.binary(max_size=200), max_size=20))
def test_a_receiver_survives_anything_and_keeps_little(chunks: list[bytes]) -> None:
    receiver = SerialReceiver()
    for chunk in chunks:
        assert receiver.feed(chunk) == []
        assert len(receiver._stream._buffer) <= MAX_ENCODED


@given(st.binary(max_size=400))
def test_after_garbage_it_is_in_step_within_one_frame(garbage: bytes) -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    receiver.feed(garbage)
    receiver.feed(sender.encode(advice(1)))  # may be lost to the garbage before it
    assert ids(receiver.feed(sender.encode(advice(2)))) == [2]


@given(st.data())
def test_a_truncated_frame_costs_itself_and_its_neighbour_at_most(data: st.DataObject) -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    frames = [sender.encode(advice(i)) for i in range(6)]
    frames[2] = frames[2][: data.draw(st.integers(0, len(frames[2])))]
    got = ids(receiver.feed(b"".join(frames)))
    assert set(got) >= {0, 1, 4, 5}
    assert got == sorted(got)


def test_every_single_bit_error_is_refused() -> None:
    good = SerialSender().encode(ADVICE)
    for bit in range(8 * len(good)):
        broken = bytearray(good)
        broken[bit // 8] ^= 1 << bit % 8
        receiver = SerialReceiver()
        assert receiver.feed(bytes(broken) + b"\0") == []
        counters = receiver.counters
        assert counters.crc_errors + counters.malformed >= 1, bit


@given(st.sets(st.integers(0, 8 * 30), min_size=2, max_size=24))
def test_many_bit_errors_are_refused(bits: set[int]) -> None:
    broken = bytearray(SerialSender().encode(ADVICE))
    for bit in bits:
        broken[bit // 8] ^= 1 << bit % 8
    assert SerialReceiver().feed(bytes(broken) + b"\0") == []


def test_repeated_and_older_frames_are_never_fresh() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    frames = [sender.encode(advice(i)) for i in range(8)]
    order = (0, 0, 1, 3, 2, 4, 1, 4, 5)
    assert ids(receiver.feed(b"".join(frames[i] for i in order))) == [0, 1, 3, 4, 5]
    assert receiver.counters.counter_errors == 5  # 0, 2 lost, then 2, 1 and 4 too late


def test_streams_of_different_messages_have_counters_of_their_own() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    for i in range(20):
        for robot in range(3):
            receiver.feed(
                sender.encode(Advice(robot=robot, level=Level.WARN, reason=Reason.NONE, latch_id=i))
            )
        if i % 7 == 0:
            receiver.feed(sender.encode(Schema(1, 2)))
    assert receiver.counters.counter_errors == 0
    assert receiver.counters.received == 63


@given(st.integers(0, 0x5F), st.binary(max_size=58))
def test_any_payload_under_a_right_crc_is_decoded_or_counted(number: int, payload: bytes) -> None:
    frame = e2e.protect_profile4(0, payload, e2e.data_id_32(number))
    receiver = SerialReceiver()
    got = receiver.feed(cobs.encode(frame) + b"\0")
    assert len(got) + receiver.counters.malformed + receiver.counters.ignored == 1


def test_a_frame_without_end_is_skipped_to_its_end() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    assert receiver.feed(b"\x55" * 100_000) == []
    assert len(receiver._stream._buffer) <= MAX_ENCODED
    assert receiver.counters.malformed == 1
    assert ids(receiver.feed(b"\0" + sender.encode(advice(3)))) == [3]


def test_a_frame_without_end_in_pieces_counts_once_and_leaves_no_rest() -> None:
    sender, receiver = SerialSender(), SerialReceiver()
    for _ in range(20):
        assert receiver.feed(b"\x55" * 50) == []
    good = sender.encode(advice(1))
    assert receiver.feed(good) == []  # the end of what has no end
    assert receiver.counters.malformed == 1
    assert receiver.counters.crc_errors == 0
    assert ids(receiver.feed(sender.encode(advice(2)))) == [2]


def test_a_wrong_length_under_a_right_crc_is_refused() -> None:
    head = bytes((0, 200, 0, 0)) + e2e.data_id_32(0x42).to_bytes(4, "big")
    payload = bytes(6)
    frame = head + crc32.autosar(head + payload).to_bytes(4, "big") + payload
    receiver = SerialReceiver()
    assert receiver.feed(cobs.encode(frame) + b"\0") == []
    assert receiver.counters.crc_errors == 1


def test_the_schema_of_a_restarted_node_is_heard_at_once() -> None:
    receiver = SerialReceiver()
    for run in range(3):
        sender = SerialSender()
        for _ in range(1 + 20 * run):
            assert receiver.feed(sender.encode(Schema(1, run))) == [Schema(1, run)]
    assert receiver.counters.counter_errors == 0


def test_a_zone_that_is_no_number_never_arrives() -> None:
    receiver = SerialReceiver()
    zone = Zone(
        person=1,
        step=0,
        horizon_s=0.0,
        capsules=(ZoneCapsule(0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), nan),),
    )
    assert receiver.feed(SerialSender().encode(zone)) == []
    assert receiver.counters.malformed == 1


@pytest.mark.parametrize(
    "message",
    [
        *MESSAGES,
        Zone(person=1, step=0, horizon_s=0.0, capsules=CAPSULES),
        Pose(person=1, step=0, horizon_s=0.0, joints=JOINTS),
    ],
)
def test_wire_bits_are_those_of_the_bytes(message: Message) -> None:
    items = None
    if isinstance(message, Zone | Pose):
        items = len(message.capsules if isinstance(message, Zone) else message.joints)
    bits = wire_bits(type(message), "serial", items=items)
    assert bits == (10 * len(SerialSender().encode(message)), 0)
