"""The speed slider: 0 is held, it rises with a slope, falls at once, and 0 without advice."""

import math
from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.rtde.slider import LEAST, LONGEST_STEP_S, SpeedSlider
from hri_predict.protocol.messages import Advice, Level
from hri_predict.protocol.reasons import Reason

CLEAR = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, speed_limit_m_s=1.0, age_s=0.05)
STOP = replace(CLEAR, level=Level.STOP, speed_limit_m_s=0.0)
MS = 1_000_000
CYCLE_MS = 8
NO_AGES = (math.inf, math.nan, 1e300)  # nanoseconds of none of them are an integer


class Run:
    """A slider in time: 1 m/s is full speed, it rises by 0.5 per second, 0 is held for 0.5 s."""

    def __init__(self) -> None:
        self.now_ms = 1000
        self.slider = SpeedSlider(
            full_speed_m_s=1.0, rise_per_s=0.5, hold_s=0.5, silence_s=0.06, max_age_s=0.4
        )

    def run(self, ms: int, advice: Advice | None) -> list[float]:
        """Fractions written in this time, with the same advice in each cycle."""
        written = []
        for _ in range(ms // CYCLE_MS):
            self.now_ms += CYCLE_MS
            if advice is not None:
                self.slider.take(advice, self.now_ms * MS)
            written.append(self.at.fraction)
        return written

    @property
    def at(self):
        return self.slider.at(self.now_ms * MS)


def test_zero_is_held_then_the_slider_rises_with_its_slope():
    run = Run()
    assert set(run.run(480, CLEAR)) == {0.0}
    rising = run.run(2400, CLEAR)
    assert rising[-1] == 1.0
    steps = [b - a for a, b in pairwise(rising)]
    step = 0.5 * CYCLE_MS * 1e-3
    assert max(steps) <= LEAST + step + 1e-9  # the first is to LEAST, or one step beyond
    assert sorted(steps)[-2] <= step + 1e-9
    assert rising.index(1.0) * CYCLE_MS == pytest.approx(2000, abs=40)


def test_it_falls_at_once_and_begins_again_at_zero():
    run = Run()
    run.run(4000, CLEAR)
    assert run.run(CYCLE_MS, STOP) == [0.0]
    assert set(run.run(480, CLEAR)) == {0.0}
    assert run.run(400, CLEAR)[-1] == pytest.approx(0.2, abs=0.02)


def test_a_lower_limit_is_followed_at_once_without_a_stop():
    run = Run()
    run.run(4000, CLEAR)
    assert run.run(CYCLE_MS, replace(CLEAR, speed_limit_m_s=0.4)) == [0.4]
    assert run.run(240, CLEAR)[-1] == pytest.approx(0.4 + 0.5 * 0.24, abs=0.01)


def test_silence_is_zero_and_unknown_and_the_watchdog_stands():
    run = Run()
    run.run(4000, CLEAR)
    before = run.at
    assert run.run(64, None)[-1] == 0.0
    assert run.at.level == Level.UNKNOWN
    assert run.at.watchdog == before.watchdog


@pytest.mark.parametrize(
    "advice",
    [
        STOP,
        replace(CLEAR, level=Level.UNKNOWN),
        replace(CLEAR, level=Level.FAULT),
        replace(CLEAR, speed_limit_m_s=None),
        replace(CLEAR, speed_limit_m_s=float("nan")),
        replace(CLEAR, speed_limit_m_s=-1.0),
        replace(CLEAR, speed_limit_m_s=0.009),
        replace(CLEAR, age_s=None),
        replace(CLEAR, age_s=0.41),
        *(replace(CLEAR, age_s=age_s) for age_s in NO_AGES),
    ],
)
def test_what_permits_nothing_is_zero_at_once(advice):
    run = Run()
    run.run(4000, CLEAR)
    assert run.run(CYCLE_MS, advice) == [0.0]


@pytest.mark.parametrize("age_s", [None, 0.41, *NO_AGES])
def test_an_advice_without_a_fresh_capture_is_unknown(age_s):
    run = Run()
    run.run(80, replace(CLEAR, age_s=age_s))
    assert run.at.level == Level.UNKNOWN


def test_each_stop_for_missing_or_old_advice_is_counted_once():
    run = Run()
    run.run(4000, CLEAR)
    assert run.slider.timeouts == 0
    run.run(200, None)
    assert run.slider.timeouts == 1
    run.run(80, CLEAR)
    run.run(80, replace(CLEAR, age_s=0.41))
    assert run.slider.timeouts == 2
    run.run(80, CLEAR)
    run.run(80, STOP)
    run.run(80, None)  # the node itself had stopped the robot
    assert run.slider.timeouts == 2


def test_only_old_advice_since_the_connection_is_counted():
    run = Run()
    run.run(80, None)  # no Advice yet
    assert run.slider.timeouts == 0
    run.run(80, replace(CLEAR, age_s=0.41))
    assert run.slider.timeouts == 1


def test_a_new_connection_begins_at_zero():
    run = Run()
    run.run(4000, CLEAR)
    run.slider.restart()
    assert run.at.fraction == 0.0
    assert run.at.level == Level.UNKNOWN
    assert set(run.run(480, CLEAR)) == {0.0}


def test_a_link_that_was_held_up_does_not_jump():
    run = Run()
    run.run(1000, CLEAR)
    low = run.at.fraction
    run.now_ms += 3000
    run.slider.take(CLEAR, run.now_ms * MS)
    assert run.at.fraction <= low + 0.5 * LONGEST_STEP_S + 1e-9


LIMITS = st.one_of(st.none(), st.floats(-1, 3), st.just(float("nan")))


@given(
    st.lists(
        st.tuples(st.integers(1, 500), st.sampled_from(list(Level)), LIMITS, st.booleans()),
        max_size=60,
    )
)
def test_it_never_permits_more_than_the_newest_advice(steps):
    run = Run()
    limit, heard_ms, before = 0.0, -1000, 0.0
    for ms, level, asked, comes in steps:
        run.now_ms += ms
        if comes:
            run.slider.take(replace(CLEAR, level=level, speed_limit_m_s=asked), run.now_ms * MS)
            limit = asked if level.may_move and asked is not None and asked == asked else 0.0
            heard_ms = run.now_ms
        written = run.at
        allowed = limit if run.now_ms - heard_ms < 60 else 0.0
        assert 0.0 <= written.fraction <= max(0.0, min(1.0, allowed))
        assert written.fraction - before <= 0.5 * LONGEST_STEP_S + LEAST + 1e-9
        before = written.fraction
