"""The C code's rule: silent, stale, corrupt, out of order or of an unknown schema means stop."""

import struct
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from cobs import cobs
from fastcrc import crc32

from hri_predict.protocol import e2e
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.fields import ROBOT_STRIDE
from hri_predict.protocol.messages import Acknowledge, Advice, Level, Message, RobotState, Schema
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender

LINKS = ("classic", "fd", "serial")
ROBOT = 2
SILENCE_MS, MAX_AGE_MS, WINDOW_MS, FORGET_MS = 150, 330, 500, 1000
CLEAR = Advice(robot=ROBOT, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=0.9, age_s=0.05)
START_MS = 0xFFFF_FE00  # half a second before the tick wraps
FIRST = 65_530  # STATE_COUNTER wraps soon as well


class Line:
    """A node that advises and a receiver that answers, written as a script for the driver."""

    def __init__(self, program: Path, link: str, tolerated: int = 0, window_ms: int = WINDOW_MS):
        self.program, self.link = program, link
        self.sender: Any = SerialSender() if link == "serial" else CanSender(link == "fd")
        self.ms, self.echo = 0, FIRST
        code = LINKS.index(link)
        numbers = (code, ROBOT, DEFAULT_BASE_ID, 0, SILENCE_MS, MAX_AGE_MS, tolerated, window_ms)
        self.script = [f"init {' '.join(map(str, numbers))} {FIRST}", f"at {START_MS}"]

    def wait(self, ms: int) -> "Line":
        self.ms += ms
        self.script.append(f"at {(START_MS + self.ms) % 2**32}")
        return self

    def state(self) -> "Line":
        """The controller sends a RobotState, and the node hears it."""
        self.script.append("state 1 1 0 0")
        self.echo = (self.echo + 1) % 65536
        return self

    def units(self, message: Message) -> list[tuple[int, bytes]]:
        sent = self.sender.encode(message)
        if self.link == "serial":
            return [(0, sent)]
        return [(frame.arbitration_id, frame.data) for frame in sent]

    def put(self, units: list[tuple[int, bytes]]) -> "Line":
        self.script += [f"rx {number} {data.hex()}" for number, data in units]
        return self

    def say(self, message: Message) -> "Line":
        return self.put(self.units(message))

    def advise(self, advice: Advice = CLEAR, **changes: Any) -> "Line":
        echoed = {"echo": min(self.echo, 65534)} | changes
        return self.say(replace(advice, **echoed))

    def ask(self) -> "Line":
        self.script.append("ask")
        return self

    def started(self) -> "Line":
        return self.say(OURS).state().wait(10).advise()

    def answers(self) -> list[tuple[int, str]]:
        done = subprocess.run(
            [self.program],
            input="\n".join(self.script) + "\n",
            capture_output=True,
            text=True,
            check=True,
        )
        lines = [line.split() for line in done.stdout.splitlines() if ":" not in line][1:]
        return [(int(speed), " ".join(rest[:-4])) for speed, *rest in lines]

    def answer(self) -> tuple[int, str]:
        return self.ask().answers()[-1]


@pytest.fixture
def line(build: Any) -> Callable[..., Line]:
    program = build(Path(__file__).with_name("driver.c"))

    def make(link: str = "serial", **options: Any) -> Line:
        return Line(program, link, **options)

    return make


@pytest.mark.parametrize("link", LINKS)
def test_it_moves_while_it_is_advised(line, link):
    one = line(link).ask().say(OURS).ask().started().ask()
    for _ in range(30):  # across the wraps of the tick and of STATE_COUNTER
        one.wait(20).state().wait(20).advise().ask()
    assert one.answers() == [(0, "no schema"), (0, "starting")] + [(900, "advice")] * 31


@pytest.mark.parametrize("link", LINKS)
def test_silence_stops_it_at_the_time_out_and_not_before(line, link):
    one = line(link).started().wait(SILENCE_MS - 1).ask().wait(1).ask().wait(10_000).ask()
    assert one.answers() == [(900, "advice"), (0, "silent"), (0, "silent")]


