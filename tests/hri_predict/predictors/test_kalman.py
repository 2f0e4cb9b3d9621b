"""The Kalman filter against its textbook form in matrices, and its honesty about itself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, make_skeleton
from hri_predict.predictors.kalman import (
    UNKNOWN_STD_M,
    ConstantAccelerationKalman,
    KalmanSettings,
)

POINTS = make_skeleton("points", ["a", "b"], [-1, 0], bone_lengths=[0.0, 0.4])


def kalman(skeleton=POINTS, **changes: float) -> ConstantAccelerationKalman:
    values = {"rate_hz": 20.0, "history_s": 0.5, "horizon_s": 0.4, **changes}
    return ConstantAccelerationKalman(KalmanSettings(name="kalman", **values), skeleton)


def textbook(measured, observed, s: KalmanSettings, horizon: int):
    """One axis of one joint by matrices: predicted means and standard deviations."""
    t = 1.0 / s.rate_hz

    def transition(t):
        return np.array([[1, t, t * t / 2], [0, 1, t], [0, 0, 1]])

    def noise(t):
        q = [
            [t**5 / 20, t**4 / 8, t**3 / 6],
            [t**4 / 8, t**3 / 3, t**2 / 2],
            [t**3 / 6, t**2 / 2, t],
        ]
        return s.jerk_density * np.array(q)

    x = np.array([measured[np.argmax(observed)] if observed.any() else 0.0, 0, 0])
    p = np.diag([UNKNOWN_STD_M, s.speed_std_m_s, s.acceleration_std_m_s2]) ** 2
    for step, (z, seen) in enumerate(zip(measured, observed, strict=True)):
        if step:
            x, p = transition(t) @ x, transition(t) @ p @ transition(t).T + noise(t)
        if seen:
            gain = p[:, 0] / (p[0, 0] + s.measurement_std_m**2)
            x = x + gain * (z - x[0])
            # Joseph's form: stays positive whatever the gain
            keep = np.eye(3) - np.outer(gain, [1, 0, 0])
            p = keep @ p @ keep.T + np.outer(gain, gain) * s.measurement_std_m**2
    means, stds = [], []
    for k in range(1, horizon + 1):
        f = transition(k * t)
        means.append((f @ x)[0])
        stds.append(np.sqrt((f @ p @ f.T + noise(k * t))[0, 0]))
    return np.array(means), np.array(stds)


@given(seed=st.integers(0, 2**32 - 1), seen=st.floats(0.05, 1))
def test_equals_the_textbook_filter(seed, seen):
    rng = np.random.default_rng(seed)
    model = kalman()
    history = rng.normal(0, 1, (2, model.history_steps, 2, 3)).cumsum(axis=1) * 0.05 + 2.0
    observed = rng.random((2, model.history_steps, 2)) < seen
    forecast = model.predict(history, observed)
    assert forecast.std is not None
    for person in range(2):
        for joint in range(2):
            if not observed[person, :, joint].any():
                continue
            for axis in range(3):
                means, stds = textbook(
                    history[person, :, joint, axis],
                    observed[person, :, joint],
                    model._settings,
                    model.horizon_steps,
                )
                np.testing.assert_allclose(
                    forecast.positions[person, :, joint, axis], means, atol=1e-6
                )
                np.testing.assert_allclose(forecast.std[person, :, joint], stds, rtol=1e-4)


def test_constant_acceleration_is_followed():
    model = kalman(measurement_std_m=1e-4, acceleration_std_m_s2=10.0)
    times = (np.arange(-model.history_steps + 1, model.horizon_steps + 1) / 20.0)[:, None, None]
    truth = np.broadcast_to(1.0 + 0.5 * times + 2.0 * times**2 / 2, (len(times), 2, 3))
    history = truth[None, : model.history_steps]
    forecast = model.predict(history, np.ones(history.shape[:3], bool))
    np.testing.assert_allclose(forecast.positions[0], truth[model.history_steps :], atol=5e-3)


def test_std_grows_with_the_horizon_and_with_time_unobserved():
    model = kalman()
    history = np.zeros((1, model.history_steps, 2, 3))
    observed = np.ones(history.shape[:3], bool)
    observed[0, -4:, 1] = False
    std = model.predict(history, observed).std
    assert std is not None
    assert (np.diff(std, axis=1) > 0).all()
    assert (std[0, :, 1] > std[0, :, 0]).all()


def test_std_holds_what_the_filter_assumes():
    """Bodies that move as the model says: two standard deviations hold 95 % of the errors."""
    model = kalman(measurement_std_m=0.02, jerk_density=100.0)
    rng = np.random.default_rng(3)
    fine, count = 20, 2000  # the truth is integrated in steps twenty times finer
    total = (model.history_steps + model.horizon_steps) * fine
    dt = 1.0 / (20.0 * fine)
    jerk = rng.normal(0, np.sqrt(100.0 / dt), (count, total, 2, 3))
    acceleration = rng.normal(0, 3.0, (count, 1, 2, 3)) + np.cumsum(jerk, axis=1) * dt
    speed = rng.normal(0, 1.0, (count, 1, 2, 3)) + np.cumsum(acceleration, axis=1) * dt
    truth = (np.cumsum(speed, axis=1) * dt)[:, fine - 1 :: fine]
    history = truth[:, : model.history_steps]
    noisy = history + rng.normal(0, 0.02, history.shape)
    forecast = model.predict(noisy, np.ones(history.shape[:3], bool))
    assert forecast.std is not None
    error = np.abs(forecast.positions - truth[:, model.history_steps :])
    for sigmas, share in ((1.0, 0.683), (2.0, 0.954)):
        inside = (error < sigmas * forecast.std[..., None]).mean(axis=(0, 2, 3))
        np.testing.assert_allclose(inside, share, atol=0.03)


def test_joint_never_observed_is_as_unsure_as_its_bone_is_long():
    model = kalman()
    history = np.ones((1, model.history_steps, 2, 3))
    observed = np.ones(history.shape[:3], bool)
    observed[0, :, 1] = False
    forecast = model.predict(history, observed)
    assert forecast.std is not None
    np.testing.assert_array_equal(forecast.positions[0, :, 1], forecast.positions[0, :, 0])
    np.testing.assert_allclose(forecast.std[0, :, 1], np.sqrt(forecast.std[0, :, 0] ** 2 + 0.4**2))


def test_nobody_observed_may_be_anywhere():
    model = kalman(skeleton=CANONICAL)
    history = np.ones((1, model.history_steps, 21, 3))
    forecast = model.predict(history, np.zeros(history.shape[:3], bool))
    assert forecast.std is not None
    np.testing.assert_array_equal(forecast.positions, 0.0)
    np.testing.assert_array_equal(forecast.std, UNKNOWN_STD_M)


def test_far_from_the_origin_it_works_the_same():
    model = kalman()
    history = np.random.default_rng(2).normal(0, 0.1, (1, model.history_steps, 2, 3))
    observed = np.ones(history.shape[:3], bool)
    near = model.predict(history, observed).positions
    far = model.predict(history + 1000.0, observed).positions
    np.testing.assert_allclose(far - 1000.0, near, atol=1e-6)


@pytest.mark.parametrize("key", ["measurement_std_m", "jerk_density", "speed_std_m_s"])
def test_settings_must_be_positive(key):
    with pytest.raises(ValueError, match=key):
        kalman(**{key: 0.0})
