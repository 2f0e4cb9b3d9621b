"""The structured-text example: run as it stands, against the node's own frames."""

from dataclasses import replace
from typing import Any

import pytest

from hri_predict.protocol import e2e
from hri_predict.protocol.can import CanSender
from hri_predict.protocol.definition import (
    BY_TYPE,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    frame_table,
)
from hri_predict.protocol.generate.c_messages import name_of
from hri_predict.protocol.generate.examples import fields_of
from hri_predict.protocol.generate.st_messages import camel
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    OperatingMode,
    RobotState,
    Schema,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from tests.hri_drivers.plc.structured_text import Units

SLOW = Advice(
    robot=0,
    level=Level.SLOW,
    reason=Reason.PERSON_APPROACHING,
    latch_id=9,
    speed_limit_m_s=0.75,
    age_s=0.041,
    mode=OperatingMode.MUTED,
    tool=3,
)


EVERY = replace(
    SLOW,
    separation_m=1.5,
    predicted_separation_m=-0.25,
    time_to_breach_s=3.999,
    body_part=41,
    robot_link=22,
    echo=65_531,
)
VERSION_1 = Schema(1, 0xD680A301)  # the last one of that version


class Controller:
    """The function block in a controller that sends RobotState every 20 ms."""

    def __init__(self, block: Any):
        self.block, self.node = block, CanSender()
        self.ms = 2**32 - 100  # the tick wraps soon
        self.counter, self.sent, self.sent_ms = 65_530, 0, [0] * 32
        self.state()

    def tolerate(self, errors: int) -> "Controller":
        self.block.variables["Rule"].variables["TOLERATED_ERRORS"] = errors
        return self

    def state(self) -> None:
        self.counter = (self.counter + 1) % 65536
        self.sent_ms[self.counter % 32] = self.ms
        self.sent = min(self.sent + 1, 32)

    def wait(self, ms: int) -> "Controller":
        self.ms = (self.ms + ms) % 2**32
        return self

    def call(self, frame: Any = None) -> int:
        more: dict[str, Any] = {}
        if frame is not None:
            more = {
                "Id": frame.arbitration_id,
                "Length": len(frame.data),
                "Data": [*frame.data, *bytes(8)][:8],
            }
        answered = {"StateCounter": self.counter, "Sent": self.sent, "SentMs": self.sent_ms}
        self.block(NewFrame=int(frame is not None), NowMs=self.ms, **answered, **more)
        speed: int = self.block.variables["PermittedSpeed"]
        return speed

    def hear(self, *messages: Message) -> int:
        for message in messages:
            if isinstance(message, Advice) and message.echo is None:
                message = replace(message, echo=min(self.counter, 65534))
            for frame in self.node.encode(message):
                self.call(frame)
        return self.call()

    def __getitem__(self, name: str) -> Any:
        return self.block.variables[name]


@pytest.fixture
def controller(units: Units) -> Controller:
    return Controller(units["HRI_ADVICE"])


def test_its_arrays_have_room_for_the_messages_of_the_definition(units: Units) -> None:
    block = units["HRI_ADVICE"].variables
    assert len(block["PartSeen"]) == BY_TYPE[Advice].parts
    assert len(block["Payload"]) == BY_TYPE[Advice].fixed_bytes
    state = units["HRI_STATE"].variables
    assert (len(state["Payload"]), len(state["Needed"])) == (
        BY_TYPE[RobotState].fixed_bytes,
        BY_TYPE[RobotState].parts,
    )


def test_its_crc_is_that_of_every_frame(units: Units) -> None:
    payload = b"\x01\x80\xff\x00\x55\xaa"
    for number in frame_table(classic=True):
        frame = e2e.protect_profile2(7 * number & 0xFF, payload, e2e.data_id_list(number))
        assert units["HRI_CRC8"]([*frame], number + 1) == frame[0]


def test_it_reads_the_fields_and_permits_the_speed(controller: Controller) -> None:
    assert controller.hear(OURS, SLOW) == 750
    assert (controller["Level"], controller["Reason"]) == (Level.SLOW, Reason.PERSON_APPROACHING)
    assert controller["LatchId"] == 9
    assert (controller["OperatingMode"], controller["Tool"]) == (OperatingMode.MUTED, 3)
    assert (controller["CrcErrors"], controller["CounterErrors"]) == (0, 0)


