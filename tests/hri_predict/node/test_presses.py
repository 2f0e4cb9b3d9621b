"""Which Acknowledges are presses: shown to a person, after a pause, each once."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.node.presses import HELD_AT, QUIET_S, REPEATS_S, SHOWN_S, TOGETHER_S, Presses
from hri_predict.protocol.messages import Acknowledge, Advice, Level
from hri_predict.protocol.reasons import Reason

S = 1_000_000_000
START_NS = 5 * S
BOTH = frozenset((0, 1))


class Desk:
    """Two robots' advice, and buttons on links; times in seconds since the node's start."""

    def __init__(self) -> None:
        self.presses = Presses()
        self.ids = itertools.count(1)
        self.show(0.0)

    def show(self, at_s, *latch_ids):
        latch_ids = (*latch_ids, 0, 0)[:2]
        advices = [
            Advice(robot=r, level=Level.STOP, reason=Reason.LATCHED, latch_id=n)
            for r, n in enumerate(latch_ids)
        ]
        self.presses.show(advices, START_NS + round(at_s * S))

    def press(self, at_s, latch_id, ack_id=None, link="plc", robots=BOTH):
        message = Acknowledge(latch_id, next(self.ids) if ack_id is None else ack_id)
        return self.presses.take(link, robots, message, START_NS + round(at_s * S))

    def held(self, at_s):
        return self.presses.are_held(START_NS + round(at_s * S))


@pytest.fixture
def desk():
    return Desk()


def test_a_press_after_a_pause_counts(desk):
    desk.show(20.0, 700)
    assert desk.press(21.0, 700)
    desk.show(21.04)
    desk.show(60.0, 701)
    assert desk.press(62.0, 701)
    assert not desk.held(62.0)
    assert not desk.presses.refused


def test_repeats_of_one_press_are_one_press_and_later_ones_are_replays(desk):
    desk.show(20.0, 700)
    assert desk.press(21.0, 700, 5)
    for i in range(10):
        assert not desk.press(21.02 + 0.1 * i, 700, 5)
    assert not desk.presses.refused
    assert not desk.press(21.0 + QUIET_S + REPEATS_S + 1.0, 700, 5)  # even after a pause
    assert desk.presses.refused == {"replayed": 1}


@pytest.mark.parametrize(
    ("shown", "named", "why"),
    [(700, 0, "names_nothing"), (700, 699, "not_shown"), (0, 700, "not_shown")],
)
def test_what_is_not_shown_is_not_acknowledged(desk, shown, named, why):
    desk.show(20.0, shown)
    assert not desk.press(21.0, named)
    assert desk.presses.refused == {why: 1}


def test_it_must_be_shown_on_the_link_that_it_comes_on(desk):
    desk.show(20.0, 700, 701)
    assert not desk.press(21.0, 701, robots=frozenset((0,)))
    assert desk.press(21.0, 701, link="other", robots=frozenset((1,)))


def test_nobody_presses_as_soon_as_it_is_shown(desk):
    desk.show(20.0, 700)
    assert not desk.press(20.0 + SHOWN_S - 0.01, 700)
    assert desk.presses.refused == {"too_soon": 1}
    assert not desk.press(20.0 + SHOWN_S + 1.0, 700)  # a pause must come first
    assert desk.press(21.0 + SHOWN_S + QUIET_S, 700)


def test_the_button_must_have_been_seen_released_since_the_start(desk):
    desk.show(0.0, 700)
    assert not desk.press(QUIET_S - 0.1, 700)
    assert desk.press(2 * QUIET_S, 700)


def test_one_button_for_two_robots_is_one_press(desk):
    desk.show(20.0, 700, 701)
    assert desk.press(21.0, 700)
    assert desk.press(21.0 + TOGETHER_S / 2, 701)
    desk.show(21.0 + TOGETHER_S, 0, 702)
    assert not desk.press(21.0 + 3 * TOGETHER_S, 702)


@pytest.mark.parametrize("period_s", [0.05, 0.2, 0.5, 1.0, 2.0, 4.0, 10.0, 11.9])
@pytest.mark.parametrize("ids", [2, 7, 255])
def test_a_taped_button_releases_nothing_and_is_a_fault(desk, period_s, ids):
    """It names what is shown at the moment, as a controller does that copies it."""
    numbers = itertools.count(700)
    shown, showing_s, at_s, presses = 0, 0.0, 0.0, 0
    while presses < 300:
        if at_s - showing_s > 7.3:  # whatever the period is, something else is shown now and then
            shown, showing_s = next(numbers), at_s
            desk.show(at_s, shown)
        at_s += period_s
        presses += 1
        assert not desk.press(at_s, shown, 1 + presses % ids), at_s
    assert desk.held(at_s)
    assert desk.held(at_s + QUIET_S - REPEATS_S - 0.1)  # the last may have been repeats
    assert not desk.held(at_s + QUIET_S)
    desk.show(at_s + 1.0, 65_000)
    assert desk.press(at_s + QUIET_S, 65_000, 1_000)  # it was let go


def test_pressing_twice_by_mistake_is_no_fault(desk):
    desk.show(20.0, 700)
    desk.press(21.0, 700)
    desk.show(21.04)
    for i in range(HELD_AT - 1):
        desk.press(22.0 + i, 0)
    assert not desk.held(24.0)
    desk.press(24.5, 0)
    assert desk.held(24.5)


def test_a_replay_of_what_was_refused_never_counts(desk):
    desk.show(20.0, 700)
    assert not desk.press(20.1, 700, 9)  # recorded, too soon
    assert not desk.press(40.0, 700, 9)
    assert desk.press(60.0, 700, 10)


def test_a_flood_is_logged_seldom_and_says_what_to_do(desk, caplog):
    for i in range(1500):
        desk.press(20.0 + 0.01 * i, 0, 1 + i)
    assert desk.presses.refused == {"names_nothing": 1500}
    assert len(caplog.records) == 2
    assert "protocol version 3" in caplog.text


@given(
    st.lists(
        st.tuples(st.floats(0.0, 20.0), st.integers(0, 3), st.integers(0, 5), st.integers(0, 3)),
        max_size=80,
    )
)
def test_between_two_presses_that_count_lies_a_pause(story):
    desk, at_s, counted = Desk(), 0.0, []
    for gap_s, shown, ack_id, named in story:
        at_s += gap_s
        if shown < 3:
            desk.show(at_s, shown)
        if desk.press(at_s, named, ack_id):
            assert named != 0
            counted.append((at_s, named, ack_id))
    pairs = [(named, ack_id) for _, named, ack_id in counted]
    assert len(set(pairs)) == len(pairs)
    for (before_s, *_), (after_s, *_) in itertools.pairwise(counted):
        gap_s = after_s - before_s
        assert gap_s <= TOGETHER_S + 1e-6 or gap_s >= QUIET_S - 1e-6  # rounded to nanoseconds
