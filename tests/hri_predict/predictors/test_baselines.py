"""Zero velocity and constant velocity, with everything observed and with holes."""

import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL, make_skeleton
from hri_predict.predictors.baselines import (
    ConstantVelocity,
    ConstantVelocitySettings,
    ZeroVelocity,
    ZeroVelocitySettings,
)

LIMB = make_skeleton("limb", ["a", "b", "c", "d"], [-1, 0, 1, 2])


def constant_velocity(
    rate_hz: float = 10.0, span_s: float = 0.3, history_s: float = 0.8, horizon_s: float = 0.5
) -> ConstantVelocity:
    settings = ConstantVelocitySettings(
        name="constant_velocity",
        rate_hz=rate_hz,
        span_s=span_s,
        history_s=history_s,
        horizon_s=horizon_s,
    )
    return ConstantVelocity(settings, LIMB)


def zero_velocity() -> ZeroVelocity:
    settings = ZeroVelocitySettings(
        name="zero_velocity", rate_hz=10.0, history_s=0.8, horizon_s=0.5
    )
    return ZeroVelocity(settings, LIMB)


def test_shapes_follow_rate_span_and_horizon():
    assert constant_velocity().history_steps == 9
    assert constant_velocity(span_s=1.2).history_steps == 13
    assert constant_velocity(rate_hz=30, span_s=0.1, history_s=0.1).history_steps == 4
    assert constant_velocity(rate_hz=25, horizon_s=1.0).horizon_steps == 25
    assert constant_velocity(rate_hz=25, horizon_s=0.5).horizon_steps == 13  # reaches 0.52 s
    assert ZeroVelocity(ZeroVelocitySettings(name="z")).skeleton is CANONICAL


def test_uniform_motion_goes_on():
    model = constant_velocity()
    velocity = np.array([1.0, -0.5, 0.25])
    times = np.arange(-8, 6)[:, None, None] / 10.0
    truth = np.broadcast_to(velocity * times, (14, 4, 3)) + np.arange(4)[:, None]
    forecast = model.predict(truth[None, :9], np.ones((1, 9, 4), bool))
    np.testing.assert_allclose(forecast.positions[0], truth[9:], atol=1e-12)
    assert forecast.std is None


def test_velocity_is_taken_over_the_span():
    model = constant_velocity(span_s=0.3)
    history = np.zeros((1, 9, 4, 3))
    history[0, :, 0, 0] = [9, 9, 9, 9, 9, 1.0, 9, 9, 4.0]  # only steps 5 and 8 count
    forecast = model.predict(history, np.ones((1, 9, 4), bool)).positions[0, :, 0, 0]
    np.testing.assert_allclose(forecast, 4.0 + np.arange(1, 6) * 1.0)


def test_zero_velocity_repeats_the_newest_observed():
    history = np.zeros((1, 9, 4, 3))
    history[0, :, :, 2] = np.arange(9)[:, None]
    observed = np.ones((1, 9, 4), bool)
    observed[0, 6:, 1] = False
    forecast = zero_velocity().predict(history, observed).positions
    assert forecast.shape == (1, 5, 4, 3)
    np.testing.assert_array_equal(forecast[0, :, :, 2], np.tile([8, 5, 8, 8], (5, 1)))


@pytest.mark.parametrize(
    ("seen", "used"),
    [
        ([5, 8], (5, 8)),  # exactly the span
        ([4, 6, 8], (4, 8)),  # 4 and 6 are as near to 5: the earlier, that is the longer base
        ([1, 7, 8], (7, 8)),
        ([1, 8], (1, 8)),
        ([2, 3, 6], (3, 6)),  # gone for two steps: the span before the newest observed
    ],
)
def test_nearest_observed_pair_stands_in(seen, used):
    model = constant_velocity(span_s=0.3)
    x = np.array([3.0, 1, 4, 1, 5, 9, 2, 6, 5]) ** 2
    history = np.zeros((1, 9, 4, 3))
    history[0, :, :, 0] = x[:, None]
    observed = np.zeros((1, 9, 4), bool)
    observed[0, seen] = True
    start, end = used
    slope = (x[end] - x[start]) / (end - start)
    expected = x[end] + slope * (8 - end + np.arange(1, 6))
    forecast = model.predict(history, observed).positions[0, :, :, 0]
    np.testing.assert_allclose(forecast, np.tile(expected[:, None], (1, 4)))


