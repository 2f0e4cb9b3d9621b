"""One table of cases, the same answer from every receiver: C code, PLC example, mock controller.

``PROTOCOL.md`` says what a receiver does with each; two senders with the same ids are among them.
"""

import subprocess
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_drivers.links.can.link import CanCodec, CanLinkSettings
from hri_drivers.links.framed import SerialCodec
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame
from hri_predict.protocol.codec import encode_payloads
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.messages import Advice, Level, Message, Zone
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_sim.controllers.controller import ControllerCore, ControllerSettings
from tests.hri_drivers.c.agree import units
from tests.hri_drivers.plc.conftest import everything

LINKS = ("classic", "fd", "serial")
WIDE = ("fd", "serial")
SILENCE_MS, MAX_AGE_MS, WINDOW_MS = 150, 338, 500
MOVE = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=0.75, age_s=0.03)
STOP = replace(MOVE, level=Level.STOP, reason=Reason.PERSON_NEAR, speed_limit_m_s=0.0)


@dataclass
class Story:
    """What comes over one kind of wire, step by step, and where the receiver is asked."""

    link: str
    tolerated: int = 0
    steps: list[tuple[Any, ...]] = field(default_factory=list)
    ms: int = 0
    state_counter: int = 0

    def wait(self, ms: int) -> "Story":
        """The controller sends a RobotState each 20 ms; only multiples of them pass."""
        for _ in range(ms // 20):
            self.ms += 20
            self.steps += [("at", self.ms)]
            self.state()
        return self

    def state(self) -> "Story":
        self.state_counter += 1
        self.steps += [("state",)]
        return self

    def say(self, message: Message, counter: int = 0, change: Any = None) -> "Story":
        """A message under a counter of the protection; ``change`` alters its payload."""
        return self.put(self.units_of(message, counter, change))

    def units_of(self, message: Message, counter: int, change: Any = None) -> list[Any]:
        definition = BY_TYPE[type(message)]
        if isinstance(message, Advice):
            message = replace(message, echo=self.state_counter)
        payload = encode_payloads(message)[0]
        payload = payload if change is None else change(payload)
        return units(definition, self.link, definition.number, counter, payload)

    def put(self, sent: list[Any]) -> "Story":
        self.steps += [("rx", unit) for unit in sent]
        return self

    def ask(self) -> "Story":
        self.steps += [("ask",)]
        return self

    def started(self, counter: int = 0) -> "Story":
        return self.state().say(OURS).say(MOVE, counter)


def by_c(program: Path, story: Story) -> list[bool]:
    link = LINKS.index(story.link)
    settings = (link, 0, DEFAULT_BASE_ID, 0, SILENCE_MS, MAX_AGE_MS, story.tolerated, WINDOW_MS, 0)
    lines = ["init " + " ".join(map(str, settings))]
    for what, *more in story.steps:
        if what == "rx":
            (unit,) = more
            number = unit.arbitration_id if isinstance(unit, CanFrame) else 0
            data = unit.data if isinstance(unit, CanFrame) else unit
            lines.append(f"rx {number} {data.hex()}")
        else:
            lines.append({"at": f"at {(*more, 0)[0]}", "state": "state 1 1 0 0"}.get(what, what))
    done = subprocess.run(
        [program], input="\n".join(lines) + "\n", capture_output=True, text=True, check=True
    )
    return [row.split()[0] != "0" for row in done.stdout.splitlines()[1:] if ":" not in row]


def by_plc(story: Story) -> list[bool]:
    block = everything()["HRI_ADVICE"]
    block.variables["Rule"].variables["TOLERATED_ERRORS"] = story.tolerated
    answers, ms, counter, sent_ms = [], 0, 0, [0] * 32
    for what, *more in story.steps:
        if what == "at":
            (ms,) = more
        elif what == "state":
            counter += 1
            sent_ms[counter % 32] = ms
        frame: dict[str, Any] = {"NewFrame": 0}
        if what == "rx":
            data = [*more[0].data, *bytes(8)][:8]
            frame = {"NewFrame": 1, "Id": more[0].arbitration_id, "Data": data}
            frame["Length"] = len(more[0].data)
        block(**frame, NowMs=ms, StateCounter=counter, Sent=min(counter, 32), SentMs=sent_ms)
        if what == "ask":
            answers.append(block.variables["PermittedSpeed"] > 0)
    return answers


def by_mock(story: Story) -> list[bool]:
    fd = story.link == "fd"
    can = CanLinkSettings(name="can", interface="virtual", channel="none", fd=fd)
    settings = ControllerSettings(
        reaction_s=0.0,
        silence_timeout_s=1e-3 * SILENCE_MS,
        state_rate_hz=50.0,
        max_age_s=1e-3 * MAX_AGE_MS,
        tolerated_errors=story.tolerated,
        error_window_s=1e-3 * WINDOW_MS,
    )
    codec: Any = SerialCodec(115_200) if story.link == "serial" else CanCodec(can)
    core = ControllerCore(name="mock", settings=settings, robot=0, codec=codec, full_speed_m_s=1.0)
    answers, now_ns = [], 0
    for what, *more in story.steps:
        if what == "at":
            now_ns = 1_000_000 * more[0]
        elif what == "state":
            assert core.outgoing(now_ns, np.zeros(1), np.zeros(1))
        elif what == "rx":
            core.receive(more, now_ns)
        else:
            answers.append(core.permit(now_ns).speed_m_s > 0)
    return answers


Case = Callable[[Story], Story]
CASES: list[tuple[str, tuple[str, ...], int, Case, list[bool]]] = []


def case(expected: list[bool], links: tuple[str, ...] = LINKS, tolerated: int = 0) -> Any:
    def note(story: Case) -> Case:
        CASES.append((story.__name__, links, tolerated, story, expected))
        return story

    return note


# -- before and around the Schema


@case([False, True])
def an_advice_before_the_first_schema_is_not_kept(s: Story) -> Story:
    return s.state().say(MOVE, 0).say(OURS).ask().say(MOVE, 1).ask()


@case([False, False])
def but_its_counter_counts(s: Story) -> Story:
    return s.state().say(MOVE, 7).say(OURS).ask().say(MOVE, 7).ask()


# -- counters


@case([True, False, False, False, True], tolerated=100)
def the_third_after_a_jump_counts(s: Story) -> Story:
    s.started().ask().wait(160).ask()
    return s.say(MOVE, 100).ask().say(MOVE, 101).ask().say(MOVE, 102).ask()


@case([False, False, False, False, True], tolerated=100)
def a_repeat_of_the_last_accepted_ends_the_row(s: Story) -> Story:
    s.started().wait(160)
    for counter in (100, 101):
        s.say(MOVE, counter).ask()
    s.say(MOVE, 0)
    for counter in (102, 103, 104):
        s.say(MOVE, counter).ask()
    return s


@case([False, False, False, False, False, True], tolerated=100)
def a_repeat_within_the_row_ends_it(s: Story) -> Story:
    s.started().wait(160)
    for counter in (100, 101, 101, 102, 103, 104):
        s.say(MOVE, counter).ask()
    return s


@case([True, False])
def a_lost_message_is_an_error(s: Story) -> Story:
    return s.started().ask().say(MOVE, 2).ask()


@case([True, True, False], tolerated=1)
def more_errors_than_tolerated_stop(s: Story) -> Story:
    return s.started().ask().say(MOVE, 2).ask().say(MOVE, 4).ask()


@case([False, False, True])
def the_window_must_pass_without_an_error(s: Story) -> Story:
    s.started().say(MOVE, 2)
    for k in range(3, 3 + WINDOW_MS // 20):
        s.wait(20).say(MOVE, k)
        if k in (5, 2 + WINDOW_MS // 20 - 1):
            s.ask()
    return s.wait(20).say(MOVE, 3 + WINDOW_MS // 20).ask()


# -- two senders with the same ids


@case([True, False, False])
def another_sender_whose_counter_is_far_away(s: Story) -> Story:
    s.started(10).ask().say(STOP, 130).ask()
    return s.wait(20).say(MOVE, 11).ask()


@case([True, False, False, False])
def another_sender_a_little_ahead(s: Story) -> Story:
    s.started(10).ask().say(STOP, 12).ask()
    return s.wait(20).say(MOVE, 11).ask().say(STOP, 13).ask()


@case([True, False, False])
def another_sender_with_the_same_counter(s: Story) -> Story:
    s.started(10).ask().say(STOP, 10).ask()
    return s.wait(20).say(MOVE, 11).say(STOP, 11).ask()


@case([True, False, False])
def another_sender_one_ahead_is_accepted_once_and_then_both_err(s: Story) -> Story:
    s.started(10).ask().say(STOP, 11).ask()
    return s.wait(20).say(MOVE, 11).ask()


@case([False, False, True], ("classic",), tolerated=100)
def parts_of_two_senders_with_the_same_counter_make_no_message(s: Story) -> Story:
    s.state().say(OURS)
    (a0, a1, a2), (b0, b1, b2) = s.units_of(STOP, 0), s.units_of(MOVE, 0)
    s.put([a0, b0, b1, a1, a2, b2]).ask()
    (a0, a1, a2), (b0, b1, b2) = s.units_of(STOP, 1), s.units_of(MOVE, 1)
    s.put([b0, a0, b1, b2, a1, a2]).ask()
    return s.say(MOVE, 2).ask()


@case([True, False], tolerated=100)
def long_after_two_senders_only_one_is_believed(s: Story) -> Story:
    """With many errors tolerated the one that is in order is believed: so tolerate none."""
    s.started(0)
    for k in range(1, 30):
        s.wait(20).say(MOVE, k)
        if k % 2 == 0:
            s.say(STOP, 128 + k // 2)
    return s.ask().wait(160).ask()


# -- parts and lengths


@case([True, False], ("classic",))
def a_part_that_comes_again_after_the_message(s: Story) -> Story:
    s.started().ask()
    return s.put(s.units_of(MOVE, 0)[2:]).ask()


@case([True, False], ("classic",))
def a_message_without_its_last_part(s: Story) -> Story:
    s.started().ask().put(s.units_of(MOVE, 1)[:2])
    return s.say(MOVE, 2).ask()


@case([True, False], ("classic",))
def a_frame_of_another_length(s: Story) -> Story:
    s.started().ask()
    return s.put([replace(f, data=f.data[:7]) for f in s.units_of(MOVE, 1)[:1]]).ask()


@case([True, False])
def a_wrong_crc(s: Story) -> Story:
    s.started().ask()
    unit, *_ = s.units_of(MOVE, 1)
    data = unit.data if isinstance(unit, CanFrame) else unit
    data = data[:5] + bytes((data[5] ^ 2,)) + data[6:]
    return s.put([replace(unit, data=data) if isinstance(unit, CanFrame) else data]).ask()


@case([True, True], WIDE)
def a_longer_payload_is_read_as_far_as_the_table_goes(s: Story) -> Story:
    return s.started().ask().say(MOVE, 1, lambda p: p + b"\x07" * 3).wait(20).ask()


@case([True, False], WIDE)
def a_shorter_payload_is_malformed(s: Story) -> Story:
    return s.started().ask().say(MOVE, 1, lambda p: p[:5]).ask()


# -- items of Zone and Pose


def items(first: int, total: int, count: int) -> Any:
    room = bytes(3 * BY_TYPE[Zone].item_bytes)
    return lambda p: p[:7] + bytes((first, total, count)) + p[10:] + room


for first, total, count, sound in (
    (0, 0, 0, True),
    (5, 9, 0, True),
    (6, 9, 3, True),
    (7, 9, 3, False),
    (0, 9, 4, False),
    (255, 255, 1, False),
):

    @case([True, sound], WIDE)
    def zone(s: Story, numbers: Any = (first, total, count)) -> Story:
        zone = Zone(person=1, step=0, horizon_s=0.1, capsules=(), age_s=0.0)
        return s.started().ask().say(zone, 0, items(*numbers)).ask()

    CASES[-1] = (f"zone_{first}_{total}_{count}", *CASES[-1][1:])


@pytest.mark.parametrize(
    ("link", "tolerated", "story", "expected"),
    [
        pytest.param(link, tolerated, story, expected, id=f"{name}-{link}")
        for name, links, tolerated, story, expected in CASES
        for link in links
    ],
)
def test_every_receiver_gives_the_same_answer(
    build: Any, link: str, tolerated: int, story: Case, expected: list[bool]
) -> None:
    told = story(Story(link, tolerated))
    answers = {"c": by_c(build(Path(__file__).with_name("driver.c")), told)}
    answers["mock controller"] = by_mock(told)
    if link == "classic":
        answers["plc"] = by_plc(told)
    assert answers == dict.fromkeys(answers, expected)
