"""Advice over bytes in structured text: run as it stands, against the node's own stream."""

import random
from dataclasses import replace
from typing import Any

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.definition import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    Pose,
    Schema,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialSender
from tests.hri_drivers.plc.conftest import everything
from tests.hri_drivers.plc.test_hri_send import STILL, inputs
from tests.hri_predict.protocol.drawn import advices
from tests.messages import make_advice, make_status

UNITS = everything()
SLOW = make_advice(
    Level.SLOW, Reason.PERSON_APPROACHING, latch_id=9, speed_limit_m_s=0.75, age_s=0.041
)
OTHERS: tuple[Message, ...] = (
    make_status(people=1, cycle=0, age_s=0.0),
    Pose(
        person=1,
        step=0,
        horizon_s=0.1,
        age_s=0.0,
        joints=tuple((n, 1.0, 1.0, 1.0) for n in range(20)),
    ),
    replace(SLOW, robot=1, level=Level.STOP),
)


class Controller:
    """A program that reads and sends bytes every 20 ms."""

    def __init__(self, tolerated: int = 0) -> None:
        self.advice, self.state = UNITS["HRI_SERIAL_ADVICE"].another(), UNITS["HRI_STATE"].another()
        self.advice.variables["Rule"].variables["TOLERATED_ERRORS"] = tolerated
        self.node, self.ms = SerialSender(), 2**32 - 100
        self.send()

    def send(self) -> None:
        self.state(**inputs(replace(STILL, counter=65_530)) | {"NowMs": self.ms})

    def wait(self, ms: int) -> "Controller":
        self.ms = (self.ms + ms) % 2**32
        return self

    def take(self, data: bytes = b"") -> int:
        """The permitted speed after these bytes have come."""
        names = ("StateCounter", "Sent", "SentMs")
        state = {name: self.state.variables[name] for name in names}
        padded = [*data, *bytes(256)][:256]
        self.advice(Bytes=padded, ByteCount=len(data), NowMs=self.ms, **state)
        speed: int = self["PermittedSpeed"]
        return speed

    def said(self, *messages: Message) -> bytes:
        """As the node writes them; an advice echoes the newest state."""
        counter = self.state.variables["StateCounter"]
        return b"".join(
            self.node.encode(replace(m, echo=counter) if isinstance(m, Advice) else m)
            for m in messages
        )

    def __getitem__(self, name: str) -> Any:
        return self.advice.variables[name]


def test_it_permits_the_speed_and_reads_the_fields() -> None:
    controller = Controller()
    assert controller.take(controller.said(OURS, SLOW)) == 750
    assert (controller["Level"], controller["Reason"]) == (Level.SLOW, Reason.PERSON_APPROACHING)
    assert (controller["LatchId"], controller["Tool"]) == (9, 255)


def test_it_takes_bytes_in_whatever_pieces_they_come() -> None:
    controller = Controller()
    stream = controller.said(OURS, *OTHERS[:1], SLOW)
    assert [controller.take(bytes([byte])) for byte in stream][-1] == 750
    stream = controller.said(*OTHERS, SLOW, SLOW)
    for at in range(0, len(stream), 100):
        controller.take(stream[at : at + 100])
    assert controller.take() == 750
    assert (controller["CrcErrors"], controller["CounterErrors"], controller["Malformed"]) == (
        0,
        0,
        0,
    )


def test_it_goes_on_across_the_wraps_of_tick_and_counter() -> None:
    controller = Controller()
    controller.take(controller.said(OURS))
    for n in range(40):
        if n == 20:
            controller.advice.variables["Rule"].variables["LastReceived"] = 65_534
            for counter in controller.node._frames._counters:
                controller.node._frames._counters[counter] = 65_535
        controller.wait(20).send()
        assert controller.take(controller.said(SLOW)) == 750
    assert controller["CounterErrors"] == 0


def test_a_schema_that_no_advice_follows_is_forgotten() -> None:
    controller = Controller()
    controller.take(controller.said(OURS))
    assert controller.wait(999).take() == 0
    assert controller["SchemaMatches"] == 1
    controller.wait(9001).send()
    assert controller.take(controller.said(SLOW)) == 0
    assert controller["SchemaMatches"] == 0
    assert controller.take(controller.said(OURS, SLOW)) == 750


