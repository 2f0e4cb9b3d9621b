"""When ticks are due, at a fixed rate and with captures; no clock runs here."""

import itertools
import threading
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.clock import VirtualClock
from hri_predict.base.errors import LinkError
from hri_predict.cli.check.check import examine
from hri_predict.run.config import NodeSettings
from hri_predict.run.ticks import LEAVE_NS, CaptureTicks, FixedTicks, ticks_of
from hri_predict.run.ticks_told import race_notes, ticks_facts, ticks_line
from hri_sim.baseline_demo import baseline_demo

MS = 1_000_000
PERIOD, GAP = 40 * MS, 10 * MS


def capture_ticks():
    return CaptureTicks(0, period_ns=PERIOD, gap_ns=GAP, room_ns=30 * MS)


def played(ticks, captures, end_ns, took_ns=0):
    """When ticks begin if scenes come at ``captures`` and each tick takes ``took_ns``."""
    waiting, now_ns, began = sorted(captures), 0, []
    while now_ns < end_ns:
        while waiting and waiting[0] <= max(now_ns, ticks.due_ns):
            now_ns = max(now_ns, waiting.pop(0))
            ticks.captured()
        now_ns = max(now_ns, ticks.due_ns)
        if now_ns >= end_ns:
            break
        ticks.begin(now_ns)
        began.append(now_ns)
        done_ns = now_ns + took_ns
        while waiting and waiting[0] <= done_ns:  # they come while the tick runs
            waiting.pop(0)
            ticks.captured()
        ticks.end(done_ns)
        now_ns = done_ns
    return began


def test_a_capture_gives_a_tick_at_once():
    assert played(capture_ticks(), [15 * MS, 48 * MS], 60 * MS) == [0, 15 * MS, 48 * MS]


def test_without_captures_there_is_one_tick_each_period():
    assert played(capture_ticks(), [], 130 * MS) == [0, 40 * MS, 80 * MS, 120 * MS]


def test_when_the_source_stops_the_next_tick_comes_one_period_after_the_last():
    assert played(capture_ticks(), [33 * MS], 120 * MS) == [0, 33 * MS, 73 * MS, 113 * MS]


def test_a_burst_gives_one_tick():
    assert played(capture_ticks(), [20 * MS] * 5, 50 * MS) == [0, 20 * MS]


def test_a_capture_right_after_a_tick_waits_for_the_gap_and_no_longer():
    assert played(capture_ticks(), [41 * MS], 60 * MS) == [0, 40 * MS, 50 * MS]


def test_a_capture_just_when_the_floor_is_due_is_in_that_tick():
    assert played(capture_ticks(), [40 * MS], 79 * MS) == [0, 40 * MS]


def test_a_source_that_is_faster_than_the_largest_rate_gives_that_rate():
    captures = [round(k * 1e9 / 240) for k in range(240)]
    began = played(capture_ticks(), captures, 1_000 * MS)
    assert began == [k * GAP for k in range(100)]


def test_captures_during_a_long_tick_give_one_tick_as_soon_as_its_advice_has_left():
    began = played(capture_ticks(), [20 * MS, 30 * MS, 40 * MS], 80 * MS, took_ns=35 * MS)
    assert began == [0, 35 * MS + LEAVE_NS, 70 * MS + 2 * LEAVE_NS]


def test_after_a_leap_of_the_clock_nothing_is_made_up_for():
    ticks = capture_ticks()
    ticks.begin(0)
    ticks.captured()
    ticks.begin(3_600_000 * MS)  # the machine slept
    assert ticks.due_ns == 3_600_000 * MS + PERIOD


@given(
    st.lists(st.integers(0, 1_000 * MS), max_size=60),
    st.integers(0, 70 * MS),
)
def test_ticks_are_never_nearer_than_the_gap_nor_farther_than_the_period(captures, took_ns):
    began = played(capture_ticks(), captures, 1_000 * MS, took_ns)
    apart = [b - a for a, b in itertools.pairwise(began)]
    least, most = max(GAP, took_ns), max(PERIOD, took_ns + LEAVE_NS)
    assert all(least <= each <= most for each in apart)
    for capture in captures:  # none is forgotten
        later = [b for b in began if b >= capture]
        assert not later or later[0] <= capture + max(GAP, took_ns + LEAVE_NS)


