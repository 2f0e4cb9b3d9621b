"""What a clock does is believed, what a delay does is not: hours of virtual time."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.people.clock.clock_alignment import BUCKET_NS, ClockAlignment
from hri_predict.people.clock.offset_line import AGREEING, BUCKETS, LOCK_NS, MAX_DRIFT, WANDER_NS

MS = 1_000_000
S = 1000 * MS
HOUR = 3600.0
LATENCY_S = 0.005
JITTER_S = 0.004
STALE_S = 0.14
"""Of a source at 25 Hz."""
LAG_S = (BUCKETS - AGREEING + 2) * BUCKET_NS / S
"""By so many seconds of its drift the line of a slow clock may lag."""

Course = Callable[[float], float]


def never(_t: float) -> float:
    return 0.0


def step(at_s: float, by_s: float) -> Course:
    return lambda t: by_s if t >= at_s else 0.0


def ramp(at_s: float, ppm: float) -> Course:
    return lambda t: max(0.0, t - at_s) * ppm * 1e-6


class Link:
    """A source at ``hz`` whose clock falls behind by ``behind(t)``, and a way that delays."""

    def __init__(self, behind: Course = never, delay: Course = never, hz: float = 1.0) -> None:
        self.alignment = ClockAlignment(round(1e9 / hz), round(LATENCY_S * 1e9))
        self.behind, self.delay, self.hz = behind, delay, hz
        self.now_s = 0.0
        self._rng = np.random.default_rng(0)
        self._sequence = 0

    def run(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """Send for so long. (n,) claimed ages and (n,) true ages, seconds."""
        count = round(seconds * self.hz)
        claimed, true = np.empty(count), np.empty(count)
        jitter = self._rng.exponential(JITTER_S, count)
        for i in range(count):
            self.now_s += 1 / self.hz
            self._sequence += 1
            late_s = LATENCY_S + float(jitter[i]) + self.delay(self.now_s)
            captured_ns = round((1000 + self.now_s) * S)
            receipt_ns = captured_ns + round(late_s * S)
            stamp_ns = captured_ns - round(self.behind(self.now_s) * S)
            aligned_ns = self.alignment.align(stamp_ns, self._sequence, receipt_ns)
            claimed[i], true[i] = (receipt_ns - aligned_ns) / S, late_s
        return claimed, true

    def pause(self, seconds: float, *, counted: bool = True) -> None:
        self.now_s += seconds
        self._sequence += round(seconds * self.hz) if counted else 0


@pytest.mark.parametrize("ppm", [-200, -100, -50, 50, 100, 200])
def test_an_honest_clock_works_for_a_shift(ppm):
    link = Link(behind=ramp(0, ppm))
    claimed, true = link.run(8 * HOUR)
    wrong = (claimed - true)[60:]
    assert not link.alignment.late
    # a bucket has few scenes here, and all of them come late by some of the jitter
    assert wrong.min() >= -3 * JITTER_S
    assert wrong.max() <= LAG_S * abs(ppm) * 1e-6 + 3 * JITTER_S
    found = link.alignment.estimate()
    assert found is not None
    assert found.drift_ppm == pytest.approx(-ppm, abs=LOCK_NS / S / (0.5 * HOUR) * 1e6)
    assert found.rise_ns == pytest.approx(8 * HOUR * ppm * 1e3, abs=30 * MS)


@pytest.mark.parametrize(("amplitude_ppm", "period_s"), [(3, 8 * HOUR), (10, 2 * HOUR)])
@pytest.mark.parametrize("steady_ppm", [-40, 0, 40])
def test_a_clock_that_follows_the_temperature_works_for_a_shift(
    amplitude_ppm, period_s, steady_ppm
):
    def behind(t: float) -> float:
        waves = 1 - math.cos(2 * math.pi * t / period_s)
        return (steady_ppm * t + amplitude_ppm * period_s / (2 * math.pi) * waves) * 1e-6

    link = Link(behind)
    claimed, true = link.run(8 * HOUR)
    assert not link.alignment.late
    assert (claimed - true)[60:].max() <= LOCK_NS / S + 3 * JITTER_S


@pytest.mark.parametrize("by_s", [0.25, 0.5])
@pytest.mark.parametrize("at_s", [30, 600, 1.5 * HOUR])
@pytest.mark.parametrize("ppm", [-100, 0, 50])
def test_a_lasting_delay_never_becomes_fresh(by_s, at_s, ppm):
    link = Link(ramp(0, ppm), step(at_s, by_s))
    link.run(at_s - 1)
    claimed, true = link.run(6 * HOUR)
    assert claimed[2:].min() > STALE_S
    assert (claimed - true)[2:].min() >= -0.02
    assert link.alignment.late


@pytest.mark.parametrize(("growth_ppm", "stale_after_s"), [(1000, 200), (300, 900)])
@pytest.mark.parametrize("at_s", [0, 60, 600, 1.5 * HOUR])
@pytest.mark.parametrize("ppm", [-50, 0])
def test_a_growing_delay_becomes_stale_and_stays_so(growth_ppm, stale_after_s, at_s, ppm):
    link = Link(ramp(0, ppm), ramp(at_s, growth_ppm))
    link.run(at_s + stale_after_s)
    claimed, _ = link.run(2 * HOUR)
    assert claimed.min() > STALE_S
    assert link.alignment.late


@pytest.mark.parametrize("growth_ppm", [12, 20, 50, 150])
def test_after_the_drift_is_learnt_an_age_is_too_small_by_no_more_than_is_configured(growth_ppm):
    link = Link(delay=ramp(HOUR, growth_ppm))
    claimed, true = link.run(8 * HOUR)
    assert (claimed - true).min() >= -(WANDER_NS + LOCK_NS) / S
    assert claimed[-1] > STALE_S
    found = link.alignment.estimate()
    assert found is not None
    assert found.wandered_ns <= WANDER_NS


def test_a_delay_that_ends_is_forgotten():
    link = Link(ramp(0, 50), delay=lambda t: 0.3 * (HOUR <= t < 2 * HOUR))
    link.run(2 * HOUR - 1)
    assert link.alignment.late
    link.run(90)
    claimed, true = link.run(HOUR)
    assert not link.alignment.late
    assert np.abs(claimed - true).max() <= LOCK_NS / S


@pytest.mark.parametrize("ppm", [-50, 0, 50])
def test_an_hour_of_pause_is_bridged_by_the_drift_learnt(ppm):
    link = Link(ramp(0, ppm))
    link.run(HOUR)
    link.pause(HOUR)
    claimed, true = link.run(HOUR)
    assert np.abs((claimed - true)[10:]).max() <= LOCK_NS / S
    assert not link.alignment.late


@pytest.mark.parametrize("counted", [True, False])
@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("by_s", [0.25, 5.0])
@pytest.mark.parametrize("pause_s", [5, 900])
def test_a_delay_that_begins_in_a_pause_or_at_a_restart_is_not_believed(
    counted, restart, by_s, pause_s
):
    """The stamps go on: it is the same clock, whatever else began anew."""
    link = Link(delay=step(HOUR + 1, by_s))
    link.run(HOUR)
    link.pause(pause_s, counted=counted)
    if restart:
        link.alignment.restart()
        link._sequence = 0
    claimed, true = link.run(HOUR)
    assert claimed.min() > STALE_S
    assert (claimed - true).min() >= -LOCK_NS / S
    assert link.alignment.late


def test_stamps_that_alternate_at_the_limit_of_a_jump_leave_nothing_behind():
    link = Link(hz=25)
    link.run(60)
    good = link.behind
    link.behind = lambda t: good(t) + 0.06 * (-1) ** round(t * 25)
    link.run(4)
    link.behind = good
    link.run(3 * BUCKET_NS / S)
    claimed, true = link.run(60)
    assert np.abs(claimed - true).max() <= LOCK_NS / S


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.01, 0.05, 0.06, 0.1, 0.2, 1.0, 100.0]),
    st.floats(0.2, 9.0),
    st.sampled_from(["noise", "alternating", "ramp", "offset"]),
    st.sampled_from([3.0, 30.0, 120.0]),
)
def test_after_any_short_fault_of_stamps_good_ones_are_soon_believed(
    seed, size_s, seconds, shape, before_s
):
    """But where they look like a delay: then they are old, and never too new."""
    rng = np.random.default_rng(seed)
    link = Link(hz=25)
    link.run(before_s)
    start_s = link.now_s
    link.behind = {
        "noise": lambda _t: float(rng.uniform(-size_s, size_s)),
        "alternating": lambda t: size_s * (-1) ** round(t * 25),
        "ramp": lambda t: size_s * (t - start_s) * rng.choice([-1, 1]),
        "offset": lambda _t: size_s * (-1) ** seed,
    }[shape]
    link.run(seconds)
    link.behind = never
    link.run(3 * BUCKET_NS / S)
    claimed, true = link.run(30)
    assert (claimed - true).min() >= -LOCK_NS / S
    assert claimed.max() < STALE_S
    assert not link.alignment.jumped


def test_the_drift_that_is_believed_is_within_what_clocks_do():
    """RFC 5905 gives a quartz 15 ppm; two of 100 ppm differ by 200."""
    assert MAX_DRIFT == 200e-6
