"""Latches: what sets them, what releases them, and what is known of them after a restart."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.latches import MAX_LATCH_ID, LatchIds, recall, remembered
from hri_predict.risk.levels.machine import LevelMachine
from hri_predict.risk.settings import RiskSettings
from tests.hri_predict.risk.levels.test_machine import CLEAR, MAX, SETTINGS, SLOW, STOP, TICK_NS


def machine(*causes, ids=None):
    settings = SETTINGS.model_copy(update={"latch": list(causes)})
    return LevelMachine(settings, MAX, ids or LatchIds())


def run(levels, demand=CLEAR, ticks=1, causes=(), lost=0, count=itertools.count(1)):  # noqa: B008
    for _ in range(ticks):
        capture = next(count)
        advised = levels.update(demand, capture, capture * TICK_NS, causes, lost=lost)
    return advised


@pytest.mark.parametrize("cause", ["blind", "lost"])
def test_a_cause_stops_a_moving_robot_until_it_has_passed_and_is_acknowledged(cause):
    levels = machine(cause)
    assert run(levels, ticks=100).level is Level.CLEAR
    held = run(levels, SLOW, causes=[cause])
    assert (held.level, held.reason, held.limit_m_s) == (Level.STOP, Reason.LATCHED, 0.0)
    assert held.causes == (cause,)
    assert held.latch_id == 0  # it lasts, so there is nothing to acknowledge yet
    held = run(levels, ticks=100)
    assert held.reason is Reason.LATCHED
    assert levels.acknowledge(held.latch_id)
    pending = run(levels)  # the acknowledgement starts nothing
    assert (pending.level, pending.reason) == (Level.STOP, Reason.RELEASE_PENDING)
    assert run(levels, ticks=100).level is Level.CLEAR


@pytest.mark.parametrize("cause", ["blind", "lost", "stop"])
def test_what_is_not_configured_does_not_latch(cause):
    levels = machine("start")
    assert run(levels, STOP, causes=[cause] if cause != "stop" else []).latch_id == 0
    assert run(levels, ticks=100).level is Level.CLEAR


def test_after_start_the_first_motion_needs_an_acknowledgement():
    levels = machine("start")
    levels.latch("start")
    held = run(levels, ticks=200)
    assert (held.level, held.reason, held.causes) == (Level.STOP, Reason.LATCHED, ("start",))
    assert levels.acknowledge(held.latch_id)
    assert run(levels, ticks=100).level is Level.CLEAR


def test_one_latch_gathers_its_causes():
    levels = machine("stop", "lost")
    run(levels, STOP)
    first = run(levels)
    run(levels, CLEAR, causes=["lost"])
    both = run(levels)
    assert both.causes == ("stop", "lost")
    assert not levels.acknowledge(first.latch_id)  # who pressed has not heard of the second cause
    assert levels.acknowledge(both.latch_id)
    assert run(levels, STOP).causes == ("stop",)


def test_lost_people_are_acknowledged_without_a_latch_each_set_under_its_own_number():
    levels = machine()
    assert run(levels, STOP).latch_id == 0
    one = run(levels, STOP, lost=1).latch_id
    assert one == run(levels, STOP, lost=1, ticks=9).latch_id != 0
    two = run(levels, STOP, lost=2).latch_id
    assert two not in (0, one)
    assert not levels.acknowledge(two)  # there is no latch: whom it means, others know
    three = run(levels, STOP, lost=2).latch_id
    assert three not in (0, one, two)  # each number counts once
    assert run(levels, STOP).latch_id == 0


def test_one_press_ends_lost_people_and_the_latch_that_they_have_set():
    levels = machine("lost")
    run(levels, STOP, causes=["lost"])
    shown = run(levels, STOP, causes=["lost"], lost=1).latch_id
    assert shown
    run(levels)  # the tick in which they are forgotten
    assert levels.acknowledge(shown)
    assert run(levels, ticks=100).level is Level.CLEAR


def test_a_latch_survives_a_restart_under_a_new_number():
    ids = LatchIds()
    levels = machine("stop", ids=ids)
    run(levels, STOP)
    before = run(levels).latch_id
    data = remembered({"arm": levels, "gone": machine()})
    later = machine("stop", "restart", ids=LatchIds(ids.last - 1))  # it draws the same number
    recall({"arm": later}, data)
    after = run(later, ticks=100)
    assert after.reason is Reason.LATCHED
    assert after.causes == ("stop", "restart")
    assert after.latch_id == before
    fresh = machine("stop", ids=LatchIds(ids.last))
    recall({"arm": fresh}, data)
    after = run(fresh, ticks=100)
    assert not fresh.acknowledge(before)
    assert fresh.acknowledge(after.latch_id)


def test_two_runs_do_not_number_alike():
    starts = {LatchIds()() for _ in range(20)}
    assert len(starts) > 1  # all alike by chance: once in 65,000 ** 19
    assert starts <= set(range(1, MAX_LATCH_ID + 1))


def test_numbers_wrap_within_the_wire_and_skip_0():
    ids = LatchIds(MAX_LATCH_ID - 1)
    assert [ids(), ids(), ids()] == [MAX_LATCH_ID, 1, 2]


def test_restart_latches_although_nothing_was_latched():
    later = machine("restart")
    recall({"arm": later}, remembered({"arm": machine()}))
    assert run(later, ticks=100).causes == ("restart",)


@given(
    st.lists(
        st.tuples(
            st.sampled_from([CLEAR, SLOW, STOP]),
            st.sampled_from([(), ("lost",), ("blind",)]),
            st.integers(0, 3),
            st.booleans(),
        ),
        max_size=60,
    )
)
def test_a_number_means_what_it_meant_when_it_was_first_shown(story):
    """An acknowledgement never ends a cause or a set of people that came after its number did."""
    levels = machine("stop", "lost", "blind")
    meant: dict[int, tuple[set[str], int]] = {}
    people = 0
    for demand, causes, grows, presses in story:
        people = 0 if grows == 0 else people + (grows == 3) or 1
        advised = run(levels, demand, causes=causes, lost=people)
        if advised.latch_id:
            first = meant.setdefault(advised.latch_id, (set(advised.causes), people))
            assert set(advised.causes) <= first[0]
            assert people in (0, first[1])
        if presses and levels.acknowledge(advised.latch_id):
            assert run(levels, CLEAR).causes == ()


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"robots": {"arm": {}}},
        {"robots": {"arm": {"causes": 1}}},
        {"robots": [1]},
    ],
)
def test_what_is_no_memory_is_refused(data):
    with pytest.raises((KeyError, TypeError, ValueError, AttributeError)):
        recall({"arm": machine()}, data)


@pytest.mark.parametrize(("old", "new"), [(True, r"latch: \[stop\]"), (False, r"latch: \[\]")])
def test_the_old_key_says_what_to_write_instead(old, new):
    with pytest.raises(ConfigError, match=new):
        validated(RiskSettings, {"latch_stop": old}, "cell.yaml: risk")