def test_every_field_of_an_advice_is_read(controller: Controller, units: Units) -> None:
    controller.hear(OURS, EVERY)
    fields = units["HRI_ADVICE_FIELDS"]
    fields(Payload=controller["AdvicePayload"])
    read = fields.variables
    raw = {camel(name_of(f, BY_TYPE[Advice])): raw for f, _, raw in fields_of(EVERY)}
    signed = {name: value for name, value in raw.items() if name.startswith("Predicted")}
    assert {n: read[n] for n in raw} == raw | {n: v - 65536 for n, v in signed.items()}


def test_it_goes_on_across_the_wraps_of_tick_and_counters(controller: Controller) -> None:
    controller.hear(OURS)
    for _ in range(300):
        controller.wait(20).state()
        assert controller.wait(20).hear(SLOW) == 750
    assert controller["CounterErrors"] == 0


@pytest.mark.parametrize("level", list(Level))
def test_only_clear_warn_and_slow_permit_motion(controller: Controller, level: Level) -> None:
    moves = level in (Level.CLEAR, Level.WARN, Level.SLOW)
    assert controller.hear(OURS, replace(SLOW, level=level)) == (750 if moves else 0)
    assert controller.hear(replace(SLOW, speed_limit_m_s=None)) == 0


def test_silence_stops_it_and_a_long_one_closes_the_schema(controller: Controller) -> None:
    controller.hear(OURS, SLOW)
    assert controller.wait(59).call() == 750
    assert controller.wait(1).call() == 0
    assert controller["Silent"] == 1
    assert controller["LatchId"] == 0  # the lamp at the button is dark: nobody would hear it
    assert controller["SchemaMatches"] == 1
    assert controller.wait(940).call() == 0
    assert controller.wait(2**32 - 1000).call() == 0  # the tick is where it was
    controller.state()
    assert controller.hear(SLOW) == 0
    assert controller.hear(OURS, SLOW) == 750


def test_a_schema_that_no_advice_follows_is_forgotten(controller: Controller) -> None:
    """At the start: another node, of another version, may send the Advice that comes later."""
    controller.hear(OURS)
    controller.wait(999).call()
    assert controller["SchemaMatches"] == 1
    controller.wait(1).call()
    assert controller["SchemaMatches"] == 0
    controller.wait(9000).state()
    assert controller.hear(SLOW) == 0
    assert controller.hear(OURS, SLOW) == 750


def test_after_a_silence_as_well_a_schema_that_no_advice_follows_is_forgotten(
    controller: Controller,
) -> None:
    controller.hear(OURS, SLOW)
    controller.wait(5000).call()
    controller.hear(OURS)
    controller.wait(1000).state()
    assert controller.hear(SLOW) == 0
    assert controller["SchemaMatches"] == 0
    assert controller.hear(OURS, SLOW) == 750


def test_a_schema_is_known_until_then_and_each_that_comes_prolongs_it(
    controller: Controller,
) -> None:
    controller.hear(OURS)
    controller.wait(999).hear(OURS)
    controller.wait(999).state()
    assert controller.hear(SLOW) == 750
    controller.wait(5000).hear(OURS)
    controller.wait(999).state()
    assert controller.hear(SLOW) == 750


def test_with_a_schema_that_no_advice_follows_the_counters_are_forgotten(
    controller: Controller,
) -> None:
    controller.hear(SLOW, OURS)
    for _ in range(30):
        controller.node.encode(SLOW)  # lost
    controller.wait(1000).hear(OURS)
    controller.state()
    assert controller.hear(SLOW) == 750
    assert controller["CounterErrors"] == 0


def test_parts_from_before_a_long_silence_complete_nothing(controller: Controller) -> None:
    controller.tolerate(100).hear(OURS, SLOW)
    first, *rest = controller.node.encode(replace(SLOW, echo=controller.counter + 1))
    controller.call(first)
    controller.wait(1100).call()
    controller.state()
    controller.hear(OURS)
    for frame in rest:
        assert controller.call(frame) == 0
    assert controller.hear(SLOW) == 750


