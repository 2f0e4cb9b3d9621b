"""Messages under keys: round trips, foreign keys, hostile payloads."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.keyed import (
    MAX_PAYLOAD,
    Keyed,
    KeyedReceiver,
    KeyedSender,
    key_of,
    prefix,
    split_key,
)
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    Pose,
    Schema,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from tests.messages import make_state, make_status

STATE = make_state((0.5, -1.25), (0.0, 0.125), counter=7, robot=3)
MESSAGES: dict[str, Message] = {
    "advice/1": Advice(robot=1, level=Level.SLOW, reason=Reason.PERSON_NEAR),
    "state/3": STATE,
    "status": make_status(people=2, cycle=9),
    "schema": Schema(1, 0xDEADBEEF),
    "ack": Acknowledge(5, 9),
}
JOINTS = tuple((i, 0.5 * i, -0.25 * i, 1.0) for i in range(21))
CAPSULES = tuple(ZoneCapsule(i, (0.0, 0.5, 1.0), (1.0, 0.5, 1.0), 0.25) for i in range(17))


@pytest.mark.parametrize("key", MESSAGES)
def test_a_message_has_its_key_and_comes_back(key: str) -> None:
    unit = KeyedSender().encode(MESSAGES[key])
    assert unit.key == key == key_of(MESSAGES[key])
    assert KeyedReceiver().feed(unit) == [MESSAGES[key]]


@pytest.mark.parametrize(
    ("key", "message", "pieces"),
    [
        ("pose", Pose(person=1, step=2, horizon_s=0.5, joints=JOINTS), 3),
        ("zone", Zone(person=1, step=2, horizon_s=0.5, capsules=CAPSULES), 6),
    ],
)
def test_a_long_message_is_one_payload(key: str, message: Message, pieces: int) -> None:
    unit = KeyedSender().encode(message)
    assert unit.key == key
    found = KeyedReceiver().feed(unit)
    assert len(found) == pieces
    parts = [item for m in found for item in (m.joints if key == "pose" else m.capsules)]  # type: ignore[union-attr]
    assert parts == list(JOINTS if key == "pose" else CAPSULES)


def test_under_anothers_key_it_is_refused_and_spoils_no_sequence() -> None:
    sender, receiver = KeyedSender(), KeyedReceiver()
    for key in ("ack", "state/2", "status", "scene", "anything"):
        assert receiver.feed(Keyed(key, sender.encode(STATE).data)) == []
    assert receiver.counters.malformed == 5
    sender = KeyedSender()  # had the forged ones counted, its counters would come too late
    assert receiver.feed(sender.encode(STATE)) == [STATE]


def test_a_repeated_payload_is_not_fresh() -> None:
    unit, receiver = KeyedSender().encode(STATE), KeyedReceiver()
    assert receiver.feed(unit) == [STATE]
    assert receiver.feed(unit) == []
    assert receiver.counters.counter_errors == 1


@given(data=st.binary(max_size=300), key=st.sampled_from([*MESSAGES, "pose", "zone", ""]))
def test_random_payloads_are_counted_and_give_nothing(data: bytes, key: str) -> None:
    receiver = KeyedReceiver()
    assert receiver.feed(Keyed(key, data)) == []
    assert receiver.counters.malformed + receiver.counters.crc_errors >= 1


@given(bit=st.integers(0, 8 * 18 - 1))
def test_no_flipped_bit_is_accepted(bit: int) -> None:
    payload = bytearray(KeyedSender().encode(MESSAGES["status"]).data)
    assert len(payload) == 18
    payload[bit // 8] ^= 1 << bit % 8
    assert KeyedReceiver().feed(Keyed("status", bytes(payload))) == []


def test_a_cut_payload_gives_what_is_whole() -> None:
    unit = KeyedSender().encode(Pose(person=1, step=2, horizon_s=0.5, joints=JOINTS))
    receiver = KeyedReceiver()
    assert len(receiver.feed(Keyed("pose", unit.data[:-1]))) == 2
    assert receiver.counters.malformed == 1


def test_too_long_a_payload_is_not_looked_at() -> None:
    frame = e2e.protect_profile4(0, b"", e2e.data_id_32(0x44))
    receiver = KeyedReceiver()
    assert receiver.feed(Keyed("zone", frame * (MAX_PAYLOAD // len(frame) + 1))) == []
    assert receiver.counters.malformed == 1
    assert receiver.counters.crc_errors == 0


def test_keys_are_taken_apart() -> None:
    assert split_key(prefix("plant-1", "press_3") + "advice/7") == (
        "plant-1",
        "press_3",
        "advice/7",
    )
    strange = "|hri/a/status|hri/a/b/c/d/e|hri/a b/c/status|x/a/b/status|hri/a/b/advice/77"
    strange += "|hri/a/*/status|hri/a/b/status/|hri/\n/b/status"
    for key in strange.split("|"):
        assert split_key(key) is None