@given(advices)
def test_it_permits_what_the_node_says_and_nothing_unknown(advice: Advice) -> None:
    controller = Controller()
    advice = replace(advice, robot=0, age_s=0.01)
    moves = advice.level in (Level.CLEAR, Level.WARN, Level.SLOW)
    limit = None if advice.speed_limit_m_s is None else advice.speed_limit_m_s
    # rounded down to 1 mm/s; the product itself may be off by an ulp
    want = (int(1e3 * limit + 1e-6),) if moves and limit is not None else (0,)
    speed = controller.take(controller.said(OURS, advice))
    assert speed in (*want, *(w - 1 for w in want if w > 0))
    assert controller["LatchId"] == advice.latch_id


@pytest.mark.parametrize(
    "other",
    [
        Schema(SCHEMA_VERSION - 1, SCHEMA_HASH),
        Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 1),
        Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 0x10000),
    ],
)
def test_another_schema_or_none_stops_it(other: Schema) -> None:
    controller = Controller()
    assert controller.take(controller.said(SLOW)) == 0
    assert controller.take(controller.said(OURS, SLOW)) == 750
    assert controller.take(controller.said(other, SLOW)) == 0
    assert controller["SchemaMatches"] == 0
    assert controller.take(controller.said(OURS, SLOW)) == 750


def test_silence_and_old_data_stop_it() -> None:
    controller = Controller()
    controller.take(controller.said(OURS, SLOW))
    assert controller.wait(59).take() == 750
    assert controller.wait(1).take() == 0
    assert controller["Silent"] == 1
    controller.send()
    assert controller.take(controller.said(replace(SLOW, age_s=0.203))) == 750
    assert controller.wait(1).take() == 0
    assert controller["TooOld"] == 1
    controller.wait(1000).take()
    controller.send()
    assert controller.take(controller.said(SLOW)) == 0  # the schema must come again
    assert controller.take(controller.said(OURS, SLOW)) == 750


@pytest.mark.parametrize("spoil", ["bit", "lost", "repeated", "cut", "long", "missed"])
def test_any_error_stops_it_until_the_window_passes_without_one(spoil: str) -> None:
    controller = Controller()
    assert controller.take(controller.said(OURS, SLOW)) == 750
    data = controller.said(SLOW)
    spoilt = {
        "bit": data[:20] + bytes([data[20] ^ 4 or 1]) + data[21:],
        "lost": b"",
        "repeated": data + data,
        "cut": data[:9] + b"\0",
        "long": b"\x07" * 90 + b"\0" + data,
        "missed": data,
    }[spoil]
    controller.take(spoilt)
    if spoil == "long":
        assert (controller["Malformed"], controller["CrcErrors"]) == (1, 0)
    if spoil == "missed":  # a program that lost bytes says so
        controller.advice(ByteCount=257)
    controller.wait(20).send()
    assert controller.take(controller.said(SLOW)) == 0
    assert controller["TooManyErrors"] == 1
    waited = 0
    while controller.take(controller.said(SLOW)) == 0:
        controller.wait(20).send()
        waited += 20
        assert waited <= 520
    assert waited >= 480


@pytest.mark.parametrize("message", [OURS, SLOW])
def test_a_frame_with_too_short_a_payload_is_malformed(message: Message) -> None:
    controller = Controller()
    assert controller.take(controller.said(OURS, SLOW)) == 750
    frame = cobs.decode(controller.said(message)[:-1])
    short = e2e.protect_profile4(7, frame[12:-1], int.from_bytes(frame[4:8], "big"))
    assert controller.take(cobs.encode(short) + b"\0") == 0
    assert (controller["Malformed"], controller["CounterErrors"]) == (1, 0)


def test_any_bytes_between_frames_cost_only_the_frame_they_touch() -> None:
    drawn = random.Random(4)
    controller = Controller(tolerated=10_000)
    controller.take(controller.said(OURS, SLOW))
    for _ in range(60):
        noise = drawn.randbytes(drawn.randrange(100)) + b"\0"
        controller.wait(20).send()
        assert controller.take(noise + controller.said(SLOW)) == 750


@given(st.lists(st.binary(max_size=256), max_size=4))
def test_no_bytes_at_all_make_it_move_or_fail(chunks: list[bytes]) -> None:
    controller = Controller()
    controller.take(controller.said(OURS))
    for chunk in chunks:
        assert controller.take(chunk) == 0
