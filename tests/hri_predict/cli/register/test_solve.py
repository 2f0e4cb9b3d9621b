"""The pose is found from any points, axes and noise, or refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.geometry import transform
from hri_predict.base.settings import Pose
from hri_predict.cli.register.solve import quaternion, solve

quaternions = (
    st.lists(st.floats(-1, 1), min_size=4, max_size=4)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: np.array(q) / np.linalg.norm(q))
)
CORNERS = np.array([[0.0, 0, 0.8], [2, 0, 0.7], [2, 1.5, 1.2], [0.3, 1.4, 0.1]])


def pose_of(q, xyz=(1.0, -2.0, 2.4)):
    return Pose(xyz=list(xyz), quaternion_xyzw=[float(v) for v in q]).matrix()


def seen_from(matrix, points):
    return transform(np.linalg.inv(matrix), points)


@given(q=quaternions, count=st.sampled_from([3, 4]))
def test_any_pose_is_found_from_three_points_or_more(q, count):
    truth = pose_of(q)
    found = solve(seen_from(truth, CORNERS[:count]), CORNERS[:count])
    assert found.matrix == pytest.approx(truth, abs=1e-8)
    assert found.residuals_m == pytest.approx(np.zeros(count), abs=1e-8)
    assert found.scale == pytest.approx(1.0)


@given(q=quaternions)
def test_a_quaternion_says_the_same_rotation(q):
    rotation = pose_of(q)[:3, :3]
    found = quaternion(rotation)
    assert pose_of(found)[:3, :3] == pytest.approx(rotation, abs=1e-8)
    assert found[3] >= 0


@given(q=quaternions, seed=st.integers(0, 99))
def test_noise_moves_the_pose_by_no_more_than_itself(q, seed):
    truth = pose_of(q)
    noise = np.random.default_rng(seed).normal(0.0, 0.005, CORNERS.shape)  # of medians
    found = solve(seen_from(truth, CORNERS) + noise, CORNERS)
    beside = np.array([[1.0, 0.7, 0.9]])
    assert transform(found.matrix, seen_from(truth, beside)) == pytest.approx(beside, abs=0.03)
    assert found.residuals_m.max() < 0.03


@given(q=quaternions, scale=st.floats(0.8, 1.25))
def test_a_wrong_scale_is_told_and_not_applied(q, scale):
    truth = pose_of(q)
    found = solve(seen_from(truth, CORNERS) / scale, CORNERS)
    assert found.scale == pytest.approx(scale)
    assert np.linalg.det(found.matrix[:3, :3]) == pytest.approx(1.0)


def test_a_wrong_point_shows_in_the_residuals():
    known = CORNERS.copy()
    known[2] += [0.0, 0.4, 0.0]
    assert solve(CORNERS, known).residuals_m.max() > 0.1


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (CORNERS[:2], "2 points; give at least 3"),
        (CORNERS * 0.1, "at most 0.25 m apart"),
        (np.array([[0.0, 0, 0], [1, 0, 0], [2, 0.05, 0]]), "lie on one line"),
    ],
)
def test_points_that_fix_no_rotation_are_refused(points, why):
    with pytest.raises(ConfigError, match=why):
        solve(points, points)


def test_a_hand_that_touched_no_point_is_told_from_points_that_are_too_near():
    resting = np.zeros((4, 3)) + np.random.default_rng(0).normal(0.0, 0.003, (4, 3))
    with pytest.raises(ConfigError, match="seen in the same place each time: touch each point"):
        solve(resting, CORNERS)
    with pytest.raises(ConfigError, match=r"observed positions of the joint are at most 0\.25 m"):
        solve(CORNERS * 0.1, CORNERS)