def test_another_schema_or_none_stops_it(controller: Controller) -> None:
    assert controller.hear(SLOW) == 0
    assert controller.hear(OURS, SLOW) == 750
    others = (
        Schema(SCHEMA_VERSION - 1, SCHEMA_HASH),
        Schema(SCHEMA_VERSION, SCHEMA_HASH ^ 0x10000),
        Schema(SCHEMA_VERSION, 0),
        VERSION_1,
    )
    for other in others:
        assert controller.hear(other) == 0
        assert controller.hear(SLOW) == 0
        assert controller.hear(OURS) == 0
        assert controller.hear(SLOW) == 750


def test_corrupt_incomplete_repeated_and_old_advice_is_not_heard(controller: Controller) -> None:
    controller.tolerate(100).hear(OURS)
    first, second, third = controller.node.encode(replace(SLOW, echo=controller.counter))
    for frame in (first, second, replace(third, data=third.data[:-1] + b"\x01")):
        assert controller.call(frame) == 0
    assert controller["CrcErrors"] == 1
    assert controller.call(third) == 750
    for _ in range(4):
        controller.wait(40)
        for frame in (first, second, third):  # a gateway repeats it
            controller.call(frame)
    assert controller.call() == 0


def test_after_a_jump_the_third_in_a_row_counts(controller: Controller) -> None:
    controller.tolerate(100).hear(OURS, SLOW)
    controller.wait(160).state()
    for _ in range(20):
        controller.node.encode(SLOW)  # lost
    assert [controller.hear(SLOW) for _ in range(4)] == [0, 0, 750, 750]


def test_what_is_too_old_or_of_no_known_age_stops_it(controller: Controller) -> None:
    controller.hear(OURS)
    assert controller.hear(replace(SLOW, age_s=0.166)) == 750
    assert controller.wait(37).call() == 750
    assert controller.wait(1).call() == 0
    assert controller["TooOld"] == 1
    controller.state()
    assert controller.hear(SLOW) == 750
    for change in ({"age_s": None}, {"echo": 65_535 - 40}, {"echo": 3}):
        assert controller.hear(replace(SLOW, **change)) == 0
    controller.wait(100).state()
    late = replace(SLOW, age_s=0.065, echo=(controller.counter - 1) % 65536)  # 139 ms and more
    assert controller.wait(40).hear(late) == 0


def test_frames_of_others_and_of_other_robots_are_nothing_to_it(controller: Controller) -> None:
    assert controller.hear(OURS, SLOW, replace(SLOW, robot=1, level=Level.STOP)) == 750
    controller.call(replace(controller.node.encode(OURS)[0], arbitration_id=0x100))
    other = replace(controller.node.encode(OURS)[0], arbitration_id=0x68A, data=b"\x00" * 3)
    controller.call(other)
    assert controller.call() == 750
    assert controller["CrcErrors"] == controller["Malformed"] == 0


def test_without_a_window_an_error_stops_it_for_ever(controller: Controller) -> None:
    """As in C: 0 must not mean that errors are forgotten at once."""
    controller.block.variables["Rule"].variables["ERROR_WINDOW_MS"] = 0
    assert controller.hear(OURS, SLOW) == 750
    frames = controller.node.encode(replace(SLOW, echo=controller.counter))
    for frame in (*frames, frames[0]):
        controller.call(frame)
    for _ in range(100):
        controller.wait(20).state()
        assert controller.hear(SLOW) == 0
    assert controller["TooManyErrors"] == 1


@pytest.mark.parametrize("spoil", ["crc", "lost", "repeated", "length", "part"])
def test_any_error_stops_it_until_the_window_passes_without_one(
    controller: Controller, spoil: str
) -> None:
    assert controller.hear(OURS, SLOW) == 750
    frames = controller.node.encode(replace(SLOW, echo=controller.counter))
    if spoil == "crc":
        frames[0] = replace(frames[0], data=frames[0].data[:-1] + b"\x55")
    elif spoil == "length":
        frames.append(replace(frames[0], data=frames[0].data[:5]))
    elif spoil == "repeated":
        frames.append(frames[0])
    elif spoil == "part":
        frames.pop()
    for frame in frames if spoil != "lost" else ():
        controller.call(frame)
    controller.wait(20).state()
    assert controller.hear(SLOW) == 0
    assert controller["TooManyErrors"] == 1
    began_ms = controller.ms
    while controller.hear(SLOW) == 0:
        controller.wait(20).state()
    assert 480 <= (controller.ms - began_ms) % 2**32 <= 520
