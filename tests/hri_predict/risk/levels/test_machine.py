"""Levels: down at once, up slowly, latched stops."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.demand import Demand, combined, demand_of
from hri_predict.risk.levels.machine import LevelMachine
from hri_predict.risk.separation.now import Braking, judge_iso
from hri_predict.risk.settings import RiskSettings
from hri_predict.risk.terms import Finding
from hri_predict.robots.stopping import StoppingCurve
from tests.hri_predict.risk.demands import asks

MAX = 1.0
TICK_NS = 40_000_000
SETTINGS = RiskSettings(release_captures=3, speed_rise_m_s2=0.5, min_speed_m_s=0.05)
CLEAR = Demand.nothing(MAX)
WARN = asks(Level.WARN, MAX)
SLOW = asks(Level.SLOW, 0.4, release_limit_m_s=0.3)
STOP = asks(Level.STOP, 0.0, Reason.PERSON_NEAR)
IN_BAND = asks(Level.SLOW, 0.1, release=Level.STOP, release_limit_m_s=0.0)
UNKNOWN = Demand.unknown(Reason.INPUT_STALE)


class Run:
    """A machine, fed tick by tick with a new capture each, unless told otherwise."""

    def __init__(self, settings: RiskSettings = SETTINGS) -> None:
        ids = itertools.count(1)
        self.machine = LevelMachine(settings, MAX, lambda: next(ids))
        self.captures = 0
        self.now_ns = 0

    def __call__(self, demand: Demand, ticks: int = 1, new_capture: bool = True):
        for _ in range(ticks):
            self.captures += new_capture
            self.now_ns += TICK_NS
            advised = self.machine.update(demand, self.captures, self.now_ns)
        return advised

    def to_clear(self) -> "Run":
        assert self(CLEAR, 100).level is Level.CLEAR
        return self


def test_it_begins_at_unknown_and_needs_captures():
    run = Run()
    for _ in range(2):
        advised = run(CLEAR)
        assert (advised.level, advised.reason) == (Level.UNKNOWN, Reason.RELEASE_PENDING)
        assert advised.limit_m_s == 0.0
    advised = run(CLEAR)
    assert advised.level is Level.SLOW  # released; the limit is still rising
    assert 0 < advised.limit_m_s < MAX
    assert run(CLEAR, 60).level is Level.CLEAR


@pytest.mark.parametrize("demand", [WARN, SLOW, STOP, UNKNOWN])
def test_one_capture_is_enough_to_trigger(demand):
    advised = Run().to_clear()(demand)
    assert (advised.level, advised.reason) == (demand.level, demand.reason)
    assert advised.limit_m_s == demand.limit_m_s


def test_release_counts_distinct_captures_not_ticks():
    run = Run().to_clear()
    run(STOP)
    assert run(CLEAR, 50, new_capture=False).level is Level.STOP
    assert run(CLEAR, 2).level is Level.STOP
    assert run(CLEAR, 20, new_capture=False).reason is Reason.RELEASE_PENDING
    assert run(CLEAR).level is Level.SLOW


def test_a_relapse_starts_the_count_anew():
    run = Run().to_clear()
    run(STOP)
    run(CLEAR, 2)
    run(STOP)
    assert run(CLEAR, 2).level is Level.STOP


def test_within_the_band_the_level_stays():
    run = Run().to_clear()
    run(STOP)
    advised = run(IN_BAND, 50)
    assert (advised.level, advised.limit_m_s) == (Level.STOP, 0.0)
    assert advised.reason is Reason.PERSON_APPROACHING
    run = Run()
    assert run(IN_BAND, 50).level is Level.STOP  # known, so no longer unknown
    assert Run().to_clear()(IN_BAND).level is Level.SLOW


def test_the_limit_falls_at_once_and_rises_slowly():
    run = Run().to_clear()
    assert run(SLOW).limit_m_s == 0.4
    run(STOP)
    before = run(SLOW, 3).limit_m_s
    after = run(SLOW).limit_m_s
    assert after - before == pytest.approx(0.5 * 0.04)
    assert run(SLOW, 100).limit_m_s == pytest.approx(0.3)  # rises no further than the band allows
    lower = asks(Level.SLOW, 0.2, release_limit_m_s=0.1)
    assert run(lower).limit_m_s == 0.2


def test_a_latched_stop_needs_an_acknowledgement_after_its_cause_has_cleared():
    run = Run(SETTINGS.model_copy(update={"latch": ["stop"]})).to_clear()
    stopped = run(STOP)
    assert (stopped.latch_id, stopped.causes) == (0, ("stop",))
    assert not run.machine.acknowledge(stopped.latch_id)
    assert run(STOP).latch_id == 0  # the cause is still there
    assert run(IN_BAND).latch_id == 0
    latched = run(CLEAR, 50)
    assert (latched.level, latched.reason, latched.latch_id) == (Level.STOP, Reason.LATCHED, 1)
    assert not run.machine.acknowledge(2)
    assert not run.machine.acknowledge(0)
    assert run.machine.acknowledge(1)
    assert not run.machine.acknowledge(1)
    # the acknowledgement itself starts nothing
    pending = run(CLEAR, 5, new_capture=False)
    assert (pending.level, pending.reason) == (Level.STOP, Reason.RELEASE_PENDING)
    assert pending.limit_m_s == 0.0
    assert run(CLEAR, 2).level is Level.STOP
    assert run(CLEAR).level is Level.SLOW
    run(STOP)
    assert run(CLEAR).latch_id == 2


SUPERVISED = SETTINGS.model_copy(update={"latch": ["stop"], "restart": "supervised"})


def test_a_supervised_latch_waits_until_the_level_would_be_clear():
    run = Run(SUPERVISED).to_clear()
    run(STOP)
    for demand in (SLOW, WARN, UNKNOWN):
        assert run(demand, 50).latch_id == 0
    assert run(CLEAR).latch_id == 1
    assert run(WARN).latch_id == 0  # a condition is back, and the number is not shown


def test_a_supervised_press_that_began_before_all_was_clear_releases_nothing():
    run = Run(SUPERVISED).to_clear()
    run(STOP)
    before_ns = run.now_ns
    latched = run(CLEAR, 50)
    assert not run.machine.acknowledge(latched.latch_id, before_ns)
    again = run(CLEAR)
    assert again.latch_id == latched.latch_id + 1  # each number is used once
    assert run.machine.acknowledge(again.latch_id, run.now_ns)


def test_a_latch_outlives_unknown():
    run = Run(SETTINGS.model_copy(update={"latch": ["stop"]})).to_clear()
    run(STOP)
    blind = run(UNKNOWN)
    assert (blind.level, blind.latch_id, blind.causes) == (Level.UNKNOWN, 0, ("stop",))
    shown = run(CLEAR, 50)
    assert shown.reason is Reason.LATCHED
    run.machine.reset()
    assert not run.machine.acknowledge(shown.latch_id)
    assert run(CLEAR, 50).reason is Reason.LATCHED


def test_reset_forgets_what_speaks_for_a_release():
    run = Run().to_clear()
    run.machine.reset()
    advised = run(CLEAR)
    assert (advised.level, advised.limit_m_s) == (Level.UNKNOWN, 0.0)


demands = st.sampled_from([CLEAR, WARN, SLOW, STOP, IN_BAND, UNKNOWN])


@given(
    st.lists(st.tuples(demands, st.booleans()), max_size=60),
    st.sampled_from([[], ["stop"], ["stop", "start", "blind"]]),
)
def test_advice_is_never_milder_than_asked(sequence, latch):
    run = Run(SETTINGS.model_copy(update={"latch": latch}))
    last, agreeing = run(CLEAR), 1
    for demand, new_capture in sequence:
        advised = run(demand, new_capture=new_capture)
        assert advised.level.rank >= demand.level.rank
        assert advised.limit_m_s <= demand.limit_m_s
        assert advised.limit_m_s <= last.limit_m_s + 0.5 * 0.04 + 1e-9
        if advised.level.rank == Level.STOP.rank:
            assert advised.limit_m_s == 0.0
        assert (advised.level is Level.UNKNOWN) >= (demand.level is Level.UNKNOWN)
        stopped = demand.release.rank >= Level.STOP.rank
        agreeing = 0 if stopped else agreeing + new_capture
        if last.level.rank == 3 and advised.level.rank < 3:
            assert agreeing >= 3
        last = advised


def finding(slack_m: float, *limits: float) -> Finding:
    return Finding(
        separation_m=1.0, predicted_m=1.0, slack_m=slack_m, near=False, breach_s=0.0, limits=limits
    )


@pytest.mark.parametrize(
    ("slack", "limits", "level", "release"),
    [
        (1.0, (1, 1, 1, 1), Level.CLEAR, Level.CLEAR),
        (1.0, (1, 1, 1, 0.9), Level.CLEAR, Level.WARN),
        (1.0, (1, 1, 0.9, 0.8), Level.WARN, Level.WARN),
        (1.0, (1, 0.9, 0.8, 0.8), Level.WARN, Level.SLOW),
        (1.0, (0.9, 0.8, 0.5, 0.4), Level.SLOW, Level.SLOW),
        (0.05, (0.9, 0.8, 0.5, 0.4), Level.SLOW, Level.STOP),  # slack within the band
        (-0.01, (0.9, 0.8, 0.5, 0.4), Level.STOP, Level.STOP),
        (1.0, (0.06, 0.04, 0, 0), Level.SLOW, Level.STOP),  # below min_speed
        (1.0, (0.04, 0, 0, 0), Level.STOP, Level.STOP),
        (float("nan"), (1, 1, 1, 1), Level.STOP, Level.STOP),
    ],
)
def test_levels_of_a_finding(slack, limits, level, release):
    demand = demand_of(finding(slack, *limits), SETTINGS, MAX, Reason.PERSON_NEAR)
    assert (demand.level, demand.release) == (level, release)
    assert demand.reason is (Reason.NONE if level is Level.CLEAR else Reason.PERSON_NEAR)
    assert demand.limit_m_s == (0.0 if level is Level.STOP else limits[0])


def test_margins():
    settings = RiskSettings(slow_margin_m=0.2, band_m=0.1, warn_margin_m=0.5)
    assert settings.margins_m == pytest.approx((0.2, 0.3, 0.7, 0.8))


def test_demands_combine_to_the_severest():
    both = combined([SLOW, WARN, CLEAR], MAX)
    assert (both.level, both.limit_m_s, both.reason) == (Level.SLOW, 0.4, SLOW.reason)
    assert combined([SLOW, STOP], MAX).reason is Reason.PERSON_NEAR
    assert combined([UNKNOWN, STOP], MAX).level is Level.UNKNOWN
    assert combined([STOP, UNKNOWN], MAX).limit_m_s == 0.0
    assert combined([], MAX) == CLEAR


# A person who walks straight towards a robot, or away from it; the robot obeys. What is too close
# for the robot at speed is not too close for the one that has stopped: the loop that could swing.
PERIOD_S = 1 / 30
CURVE = StoppingCurve.of(lambda v: (v / 3.0, v * v / 6.0), MAX)
DEFAULTS = RiskSettings()


def walk(start_m: float, person_m_s: float, noise_m: float, seed: int) -> list[Level]:
    """Levels, one a capture, of a walk that begins after the robot has come to full speed."""
    rng = np.random.default_rng(seed)
    machine = LevelMachine(DEFAULTS, MAX, lambda: 1)
    speed, limit, levels = 0.0, 0.0, []
    for capture in range(600):
        walked_s = max(0.0, capture * PERIOD_S - 4.0)
        distance = start_m + person_m_s * min(walked_s, 12.0) + rng.normal(0.0, noise_m)
        braking = Braking(
            speed_m_s=speed,
            stopping=CURVE.at(speed),
            curve=CURVE,
            reaction_s=0.3,
            clearance_m=0.06,
            margins_m=DEFAULTS.margins_m,
        )
        finding = judge_iso(braking, max(distance, 0.0))
        demand = demand_of(finding, DEFAULTS, MAX, Reason.PERSON_APPROACHING)
        advised = machine.update(demand, capture, round(capture * PERIOD_S * 1e9))
        change = min(max(limit - speed, -3.0 * PERIOD_S), 3.0 * PERIOD_S)
        speed, limit = speed + change, advised.limit_m_s  # it hears of it a capture later
        levels.append(advised.level)
    return levels[60:]


def reentries(levels: list[Level]) -> list[int]:
    """For each level that is left and entered again: captures in between."""
    left: dict[Level, int] = {}
    gaps = []
    for i, (before, after) in enumerate(itertools.pairwise(levels)):
        if before is not after:
            left[before] = i
            if after in left:
                gaps.append(i - left[after])
    return gaps


@given(st.floats(2.5, 5.0), st.floats(0.1, 2.0), st.floats(0, 0.01), st.integers(0, 99))
def test_levels_do_not_flap_while_a_person_comes(start, speed, noise, seed):
    gaps = reentries(walk(start, -speed, noise, seed))
    assert all(gap >= DEFAULTS.release_captures for gap in gaps)


@given(st.floats(0.1, 1.5), st.floats(0.1, 2.0), st.floats(0, 0.01), st.integers(0, 99))
def test_levels_do_not_flap_while_a_person_goes(start, speed, noise, seed):
    levels = walk(start, speed, noise, seed)
    assert all(gap >= DEFAULTS.release_captures for gap in reentries(levels))


def test_a_person_who_comes_meets_every_level_once():
    levels = walk(4.0, -0.8, 0.004, 1)
    seen = [level for level, _ in itertools.groupby(levels)]
    start = seen.index(Level.CLEAR)
    assert seen[start:] == [Level.CLEAR, Level.WARN, Level.SLOW, Level.STOP]


def test_a_release_does_not_show_what_the_rising_limit_takes_back():
    """From a recorded run: half released, the limit still rising, it alternated each tick."""
    run = Run().to_clear()
    run(SLOW)
    warn_in_band = asks(Level.CLEAR, MAX, Reason.NONE, release=Level.WARN)
    levels = [run(d).level for d in [WARN, warn_in_band] * 40]
    seen = [level for level, _ in itertools.groupby(levels)]
    assert seen == [Level.SLOW, Level.WARN]


def test_a_stop_is_not_released_for_a_speed_that_will_not_last():
    run = Run().to_clear()
    run(STOP)
    for limit in (0.5, 0.4, 0.25, 0.2, 0.1, 0.06):  # somebody comes nearer to the standing robot
        assert run(asks(Level.SLOW, limit)).level is Level.STOP
    assert run(asks(Level.SLOW, 0.3, Reason.PERSON_NEAR), 3).level is Level.SLOW


def test_the_band_never_raises_a_level():
    run = Run().to_clear()
    band = asks(Level.CLEAR, MAX, Reason.NONE, release=Level.SLOW, release_limit_m_s=0.8)
    assert run(band, 5).level is Level.CLEAR