def test_a_tick_that_wraps_around_does_not_bring_old_advice_back(line):
    one = line().started().wait(SILENCE_MS).ask().wait(2**32 - SILENCE_MS).ask()
    assert one.answers() == [(0, "silent")] * 2


@pytest.mark.parametrize(
    ("level", "speed"), [(lv, 900 if Level.CLEAR <= lv <= Level.SLOW else 0) for lv in Level]
)
def test_whatever_is_not_clear_warn_or_slow_means_stop(line, level, speed):
    one = line().started().advise(level=level)
    assert one.answer() == (speed, "advice")


def test_a_level_that_nobody_knows_means_stop(line):
    for level in (6, 7, 128, 255):
        one = line("fd").started()
        ((number, data),) = one.units(replace(CLEAR, echo=one.echo))
        payload = bytes((level,)) + data[4:]
        data_id = e2e.data_id_16(ROBOT_STRIDE * ROBOT)
        one.put([(number, e2e.protect_profile5(data[2], payload, data_id))])
        assert one.answer() == (0, "advice")


def test_no_speed_limit_is_none(line):
    assert line().started().advise(speed_limit_m_s=None).answer() == (0, "advice")


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize(
    "other", [Schema(OURS.version, OURS.hash ^ 1), Schema(OURS.version + 1, OURS.hash)]
)
def test_another_schema_stops_it_until_ours_comes_again(line, link, other):
    one = line(link).started().say(other).ask().advise().ask().say(OURS).ask().advise().ask()
    assert one.answers() == [
        (0, "other schema"),
        (0, "other schema"),
        (0, "starting"),
        (900, "advice"),
    ]


def test_after_a_long_silence_the_schema_must_be_heard_again(line):
    one = line().started().wait(FORGET_MS).ask().state().advise().ask().say(OURS).advise()
    assert one.answers() == [(0, "silent"), (0, "silent")]
    assert one.answer() == (900, "advice")


@pytest.mark.parametrize("link", LINKS)
def test_a_schema_that_no_advice_follows_is_forgotten(line, link):
    """At the start: another node, of another version, may send the Advice that comes later."""
    one = line(link).say(OURS).wait(FORGET_MS - 1).ask().wait(1).ask().wait(9000).state().advise()
    one.ask().say(OURS).ask().advise().ask()
    assert one.answers() == [
        (0, "starting"),
        (0, "no schema"),
        (0, "no schema"),
        (0, "starting"),
        (900, "advice"),
    ]


@pytest.mark.parametrize("link", LINKS)
def test_after_a_silence_as_well_a_schema_that_no_advice_follows_is_forgotten(line, link):
    one = line(link).started().wait(5000).ask().say(OURS).wait(FORGET_MS).state().advise().ask()
    one.say(OURS).advise().ask()
    assert one.answers() == [(0, "silent"), (0, "silent"), (900, "advice")]


def test_a_schema_is_known_until_then_and_each_that_comes_prolongs_it(line):
    one = line().say(OURS).wait(FORGET_MS - 1).say(OURS).wait(FORGET_MS - 1).state().advise().ask()
    one.wait(5000).ask().say(OURS).wait(FORGET_MS - 1).state().advise().ask()
    assert one.answers() == [(900, "advice"), (0, "silent"), (900, "advice")]


@pytest.mark.parametrize("link", LINKS)
def test_with_a_schema_that_no_advice_follows_the_counters_are_forgotten(line, link):
    one = line(link).advise().say(OURS)
    for _ in range(30):
        one.units(CLEAR)
    one.wait(FORGET_MS).say(OURS).state().advise()
    assert one.answer() == (900, "advice")


def test_a_tick_that_is_set_back_bounds_no_age(line):
    one = line().say(OURS)
    for _ in range(10):
        one.wait(20).state().advise()
    one.ask().wait(-100).ask().say(OURS).advise(age_s=0.2).ask()
    one.wait(20).state().advise(age_s=0.2).ask()
    assert one.answers() == [(900, "advice"), (0, "silent"), (0, "no age"), (900, "advice")]


