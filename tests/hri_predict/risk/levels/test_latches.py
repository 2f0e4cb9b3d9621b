"""Latches: what sets them, what releases them, and what is known of them after a restart."""

import itertools

import pytest

from hri_predict.errors import ConfigError
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.latches import LatchIds, recall, remembered
from hri_predict.risk.levels.machine import LevelMachine
from hri_predict.risk.settings import RiskSettings
from hri_predict.settings import validated
from tests.hri_predict.risk.levels.test_machine import CLEAR, MAX, SETTINGS, SLOW, STOP, TICK_NS


def machine(*causes, ids=None):
    settings = SETTINGS.model_copy(update={"latch": list(causes)})
    return LevelMachine(settings, MAX, ids or LatchIds())


def run(levels, demand=CLEAR, ticks=1, causes=(), count=itertools.count(1)):  # noqa: B008
    for _ in range(ticks):
        capture = next(count)
        advised = levels.update(demand, capture, capture * TICK_NS, causes)
    return advised


@pytest.mark.parametrize("cause", ["blind", "lost"])
def test_a_cause_stops_a_moving_robot_until_it_has_passed_and_is_acknowledged(cause):
    levels = machine(cause)
    assert run(levels, ticks=100).level is Level.CLEAR
    held = run(levels, SLOW, causes=[cause])
    assert (held.level, held.reason, held.limit_m_s) == (Level.STOP, Reason.LATCHED, 0.0)
    assert held.causes == (cause,)
    assert not levels.acknowledge(held.latch_id)  # it lasts
    assert run(levels, ticks=100).reason is Reason.LATCHED
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
    first = run(levels, STOP)
    both = run(levels, CLEAR, causes=["lost"])
    assert both.latch_id == first.latch_id
    assert both.causes == ("stop", "lost")
    run(levels)
    assert levels.acknowledge(first.latch_id)
    assert run(levels, STOP).causes == ("stop",)


def test_a_latch_survives_a_restart_with_its_id():
    ids = LatchIds()
    levels = machine("stop", ids=ids)
    held = run(levels, STOP)
    data = remembered({"arm": levels, "gone": machine()}, ids)
    again = LatchIds()
    later = machine("stop", "restart", ids=again)
    recall({"arm": later}, again, data)
    after = run(later, ticks=100)
    assert (after.reason, after.latch_id) == (Reason.LATCHED, held.latch_id)
    assert after.causes == ("stop", "restart")
    assert later.acknowledge(held.latch_id)
    assert run(later, STOP).latch_id == held.latch_id + 1  # never the same id twice


def test_restart_latches_although_nothing_was_latched():
    ids = LatchIds()
    later = machine("restart", ids=ids)
    recall({"arm": later}, ids, remembered({"arm": machine()}, LatchIds()))
    assert run(later, ticks=100).causes == ("restart",)


@pytest.mark.parametrize(
    "data",
    [
        {},
        {"last_id": -1, "robots": {}},
        {"last_id": 1, "robots": {"arm": {}}},
        {"last_id": 1, "robots": {"arm": {"latch_id": "x", "causes": []}}},
    ],
)
def test_what_is_no_memory_is_refused(data):
    ids = LatchIds()
    with pytest.raises((KeyError, TypeError, ValueError)):
        recall({"arm": machine(ids=ids)}, ids, data)


@pytest.mark.parametrize(("old", "new"), [(True, r"latch: \[stop\]"), (False, r"latch: \[\]")])
def test_the_old_key_says_what_to_write_instead(old, new):
    with pytest.raises(ConfigError, match=new):
        validated(RiskSettings, {"latch_stop": old}, "cell.yaml: risk")
