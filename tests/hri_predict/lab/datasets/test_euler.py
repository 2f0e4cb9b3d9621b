"""The Euler angle error against closed forms and against the published zero-velocity numbers."""

from pathlib import Path

import numpy as np
import pytest

from hri_predict.lab.datasets.euler import euler_angles, euler_error

DATA = Path(__file__).resolve().parents[4].parent / "shared" / "data" / "cmu_mocap"
FRAMES = [1, 3, 7, 9, 13, 24]
# The data pack's own baselines: zero velocity, 50 -> 25 frames, 80 seeds, radians.
ZERO_VELOCITY = {
    "basketball": [0.48, 0.85, 1.47, 1.71, 2.08, 2.55],
    "jumping": [0.46, 0.69, 1.23, 1.44, 1.75, 1.78],
    "running": [0.55, 0.97, 1.39, 1.47, 1.58, 1.55],
    "soccer": [0.69, 0.90, 1.42, 1.58, 1.87, 2.09],
    "walking": [0.30, 0.50, 0.80, 0.93, 1.11, 1.27],
    "washwindow": [0.33, 0.54, 0.90, 1.04, 1.28, 1.55],
}


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_turn_about_one_axis_is_that_angle(axis):
    e = np.zeros(3)
    e[axis] = 0.7
    np.testing.assert_allclose(euler_angles(e), e, atol=1e-12)


def test_angles_compose_to_the_rotation():
    rng = np.random.default_rng(0)
    e = rng.normal(size=(50, 3))
    angle = np.linalg.norm(e, axis=-1)[:, None, None]
    x, y, z = e.T
    zero = np.zeros(50)
    k = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(50, 3, 3) / angle
    rodrigues = np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * k @ k

    def turn(axis, angles):
        matrix = np.tile(np.eye(3), (50, 1, 1))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        matrix[:, i, i] = matrix[:, j, j] = np.cos(angles)
        matrix[:, j, i] = np.sin(angles)
        matrix[:, i, j] = -np.sin(angles)
        return matrix

    a, b, c = euler_angles(e).T
    np.testing.assert_allclose(turn(2, c) @ turn(1, b) @ turn(0, a), rodrigues, atol=1e-12)


def test_wrapped_maps_are_the_same_rotation():
    e = np.random.default_rng(1).normal(size=(2, 3, 38, 3))
    length = np.linalg.norm(e, axis=-1, keepdims=True)
    assert euler_error(e * (1 - 2 * np.pi / length), e).max() < 1e-9


def test_error_is_over_all_columns_of_a_frame():
    true = np.zeros((1, 2, 38, 3))
    predicted = true.copy()
    predicted[0, 1, 0, 0] = 0.3  # the root's rotation counts
    predicted[0, 1, 37, 2] = 0.4
    np.testing.assert_allclose(euler_error(predicted, true), [[0.0, 0.5]], atol=1e-12)


@pytest.mark.parametrize("action", ZERO_VELOCITY)
def test_zero_velocity_is_the_data_packs(action):
    path = DATA / "test" / f"{action}_1.npz"
    if not path.exists():
        pytest.skip("needs the CMU data pack beside the repository (../shared/data)")
    with np.load(path) as file:
        maps = file["expmap"][::2, 3:].reshape(-1, 38, 3)
    starts = np.random.RandomState(1234567890).randint(0, len(maps) - 75, size=80)
    windows = np.stack([maps[i : i + 75] for i in starts])
    error = euler_error(np.repeat(windows[:, 49:50], 25, axis=1), windows[:, 50:])
    np.testing.assert_allclose(error.mean(0)[FRAMES], ZERO_VELOCITY[action], atol=0.0051)