def test_one_observation_gives_no_velocity():
    history = np.random.default_rng(0).normal(size=(1, 9, 4, 3))
    observed = np.zeros((1, 9, 4), bool)
    observed[0, 3] = True
    forecast = constant_velocity().predict(history, observed).positions
    np.testing.assert_array_equal(forecast[0], np.tile(history[0, 3], (5, 1, 1)))


@pytest.mark.parametrize("model", [constant_velocity(), zero_velocity()])
def test_joint_never_observed_goes_with_its_nearest_neighbour(model):
    history = np.random.default_rng(1).normal(size=(1, 9, 4, 3))
    observed = np.ones((1, 9, 4), bool)
    observed[0, :, 2:] = False  # c and d hang on b
    forecast = model.predict(history, observed).positions[0]
    np.testing.assert_array_equal(forecast[:, 2], forecast[:, 1])
    np.testing.assert_array_equal(forecast[:, 3], forecast[:, 1])
    assert not np.array_equal(forecast[:, 0], forecast[:, 1])


@pytest.mark.parametrize("model", [constant_velocity(), zero_velocity()])
def test_nobody_observed_is_zero(model):
    history = np.full((2, 9, 4, 3), 5.0)
    forecast = model.predict(history, np.zeros((2, 9, 4), bool)).positions
    np.testing.assert_array_equal(forecast, 0.0)


def plain_constant_velocity(history, observed, span, horizon):
    """The rule of the docstring, joint by joint."""
    steps, joints = observed.shape
    result = np.zeros((horizon, joints, 3))
    now, velocity, seen = {}, {}, []
    for j in range(joints):
        times = [t for t in range(steps) if observed[t, j]]
        if not times:
            continue
        seen.append(j)
        end = times[-1]
        others = sorted(times[:-1], key=lambda t: (abs(t - (end - span)), t))
        v = (history[end, j] - history[others[0], j]) / (end - others[0]) if others else np.zeros(3)
        velocity[j], now[j] = v, history[end, j] + v * (steps - 1 - end)
    for j in range(joints):
        if seen:
            k = min(seen, key=lambda s: (abs(s - j), s))  # LIMB is a chain
            result[:, j] = now[k] + velocity[k] * np.arange(1, horizon + 1)[:, None]
    return result


@given(seed=st.integers(0, 2**32 - 1), seen=st.floats(0, 1), span=st.integers(1, 8))
def test_equals_a_plain_loop(seed, seen, span):
    rng = np.random.default_rng(seed)
    history = rng.normal(size=(3, 9, 4, 3))
    observed = rng.random((3, 9, 4)) < seen
    forecast = constant_velocity(span_s=span / 10).predict(history, observed).positions
    for person in range(3):
        expected = plain_constant_velocity(history[person], observed[person], span, 5)
        np.testing.assert_allclose(forecast[person], expected, atol=1e-9)


def test_settings_name_the_wrong_key():
    with pytest.raises(ConfigError, match="predictor: spam_s: unknown key; did you mean 'span_s'"):
        validated(ConstantVelocitySettings, {"name": "cv", "spam_s": 0.1}, "predictor")
    with pytest.raises(ConfigError, match="predictor: span_s: input should be greater than or"):
        validated(ConstantVelocitySettings, {"name": "cv", "span_s": 0}, "predictor")


@pytest.mark.parametrize("module", ["baselines", "kalman"])
def test_torch_is_not_imported(module):
    code = f"import sys, hri_predict.predictors.{module}; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
