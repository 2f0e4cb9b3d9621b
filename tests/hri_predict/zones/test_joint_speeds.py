"""Speeds of joints from captures, at any rate and with noise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import CANONICAL
from hri_predict.people.snapshot import RecentCaptures
from hri_predict.zones.joint_speeds import MOST_NOISE_M_S, JointSpeeds, joint_speeds

JOINTS = len(CANONICAL.joints)
RATES = pytest.mark.parametrize("rate_hz", [5.0, 8.0, 12.5, 25.0, 30.0, 60.0, 120.0, 240.0])


def captured(
    path: Floats, rate_hz: float, *, noise_m: float = 0.0, seed: int = 0, shift: float = 0.0
) -> JointSpeeds:
    """Joints whose displacement along x is ``path`` (C, J); the newest capture is the last."""
    ages = np.arange(len(path) - 1, -1, -1) / rate_hz
    positions = np.random.default_rng(seed).normal(0, noise_m, (1, *path.shape, 3)) + shift
    positions[0, ..., 0] += path
    return joint_speeds(RecentCaptures(ages[None], positions, np.ones((1, *path.shape), bool)))


def steady(speed: float, rate_hz: float, count: int | None = None) -> Floats:
    count = count or max(5, int(0.25 * rate_hz) + 1)
    return np.repeat(speed * np.arange(count)[:, None] / rate_hz, JOINTS, axis=1)


@RATES
def test_a_speed_is_measured_at_any_rate(rate_hz):
    found = captured(steady(1.3, rate_hz), rate_hz, shift=300.0)  # rounding: 300 m from the origin
    assert found.measured.all()
    np.testing.assert_allclose(found.speed, 1.3, atol=1e-9)
    np.testing.assert_allclose(found.surely, 1.3, atol=1e-9)


@RATES
def test_three_captures_over_a_tenth_of_a_second_are_needed(rate_hz):
    for count in range(1, 40):
        found = captured(steady(1.3, rate_hz, count), rate_hz)
        enough = count >= 3 and (count - 1) / rate_hz >= 0.09
        assert found.measured.all() == found.measured.any() == enough
        assert found.speed.any() == enough


@pytest.mark.parametrize("rate_hz", [8.0, 15.0, 30.0, 60.0, 120.0])
def test_who_stands_is_not_fast_by_noise_of_two_centimetres(rate_hz):
    for seed in range(200):
        found = captured(steady(0.0, rate_hz), rate_hz, noise_m=0.02, seed=seed)
        assert found.surely.max() < 0.5


@pytest.mark.parametrize("rate_hz", [15.0, 30.0, 60.0, 120.0])
def test_who_walks_is_not_fast_by_noise_of_two_centimetres(rate_hz):
    fast = [
        captured(steady(1.4, rate_hz), rate_hz, noise_m=0.02, seed=s).surely.max() > 1.6
        for s in range(300)
    ]
    assert np.mean(fast) < 0.02


def test_noise_explains_only_so_much():
    # 20 cm of noise: a runner must not pass as a walker
    fast = [
        captured(steady(3.5, 30.0), 30.0, noise_m=0.2, seed=s).surely.max() > 1.6
        for s in range(100)
    ]
    assert all(fast)
    found = captured(steady(3.0, 30.0), 30.0, noise_m=0.2)
    assert (found.speed - found.surely).max() <= MOST_NOISE_M_S + 1e-9


@pytest.mark.parametrize("noise_m", [0.0, 0.004, 0.02])
def test_a_joint_that_sets_out_is_found_within_a_fifth_of_a_second(noise_m):
    rate_hz, joint = 30.0, 4
    for seed in range(50):
        for late in range(1, 8):  # captures since it set out at 6 m/s
            path = steady(0.0, rate_hz, 12)
            path[-late:, joint] = 6.0 * np.arange(1, late + 1) / rate_hz
            found = captured(path, rate_hz, noise_m=noise_m, seed=seed)
            if found.surely[0, joint] > 2.0:
                break
        assert late / rate_hz <= 0.134


def test_a_kick_of_one_joint_is_no_noise():
    # the parabola cannot follow it, but the median over the body does
    path = steady(0.0, 30.0, 12)
    path[-3:, 4] = [0.05, 0.3, 0.6]
    found = captured(path, 30.0)
    assert found.surely[0, 4] > 2.0
    assert found.surely[0, 4] == pytest.approx(found.speed[0, 4])


def test_a_joint_not_seen_of_late_has_no_present_speed():
    rate_hz = 30.0
    path = steady(2.0, rate_hz, 12)
    for hidden, known in ((0, True), (2, True), (3, True), (5, False), (9, False)):
        observed = np.ones((1, 12, JOINTS), bool)
        observed[0, 12 - hidden :, 3] = False
        positions = np.zeros((1, 12, JOINTS, 3))
        positions[0, ..., 0] = path
        positions[~observed] = np.nan
        ages = np.arange(11, -1, -1)[None] / rate_hz
        found = joint_speeds(RecentCaptures(ages, positions, observed))
        assert found.measured[0, 3] == known
        assert found.speed[0, 3] == pytest.approx(2.0 if known else 0.0)
        assert found.measured[0, 4]


@given(
    st.lists(st.floats(0.005, 0.1), min_size=3, max_size=20),
    st.floats(0, 8),
    st.integers(0, 100),
)
def test_uneven_captures_measure_the_same(gaps, speed, seed):
    stamps = np.cumsum(gaps)
    direction = np.random.default_rng(seed).normal(size=3)
    direction /= np.linalg.norm(direction)
    positions = (speed * stamps)[:, None, None] * direction + np.zeros((JOINTS, 3))
    ages = (stamps[-1] - stamps)[None]
    found = joint_speeds(
        RecentCaptures(ages, positions[None], np.ones((1, len(gaps), JOINTS), bool))
    )
    np.testing.assert_allclose(found.speed[found.measured], speed, atol=1e-6)


def test_filled_up_captures_do_not_count():
    ages = np.array([[0.2, 0.1, 0.0], [np.inf, np.inf, 0.0]])
    positions = np.zeros((2, 3, JOINTS, 3))
    observed = np.isfinite(ages)[..., None] & np.ones(JOINTS, bool)
    found = joint_speeds(RecentCaptures(ages, positions, observed))
    assert found.measured.all(1).tolist() == [True, False]


def test_nobody_and_nothing():
    found = joint_speeds(
        RecentCaptures(np.zeros((2, 0)), np.zeros((2, 0, 3, 3)), np.zeros((2, 0, 3), bool))
    )
    assert found.speed.shape == (2, 3)
    assert not found.measured.any()
