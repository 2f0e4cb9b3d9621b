"""The publish phase: when messages leave, and what it is learned from."""

import pytest

from hri_predict.base.clock import VirtualClock
from hri_predict.node.publish_phase import LEARN_TICKS_S, PublishPhase

MS = 1_000_000
RATE_HZ = 25.0
CYCLE_NS = 40 * MS


def ticked(phase, clock, deadline_ns, taken_ns, *, people=True, urgent=False):
    """Run a tick that computes for ``taken_ns``; return the time at which its messages leave."""
    clock.advance_to(deadline_ns)
    phase.begin(deadline_ns)
    clock.advance_to(deadline_ns + taken_ns)
    phase.hold(learn=people, urgent=urgent)
    return clock.now_ns() - deadline_ns


def many(phase, clock, durations, **kind):
    start_ns = clock.now_ns() + CYCLE_NS
    return [
        ticked(phase, clock, start_ns + k * CYCLE_NS, taken_ns, **kind)
        for k, taken_ns in enumerate(durations)
    ]


def test_messages_leave_at_the_phase_whatever_the_tick_took():
    clock = VirtualClock()
    phase = PublishPhase(clock, 0.010, 0.020, RATE_HZ)
    assert many(phase, clock, [2 * MS, 9 * MS, 5 * MS]) == [10 * MS] * 3
    assert phase.held_ns == 5 * MS


def test_a_tick_that_takes_longer_is_not_held():
    clock = VirtualClock()
    phase = PublishPhase(clock, 0.010, 0.020, RATE_HZ)
    assert many(phase, clock, [13 * MS]) == [13 * MS]
    assert phase.held_ns == 0


def test_what_is_more_severe_leaves_at_once():
    clock = VirtualClock()
    phase = PublishPhase(clock, 0.010, 0.020, RATE_HZ)
    assert many(phase, clock, [2 * MS], urgent=True) == [2 * MS]


def test_without_a_deadline_nothing_waits():
    clock = VirtualClock(5 * MS)
    PublishPhase(clock, 0.010, 0.020, RATE_HZ).hold(learn=True, urgent=False)
    assert clock.now_ns() == 5 * MS


def test_the_phase_is_learned_from_a_minute_of_ticks_and_then_fixed():
    clock = VirtualClock()
    phase = PublishPhase(clock, None, 0.020, RATE_HZ)
    count = round(LEARN_TICKS_S * RATE_HZ)
    # one tick of a thousand takes 15 ms, of the others the longest 8
    many(phase, clock, [15 * MS if k % 1000 == 7 else (k % 7 + 2) * MS for k in range(count)])
    assert phase.phase_s == pytest.approx(0.008)
    many(phase, clock, [12 * MS] * 500)
    assert phase.phase_s == pytest.approx(0.008)


def test_while_it_learns_the_phase_follows_each_second():
    clock = VirtualClock()
    phase = PublishPhase(clock, None, 0.020, RATE_HZ)
    assert many(phase, clock, [3 * MS] * 25)[:24] == [3 * MS] * 24
    assert many(phase, clock, [1 * MS]) == [3 * MS]


def test_an_empty_room_teaches_nothing():
    clock = VirtualClock()
    phase = PublishPhase(clock, None, 0.020, RATE_HZ)
    many(phase, clock, [1 * MS] * 2000, people=False)
    assert phase.phase_s == 0.0
    many(phase, clock, [6 * MS] * 25)
    assert phase.phase_s == pytest.approx(0.006)


def test_a_learned_phase_stays_within_the_delay_budget():
    clock = VirtualClock()
    phase = PublishPhase(clock, None, 0.020, RATE_HZ)
    many(phase, clock, [35 * MS] * 50)
    assert phase.phase_s == pytest.approx(0.020)


def test_a_few_slow_ticks_do_not_make_all_messages_old():
    clock = VirtualClock()
    phase = PublishPhase(clock, None, 0.020, RATE_HZ)
    many(phase, clock, [18 * MS if k % 20 == 7 else 2 * MS for k in range(500)])
    assert phase.phase_s == pytest.approx(0.007)