@pytest.mark.parametrize("link", LINKS)
def test_a_corrupt_frame_stops_it_for_the_window(line, link):
    one = line(link).started()
    units = one.wait(20).state().units(replace(CLEAR, echo=one.echo))
    for number, data in units[:1]:
        one.put([(number, bytes((*data[:5], data[5] ^ 2, *data[6:])))])
    one.ask()
    while one.ms < 30 + WINDOW_MS + 20:
        one.wait(20).state().advise().ask()
    (first, *middle, last) = one.answers()
    assert first == (0, "errors")
    assert middle.count((0, "errors")) >= WINDOW_MS // 20 - 2
    assert last == (900, "advice")


def test_tolerated_errors_do_not_stop_it_and_one_more_does(line):
    one = line(tolerated=2).started()
    for _ in range(3):
        one.put([(0, b"\x05\x01\x02\x00")]).ask()
    assert one.answers() == [(900, "advice")] * 2 + [(0, "errors")]


def test_without_a_window_an_error_stops_it_for_ever(line):
    """Without the setting the robot stays at rest; no error goes unheeded."""
    one = line(window_ms=0).started().ask()
    one.put([(0, b"\x05\x01\x02\x00")]).ask()
    for _ in range(200):
        one.wait(20).state().advise()
    assert one.ask().answers() == [(900, "advice"), (0, "errors"), (0, "errors")]


