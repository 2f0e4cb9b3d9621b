"""Supervised restart: a press counts when the button is released, in time, and only then."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.node.presses import LONGEST_S, QUIET_S, REPEATS_S, SHORTEST_S, SHOWN_S, Presses
from tests.hri_predict.node.test_presses import Desk

MS = 0.001


class Supervised(Desk):
    """The same desk, where a press counts only with its release."""

    def __init__(self):
        super().__init__()
        self.presses = Presses(supervised=True)
        self.show(0.0)

    def release(self, at_s, ack_id, **more):
        return tuple(p.latch_id for p in self.press(at_s, 0, ack_id, **more))


@pytest.fixture
def desk():
    return Supervised()


@pytest.mark.parametrize("held_s", [SHORTEST_S, 0.5, LONGEST_S])
def test_a_press_counts_when_the_button_is_released(desk, held_s):
    desk.show(20.0, 700)
    assert not desk.press(21.0, 700, 5)
    assert desk.release(21.0 + held_s, 5) == (700,)
    assert not desk.presses.refused


@pytest.mark.parametrize(
    ("held_s", "why"), [(SHORTEST_S - MS, "too_short"), (LONGEST_S + MS, "too_long")]
)
def test_a_press_that_is_too_short_or_too_long_counts_for_nothing(desk, held_s, why):
    desk.show(20.0, 700)
    desk.press(21.0, 700, 5)
    assert not desk.release(21.0 + held_s, 5)
    assert desk.presses.refused == {why: 1}
    again_s = 21.0 + held_s + QUIET_S
    assert not desk.press(again_s, 700, 6)
    assert desk.release(again_s + 0.5, 6) == (700,)


def test_repeats_of_both_edges_are_one_press(desk):
    desk.show(20.0, 700)
    for i in range(5):
        assert not desk.press(21.0 + 0.05 * i, 700, 5)
    released = [desk.release(21.2 + 0.05 * i, 5) for i in range(5)]
    assert released == [(700,), (), (), (), ()]
    assert not desk.press(21.5, 700, 5)  # a repeat that came late
    assert not desk.presses.refused


@pytest.mark.parametrize("shown", [[700, 0, 700], [700, 701], [700, 701, 700]])
def test_what_is_not_shown_for_the_whole_press_is_not_acknowledged(desk, shown):
    """A condition came back, or something was added, while the button was held."""
    desk.show(20.0, shown[0])
    desk.press(21.0, 700, 5)
    for k, latch_id in enumerate(shown[1:]):
        desk.show(21.1 + 0.1 * k, latch_id)
    assert not desk.release(21.5, 5)
    assert desk.presses.refused == {"not_kept": 1}


def test_the_release_must_be_of_that_press_and_on_its_link(desk):
    desk.show(20.0, 700)
    desk.press(21.0, 700, 5)
    assert not desk.release(21.5, 5, link="other")
    assert not desk.release(21.5, 6)  # which also ends what was begun
    assert not desk.release(21.6, 5)
    assert desk.presses.refused == {"names_nothing": 3}


def test_another_acknowledge_between_the_edges_ends_the_press(desk):
    desk.show(20.0, 700)
    desk.press(21.0, 700, 5)
    desk.press(21.0 + 0.6, 700, 6)
    assert not desk.release(21.7, 5)
    assert not desk.release(21.8, 6)
    assert desk.presses.refused == {"no_pause": 1, "names_nothing": 2}


def test_the_release_of_a_refused_press_counts_for_nothing(desk):
    desk.show(20.0, 700)
    desk.press(20.0 + SHOWN_S / 2, 700, 5)
    assert not desk.release(20.0 + SHOWN_S, 5)
    assert desk.presses.refused == {"too_soon": 1, "no_press": 1}


def test_one_button_for_two_robots_is_one_press(desk):
    desk.show(20.0, 700, 701)
    desk.press(21.0, 700, 5)
    desk.press(21.1, 701, 5)
    assert desk.release(21.5, 5) == (700, 701)


@pytest.mark.parametrize("period_s", [0.05, 0.5, 2.5, QUIET_S])
def test_a_button_that_is_stuck_restarts_nothing(desk, period_s):
    """Presses come again and again, whether with the same number or with others, no release."""
    desk.show(20.0, 700)
    for k in range(200):
        assert not desk.press(21.0 + k * period_s, 700, 5)
        assert not desk.press(21.0 + k * period_s + MS, 700, 6 + k)


@pytest.mark.parametrize("period_s", [0.05, 0.5, 2.5])
def test_both_edges_without_a_pause_count_once_at_most(desk, period_s):
    """A program that toggles: after the first press it never pauses for ``QUIET_S``."""
    desk.show(20.0, 700)
    counted = []
    for k in range(200):
        at_s = 21.0 + 2 * k * period_s
        assert not desk.press(at_s, 700, 5 + k)
        counted += desk.release(at_s + period_s, 5 + k)
    assert counted == ([700] if SHORTEST_S <= period_s <= LONGEST_S else [])
    assert desk.held(at_s + period_s)


def test_a_release_in_manual_restart_is_left_out():
    """Controllers report both edges in either type."""
    desk = Desk()
    desk.show(20.0, 700)
    assert desk.press(21.0, 700, 5)
    assert not desk.press(22.0, 0, 5)
    assert not desk.presses.refused
    assert not desk.press(22.0 + REPEATS_S + MS, 0, 5)
    assert desk.presses.refused == {"names_nothing": 1}


_EVENTS = st.lists(
    st.tuples(
        st.floats(0.0, 15.0),
        st.sampled_from([0, 0, 700, 701, 702]),
        st.integers(0, 3),
        st.sampled_from([None, 0, 700, 701]),
    ),
    max_size=60,
)


@given(_EVENTS)
def test_whatever_comes_a_latch_ends_only_by_a_release_within_the_window(events):
    desk, at_s = Supervised(), 0.0
    downs: dict[tuple[int, int], list[float]] = {}
    shown, since_s = 0, 0.0
    for pause_s, latch_id, ack_id, shows in events:
        at_s += pause_s
        if shows is not None:
            desk.show(at_s, shows)
            since_s = at_s if shows != shown else since_s
            shown = shows
        counted = desk.press(at_s, latch_id, ack_id)
        if latch_id:
            assert not counted
            downs.setdefault((latch_id, ack_id), []).append(at_s)
        for press in counted:
            assert press.latch_id == shown
            begun = downs[press.latch_id, ack_id]
            # rounding of the clock to nanoseconds
            assert any(SHORTEST_S - 1e-6 <= at_s - b <= LONGEST_S + 1e-6 for b in begun)
            assert all(b >= since_s + SHOWN_S - 1e-6 for b in begun[-1:])


def test_numbers_are_not_used_up_by_presses_that_count_for_nothing(desk):
    numbers, at_s = itertools.count(5), 21.0
    desk.show(20.0, 700)
    for _ in range(3):
        ack_id = next(numbers)
        desk.press(at_s, 700, ack_id)
        assert not desk.release(at_s + 4.0, ack_id)  # held too long
        at_s += 4.0 + QUIET_S
    desk.press(at_s, 700, 99)
    assert desk.release(at_s + 1.0, 99) == (700,)