def test_a_tick_is_late_when_it_takes_longer_than_its_room():
    ticks = capture_ticks()
    ticks.begin(5 * MS)
    assert not ticks.end(35 * MS).is_late
    ticks.begin(45 * MS)
    assert ticks.end(76 * MS).is_late


@pytest.mark.parametrize(("took_ms", "missed"), [(30, 0), (78, 0), (81, 1), (165, 3)])
def test_ticks_that_were_due_at_least_and_are_skipped_are_counted(took_ms, missed):
    ticks = capture_ticks()
    ticks.begin(0)
    assert ticks.end(took_ms * MS).missed == 0  # the next tick says it
    ticks.captured()
    ticks.begin(max(ticks.due_ns, took_ms * MS))
    assert ticks.end(took_ms * MS + LEAVE_NS).missed == missed


def test_a_capture_wakes_whoever_waits():
    ticks, stop = capture_ticks(), threading.Event()
    ticks.begin(0)
    clock = Waking(ticks)
    ticks.wait(clock, stop)
    assert clock.waited == PERIOD
    assert ticks.due_ns == GAP  # so the loop waits again, until then
    clock.wakes = False
    ticks.wait(clock, stop)
    assert clock.waited == GAP


class Waking(VirtualClock):
    """Somebody else brings a capture while it waits, and the event must be set by that."""

    def __init__(self, ticks):
        super().__init__(0)
        self.ticks, self.wakes, self.waited = ticks, True, None

    def wait_until(self, deadline_ns, wake=None):
        self.waited = deadline_ns
        assert not wake.is_set()
        if self.wakes:
            self.ticks.captured()
            assert wake.is_set()


def test_captures_change_nothing_at_a_fixed_rate():
    ticks = FixedTicks(0, PERIOD)
    assert played(ticks, [5 * MS, 39 * MS, 41 * MS], 130 * MS) == [k * PERIOD for k in range(4)]


ROBOT = {"name": "a", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}


def settings(**keys):
    return NodeSettings.model_validate({"source": {}, "robots": [ROBOT], **keys})


def test_the_configuration_decides_and_fixed_is_the_default():
    assert isinstance(ticks_of(settings(), 30.0, 0), FixedTicks)
    ticks = ticks_of(settings(ticks="capture", rate_hz=20), 30.0, 0)
    assert isinstance(ticks, CaptureTicks)
    ticks.begin(0)
    assert ticks.due_ns == 50 * MS
    ticks.captured()
    assert ticks.due_ns == 10 * MS  # 100 Hz at most, where nothing else is said


@pytest.mark.parametrize(
    ("rate_hz", "largest_hz", "source_hz", "room_ms"),
    [(25, 100, 30, 1000 / 30), (25, 100, 10, 40), (25, 50, 240, 20)],
)
def test_a_tick_has_time_until_the_next_capture_or_the_floor(
    rate_hz, largest_hz, source_hz, room_ms
):
    node = settings(ticks="capture", rate_hz=rate_hz, max_rate_hz=largest_hz)
    ticks = ticks_of(node, source_hz, 0)
    ticks.begin(0)
    assert ticks.end(round(room_ms * MS)).used == pytest.approx(1.0, abs=1e-6)  # whole nanoseconds


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"max_rate_hz": 50}, "no effect with ticks: fixed"),
        ({"ticks": "capture", "rate_hz": 50, "max_rate_hz": 40}, "below rate_hz 50"),
        ({"ticks": "capture", "max_rate_hz": 240}, "less than or equal to 100"),
        ({"ticks": "event"}, "'fixed' or 'capture'"),
        ({"ticks": "capture", "publish_phase_s": 0.01}, "no effect with ticks: capture"),
        ({"rate_hz": 50, "publish_phase_s": 0.0101}, r"0.0101 is over half a cycle, 0.01 s"),
        ({"publish_phase_s": 8}, "8 is over half a cycle, 0.02 s"),
        ({"publish_phase_s": float("nan")}, "finite"),
    ],
)
def test_rates_that_do_not_fit_are_refused(keys, words):
    with pytest.raises(ValueError, match=words):
        settings(**keys)