@pytest.mark.parametrize("link", LINKS)
def test_repeated_and_old_advice_is_not_fresh(line, link):
    one = line(link, tolerated=100).started()
    old = one.units(replace(CLEAR, echo=one.echo))
    for _ in range(8):
        one.wait(20).state().advise()
    one.ask()
    for _ in range(SILENCE_MS // 20 + 1):
        one.wait(20).state().put(old)
    assert one.ask().answers() == [(900, "advice"), (0, "silent")]


@pytest.mark.parametrize("link", LINKS)
def test_up_to_four_lost_messages_are_bridged_and_five_are_not(line, link):
    for lost, answer in ((4, (900, "advice")), (5, (0, "silent"))):
        one = line(link, tolerated=100).started()
        for _ in range(lost):
            one.units(CLEAR)
        assert one.wait(SILENCE_MS - 1).state().advise().wait(20).answer() == answer


@pytest.mark.parametrize("link", LINKS)
def test_after_a_jump_the_third_in_a_row_counts(line, link):
    one = line(link, tolerated=100).started().wait(SILENCE_MS).state()
    for _ in range(100):
        one.units(CLEAR)
    one.advise().ask().advise().ask()
    one.units(CLEAR)  # a gap: the row begins anew
    for _ in range(3):
        one.advise().ask()
    stopped, moving = (0, "silent"), (900, "advice")
    assert one.answers() == [stopped] * 4 + [moving]


def test_parts_of_different_messages_are_never_mixed(line):
    one = line("classic", tolerated=100).say(OURS).state()
    units = [one.units(replace(CLEAR, echo=one.echo)) for _ in range(3)]
    for k in range(3):
        one.put([units[k][k]])
    assert one.answer() == (0, "starting")
    assert one.put(units[2][:2]).answer() == (900, "advice")  # its third part was there


@pytest.mark.parametrize("link", LINKS)
def test_age_and_the_links_delay_are_bounded_by_the_echo(line, link):
    one = line(link).say(OURS).state().wait(100).state()
    echo = one.echo
    one.wait(50).advise(age_s=0.1, echo=echo).ask()  # 100 + 50 ms old at most
    one.wait(60).state().wait(40).ask()
    assert one.answers() == [(900, "advice")] * 2
    late = one.state().wait(30).advise(age_s=0.1, echo=echo - 1)  # 100 + 280 ms
    assert late.answer() == (0, "stale")


def test_advice_grows_stale_while_it_is_held(line):
    one = line().started().wait(10).state().advise(age_s=0.25).ask().wait(79).ask().wait(1).ask()
    assert one.answers() == [(900, "advice"), (900, "advice"), (0, "stale")]


@pytest.mark.parametrize("change", [{"echo": None}, {"age_s": None}, {"echo": 20}, {"echo": FIRST}])
def test_no_age_that_could_be_bounded_is_no_permission(line, change):
    assert line().started().wait(10).advise(**change).answer() == (0, "no age")


def test_a_stop_needs_no_age(line):
    assert line().started().advise(level=Level.STOP, age_s=None).answer() == (0, "advice")


def test_an_echo_of_a_state_sent_too_long_ago_is_not_believed(line):
    one = line().say(OURS).state().wait(MAX_AGE_MS + SILENCE_MS + 1).advise()
    assert one.answer() == (0, "no age")


def test_settings_that_cannot_be_mean_stop_for_ever(build):
    program = build(Path(__file__).with_name("driver.c"))
    good = [0, 0, DEFAULT_BASE_ID, 0, 150, 330, 0, 500, 0]
    for place, value in ((0, 3), (1, 8), (2, 0x7A1), (4, 0), (5, 0)):
        wrong = [*good[:place], value, *good[place + 1 :]]
        script = f"init {' '.join(map(str, wrong))}\nask\nstate 1 0\nask\n"
        done = subprocess.run([program], input=script, capture_output=True, text=True, check=True)
        refused, *asked = done.stdout.splitlines()
        assert refused == "0"
        assert asked[0].startswith("0 not configured")


def test_base_ids_of_11_and_of_29_bits(build):
    program = build(Path(__file__).with_name("driver.c"))
    for base, extended, fits in (
        (0, 0, 1),
        (0x7A0, 0, 1),
        (0x7A1, 0, 0),
        (0x7A1, 1, 1),
        (0x1FFFFFA0, 1, 1),
        (0x1FFFFFA1, 1, 0),
    ):
        script = f"init 0 1 {base} {extended} 150 330 0 500 6\nstate 1 1 500000 250000\n"
        done = subprocess.run([program], input=script, capture_output=True, text=True, check=True)
        ready, sent = done.stdout.splitlines()
        assert ready == str(fits)
        if fits:
            receiver = CanReceiver(False, base, bool(extended))
            pairs = [word.split(":") for word in sent.split()]
            frames = [
                CanFrame(int(i, 16), bytes.fromhex(d), False, bool(extended)) for i, d in pairs
            ]
            (state,) = [m for frame in frames for m in receiver.feed(frame)]
            assert isinstance(state, RobotState)
            assert (state.robot, state.counter, state.positions) == (1, 7, (0.5,))


def test_serial_line_is_found_again_after_any_garbage(line):
    one = line(tolerated=1000).started()
    for garbage in (b"\x01" * 500, b"\x00" * 9, bytes(range(256)), b"\xff" * 73, b"\x30\x31"):
        one.put([(0, garbage)]).wait(10).state().put([(0, b"\0")]).advise().ask()
    assert one.answers() == [(900, "advice")] * 5


def test_a_packet_of_another_length_than_it_says_is_refused(line):
    for length, answer in ((18, (0, "starting")), (17, (0, "no schema")), (19, (0, "no schema"))):
        one = line(tolerated=10)
        payload = OURS.version.to_bytes(2, "little") + OURS.hash.to_bytes(4, "little")
        head = struct.pack(">HHI", length, 0, e2e.data_id_32(BY_TYPE[Schema].number))
        crc = crc32.autosar(head + payload).to_bytes(4, "big")
        one.put([(0, cobs.encode(head + crc + payload) + b"\0")])
        assert one.answer() == answer


def test_what_the_c_code_sends_is_in_order_for_the_node(build):
    program = build(Path(__file__).with_name("driver.c"))
    script = (
        "init 2 0 0 0 150 330 0 500 65533\n"
        + "state 1 2 100000 -200000 3 4\n" * 5
        + "ack 7 9\nack 0 9\nreleased 9\nreleased 0\n"
    )
    done = subprocess.run([program], input=script, capture_output=True, text=True, check=True)
    receiver = SerialReceiver()
    units = [bytes.fromhex(row.partition(":")[2]) for row in done.stdout.splitlines()[1:]]
    got = [m for unit in units for m in receiver.feed(unit)]
    assert [m.counter for m in got if isinstance(m, RobotState)] == [65534, 65535, 0, 1, 2]
    assert got[5:] == [Acknowledge(7, 9), Acknowledge(0, 9)]
    assert receiver.counters.counter_errors == 0
