"""How wrong a past forecast was: interpolation, what is judged, and how much is remembered."""

import numpy as np
import pytest

from hri_predict.zones.self_check.past_forecasts import PastForecasts, forecast_errors, mean_error

RATE_HZ = 25.0
STEP_NS = 40_000_000
JOINTS = 4


def straight(count, steps):
    """A body that goes along x by 0.1 m a step from (1, 2, 3)."""
    last = np.tile([1.0, 2.0, 3.0], (count, JOINTS, 1))
    forecast = np.repeat(last[:, None], steps, axis=1)
    forecast[..., 0] += 0.1 * np.arange(1, steps + 1)[:, None]
    return last, forecast


@pytest.mark.parametrize("steps", [0.25, 1.0, 1.5, 4.75, 5.0])
def test_errors_are_those_of_the_line_between_the_steps(steps):
    last, forecast = straight(2, 5)
    truth = last + np.array([0.1 * steps, 0.3, 0.4])
    errors = forecast_errors(last, forecast, np.full(2, steps), truth)
    np.testing.assert_allclose(errors, 0.5)


def test_errors_of_what_is_not_finite_are_infinite():
    last, forecast = straight(3, 5)
    truth = last.copy()
    forecast[0, 1, 2] = np.nan
    truth[1, 0] = np.inf
    errors = forecast_errors(last, forecast, np.full(3, 1.5), truth)
    assert np.isinf(errors).tolist() == [
        [False, False, True, False],
        [True, False, False, False],
        [False] * 4,
    ]


def test_mean_error_is_over_the_judged_and_nan_without_any():
    errors = np.array([[1.0, 3.0, 100.0], [1.0, 1.0, 1.0], [np.inf, 1.0, 1.0]])
    judged = np.array([[True, True, False], [False] * 3, [True] * 3])
    np.testing.assert_array_equal(mean_error(errors, judged), [2.0, np.nan, np.inf])


def remembered(past, tick_ns, radius=None, slot=0, steps=5):
    last, forecast = straight(1, steps)
    grown = np.arange(1, steps + 1)[:, None] * np.ones(JOINTS) if radius is None else radius
    seen = np.ones(JOINTS, bool)
    past.remember(
        slot,
        tick_ns,
        last=last[0],
        seen=seen,
        forecast=forecast[0],
        radius=grown,
        widened=np.full(steps, 1.5),
    )
    return last[0]


def judge(past, capture_ns, truth, slot=0):
    seen = np.ones((1, JOINTS), bool)
    return past.judge(np.array([slot]), np.array([capture_ns]), truth[None], seen)


@pytest.mark.parametrize(
    ("age_ns", "step"), [(1, 0), (STEP_NS, 0), (STEP_NS + 1000, 1), (3 * STEP_NS, 2)]
)
def test_the_radius_is_that_of_the_step_that_ends_the_interval(age_ns, step):
    past = PastForecasts(1, JOINTS, RATE_HZ, 5)
    last = remembered(past, 10**9)
    judged = judge(past, 10**9 + age_ns, last)
    assert judged.step.tolist() == [step]
    error = 0.1 * age_ns / STEP_NS
    np.testing.assert_allclose(judged.errors, error, atol=1e-12)
    np.testing.assert_allclose(judged.ratio, error / (step + 1), atol=1e-12)
    assert judged.lead_s[0] == pytest.approx(age_ns * 1e-9)
    assert judged.widened.tolist() == [1.5]


def test_judged_up_to_the_horizon_and_neither_at_the_capture_nor_before():
    past = PastForecasts(1, JOINTS, RATE_HZ, 5)
    last = remembered(past, 10**9)
    ages = (-STEP_NS, 0, 5 * STEP_NS, 5 * STEP_NS + 1_000_000)
    counts = [len(judge(past, 10**9 + age, last).person) for age in ages]
    assert counts == [0, 0, 1, 0]


@pytest.mark.parametrize("hz", [10.0, 25.0, 30.0, 50.0, 120.0])
def test_the_whole_horizon_is_remembered_at_any_rate_of_captures(hz):
    past = PastForecasts(1, JOINTS, RATE_HZ, 25)
    for tick in range(300):
        now = 10**9 + round(tick / hz * 1e9)
        last = remembered(past, now, steps=25)
    leads = np.sort(judge(past, now, last).lead_s)
    gap = max(1 / hz, 0.024 + 1 / hz)  # a forecast, and the first capture 0.6 steps after it
    assert leads[0] <= gap + 1e-9
    assert leads[-1] >= 1.0 - gap - 1e-9
    assert np.diff(leads).max() <= gap + 1e-9
    assert len(leads) <= 25 / 0.6 + 1


def test_forgotten_is_forgotten_and_slots_are_apart():
    past = PastForecasts(2, JOINTS, RATE_HZ, 5)
    last = remembered(past, 10**9, slot=0)
    remembered(past, 10**9, slot=1)
    past.forget(0)
    assert len(judge(past, 10**9 + STEP_NS, last, slot=0).person) == 0
    assert len(judge(past, 10**9 + STEP_NS, last, slot=1).person) == 1
