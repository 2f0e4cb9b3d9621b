"""Augmentation changes windows only in the ways it says."""

import numpy as np
import pytest

from hri_predict.lab.training.windows.augment import AugmentSettings, disturb, move
from hri_predict.predictors.neural.body import BODY, SHARED_BODY

NONE = AugmentSettings(
    mirror=0, yaw=False, scale=0, warp=0, truncate=0, noise=0, outliers=0, missing=0, limb=0,
    frames=0, sparse=0, arms=0,
)  # fmt: skip
COUNT, STEPS, JOINTS = 200, 40, len(BODY.joints)


def only(**changes: float) -> AugmentSettings:
    return NONE.model_copy(update=changes)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture
def windows(rng) -> tuple[np.ndarray, np.ndarray]:
    positions = rng.normal(size=(COUNT, STEPS, JOINTS, 3)).astype(np.float32)
    return positions, rng.random((COUNT, STEPS, JOINTS)) < 0.9


def lengths(positions: np.ndarray) -> np.ndarray:
    bones = positions[:, :, 1:] - positions[:, :, list(BODY.parents[1:])]
    result: np.ndarray = np.linalg.norm(bones, axis=-1)
    return result


def test_nothing_is_changed_when_everything_is_off(rng, windows):
    positions, observed = windows
    moved, seen = move(NONE, rng, positions.copy(), observed.copy())
    np.testing.assert_array_equal(moved, positions)
    history, mask = positions.copy(), observed.copy()
    disturb(NONE, rng, history, mask)
    np.testing.assert_array_equal(history, positions)
    np.testing.assert_array_equal(mask, observed)
    np.testing.assert_array_equal(seen, observed)


def test_yaw_keeps_bones_and_heights(rng, windows):
    positions, observed = windows
    moved, _ = move(only(yaw=True), rng, positions.copy(), observed)
    np.testing.assert_allclose(lengths(moved), lengths(positions), atol=1e-4)
    np.testing.assert_allclose(moved[..., 2], positions[..., 2], atol=1e-6)
    assert not np.allclose(moved, positions)


def test_scale_scales_all_bones_of_a_window_alike(rng, windows):
    positions, observed = windows
    moved, _ = move(only(scale=0.1), rng, positions.copy(), observed)
    ratio = lengths(moved) / lengths(positions)
    np.testing.assert_allclose(ratio, ratio[:, :1, :1] * np.ones_like(ratio), atol=1e-3)
    assert 0.89 < ratio.min() < 0.95
    assert 1.05 < ratio.max() < 1.11


def test_mirroring_twice_gives_back_the_window(rng, windows):
    positions, observed = windows
    once, seen = move(only(mirror=1.0), rng, positions.copy(), observed.copy())
    assert not np.array_equal(once, positions)
    left, right = BODY.index("l_knee"), BODY.index("r_knee")
    np.testing.assert_allclose(once[:, :, left, [0, 2]], positions[:, :, right, [0, 2]])
    np.testing.assert_array_equal(seen[:, :, left], observed[:, :, right])
    twice, seen = move(only(mirror=1.0), rng, once.copy(), seen.copy())
    np.testing.assert_allclose(twice, positions, atol=1e-6)
    np.testing.assert_array_equal(seen, observed)


@pytest.mark.parametrize("kind", ["truncate", "missing", "limb", "frames", "sparse", "arms"])
def test_dropping_hides_and_never_shows(rng, windows, kind):
    positions, observed = windows
    history, mask = positions.copy(), observed.copy()
    disturb(only(**{kind: 1.0}), rng, history, mask)
    np.testing.assert_array_equal(history, positions)
    assert not (mask & ~observed).any()
    assert (observed & ~mask).any()
    if kind == "sparse":
        hidden = np.setdiff1d(np.arange(JOINTS), SHARED_BODY)
        assert not mask[:, :, hidden].any()
        np.testing.assert_array_equal(mask[:, :, SHARED_BODY], observed[:, :, SHARED_BODY])


def test_noise_has_the_stated_size(rng, windows):
    positions, observed = windows
    history = positions.copy()
    disturb(only(noise=1.0, noise_m=0.02), rng, history, observed.copy())
    spread = (history - positions).std(axis=(1, 2, 3))
    assert 0 < spread.max() < 0.021


def test_the_same_generator_gives_the_same(windows):
    positions, observed = windows
    results = []
    for _ in range(2):
        rng = np.random.default_rng(9)
        settings = AugmentSettings()
        moved, seen = move(settings, rng, positions.copy(), observed.copy())
        disturb(settings, rng, moved, seen)
        results.append((moved, seen))
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_array_equal(results[0][1], results[1][1])