@pytest.mark.parametrize(
    ("keys", "source_hz", "mean_ms", "most_ms"),
    [
        ({}, 25, 20, 40),
        ({}, 10, 20, 40),  # as long as until the next tick, however rare captures are
        ({}, 100, 5, 10),  # the newest of four is that old
        ({"ticks": "capture"}, 25, 0, 10),
        ({"ticks": "capture", "max_rate_hz": 50}, 25, 0, 20),
        ({"ticks": "capture", "max_rate_hz": 50}, 240, 2.08, 20),
    ],
)
def test_how_long_a_capture_waits(keys, source_hz, mean_ms, most_ms):
    wait = ticks_facts(settings(**keys), source_hz)["wait_s"]
    assert wait["mean"] * 1e3 == pytest.approx(mean_ms, abs=0.01)
    assert wait["most"] * 1e3 == pytest.approx(most_ms, abs=0.01)


def test_the_line_says_the_rates():
    assert ticks_line(ticks_facts(settings(), 30)) == (
        "ticks: fixed, 25 per second; a capture of the source's 30 per second waits 17 ms on "
        "average and 33 ms at most"
    )
    line = ticks_line(ticks_facts(settings(ticks="capture"), 30))
    assert "capture, 25 to 100 per second" in line


@pytest.mark.parametrize(
    ("ticks", "rate_hz", "told"),
    [("capture", 25, True), ("capture", 28, True), ("capture", 20, False), ("capture", 50, True),
     ("fixed", 25, False)],
)  # fmt: skip
def test_a_floor_that_races_with_captures_is_told(ticks, rate_hz, told):
    notes = race_notes(settings(ticks=ticks, rate_hz=rate_hz), 26.0)
    assert bool(notes) is told
    remedy = "23.4 is enough" if rate_hz > 26 / 0.9 else "rate_hz up to 23.4 avoids it"
    assert all(remedy in note for note in notes)


def with_capture(**node):
    demo = baseline_demo()
    update = {"ticks": "capture"} | node
    return replace(demo, node=demo.node.model_copy(update=update))


def test_links_are_loaded_with_the_largest_rate_and_delays_with_the_least():
    fixed, capture = examine(baseline_demo()), examine(with_capture(max_rate_hz=75.0))
    assert capture["delay_budget_s"] == fixed["delay_budget_s"]
    for slow, fast in zip(fixed["links"], capture["links"], strict=True):
        # each 15 ms: thrice in a cycle of 40 ms, and twice in each that is a little longer than 15
        assert (slow["rate_hz"], fast["rate_hz"]) == pytest.approx((75.0, 2 / 0.015))
        for message in ("Status", "Advice"):
            ratio = fast["details"][message] / slow["details"][message]
            assert ratio == pytest.approx(2 / 0.015 / 75.0)
        assert fast["details"]["RobotState"] == slow["details"]["RobotState"]


def test_a_largest_rate_that_a_link_cannot_carry_is_refused_with_one_that_it_can():
    demo = with_capture()
    update = {"baudrate": 19200, "robot_state_rate_hz": 10.0, "repeat_hz": 0.0}
    slow = demo.links[0].model_copy(update=update)
    with pytest.raises(LinkError, match=r"lower max_rate_hz from 100 to (\d+)") as caught:
        examine(replace(demo, links=(slow,)))
    fits = float(str(caught.value).split("max_rate_hz from 100 to ")[1].split()[0])
    fitting = demo.node.model_copy(update={"rate_hz": 10.0, "max_rate_hz": fits})
    assert examine(replace(demo, links=(slow,), node=fitting))["links"][0]["spare"] >= 0


@pytest.mark.parametrize(
    ("ticks", "baudrate"), [("fixed", 57600), ("fixed", 38400), ("capture", 57600)]
)
def test_repetitions_that_a_link_cannot_carry_are_refused_with_a_rate_that_it_can(ticks, baudrate):
    demo = with_capture(ticks=ticks, max_rate_hz=50.0 if ticks == "capture" else None)
    link = demo.links[0].model_copy(update={"baudrate": baudrate, "robot_state_rate_hz": 30.0})
    with pytest.raises(LinkError, match=r"lower repeat_hz from 66.7 to (\d+)") as caught:
        examine(replace(demo, links=(link,)))
    fits = float(str(caught.value).split("repeat_hz from 66.7 to ")[1].split()[0])
    fitting = link.model_copy(update={"repeat_hz": fits})
    found = examine(replace(demo, links=(fitting,)))
    assert found["links"][0]["spare"] >= 0
    # a longer time between messages leaves less room for lost ones, and check says so
    assert any("silence_timeout_s 60 ms is short" in note for note in found["notes"])
