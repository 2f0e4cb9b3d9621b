"""Disturbed recordings: by as much as asked for, and nothing else changed."""

import numpy as np
import pytest

from hri_predict.lab.datasets.disturbances import Disturbance, standard

FRAMES, JOINTS = 400, 21
STAMPS = np.arange(FRAMES) * 40_000_000 + 7_000_000_000
TRUNK = (0, 1)


@pytest.fixture
def body():
    return np.random.default_rng(4).normal(1.0, 0.4, (FRAMES, JOINTS, 3))


def apply(disturbance, body, observed=None):
    seen = np.ones(body.shape[:2], bool) if observed is None else observed
    return disturbance.apply(body, seen, STAMPS, TRUNK)


@pytest.mark.parametrize("disturbance", standard(5.0, seed=3), ids=lambda d: d.name)
def test_same_bytes_again_the_input_left_alone_and_the_unobserved_too(disturbance, body):
    kept, seen = body.copy(), np.ones((FRAMES, JOINTS), bool)
    seen[:, 4] = False
    body[:, 4] = kept[:, 4] = np.nan
    first, again = (apply(disturbance, body, seen) for _ in range(2))
    assert np.array_equal(body, kept, equal_nan=True)
    assert np.array_equal(first, again, equal_nan=True)
    assert np.isnan(first[:, 4]).all()
    assert np.isfinite(np.delete(first, 4, axis=1)).all()
    changed = not np.array_equal(first, body, equal_nan=True)
    assert changed == (disturbance.kind != "plain")


@pytest.mark.parametrize("sigma", [0.02, 0.05])
def test_noise_has_its_size_and_every_capture_its_own(body, sigma):
    noise = apply(Disturbance("noise", sigma), body) - body
    assert noise.std() == pytest.approx(sigma, rel=0.02)  # 25,200 samples: 0.4 % is one sigma
    assert abs(np.corrcoef(noise[1:].ravel(), noise[:-1].ravel())[0, 1]) < 0.03
    other = apply(Disturbance("noise", sigma, seed=1), body) - body
    assert not np.array_equal(noise, other)


@pytest.mark.parametrize("scale", [0.7, 1.4])
def test_a_scaled_body_stands_where_it_stood(body, scale):
    scaled = apply(Disturbance("scale", scale), body)
    between = body[:, 5] - body[:, 9]
    np.testing.assert_allclose(scaled[:, 5] - scaled[:, 9], scale * between)
    trunk, before = scaled[:, TRUNK].mean(1), body[:, TRUNK].mean(1)
    np.testing.assert_allclose(trunk[:, :2], before[:, :2])
    np.testing.assert_allclose(trunk[:, 2], scale * before[:, 2])


def test_a_body_without_trunk_is_scaled_about_what_is_seen(body):
    seen = np.zeros((FRAMES, JOINTS), bool)
    seen[:, 5:8] = True
    scaled = apply(Disturbance("scale", 1.4), body, seen)
    np.testing.assert_allclose(scaled[:, 5:8, :2].mean(1), body[:, 5:8, :2].mean(1))


def test_a_shift_comes_at_its_time_and_is_the_same_for_all(body):
    moved = apply(Disturbance("shift", 0.2, at_s=4.0), body) - body
    at = 100  # 4 s x 25 Hz
    assert (moved[:at] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(moved[at:], axis=-1), 0.2)
    np.testing.assert_allclose(moved[at:], np.broadcast_to(moved[-1, -1], moved[at:].shape))
    np.testing.assert_allclose(moved[..., 2], 0.0)
