"""Recordings as other trackers would deliver them."""

import numpy as np
import pytest

from hri_predict.lab.calibration.presence import LATE_S, LOST, Presence, as_tracked

RATE_HZ, CAPTURES = 120.0, 1200


@pytest.fixture
def standing():
    stamps = np.round(np.arange(CAPTURES) * 1e9 / RATE_HZ).astype(np.int64)
    positions = np.broadcast_to(np.arange(63.0).reshape(21, 3) / 30, (CAPTURES, 21, 3)).copy()
    return Presence(stamps, positions, np.ones((CAPTURES, 21), bool), RATE_HZ)


@pytest.mark.parametrize("seed", range(5))
def test_captures_are_fewer_and_some_are_not_delivered(standing, seed):
    truth, delivered = as_tracked(standing, seed)
    assert 30 <= truth.rate_hz <= 45
    assert 10.0 * truth.rate_hz == pytest.approx(len(truth.stamps_ns), rel=0.02)
    assert (np.diff(delivered) > 0).all()
    assert len(truth.stamps_ns) / 4 * (1 - 5 * LOST) < len(delivered) < len(truth.stamps_ns)
    assert 0 < (~truth.observed).mean() < 2 * LOST
    assert (truth.positions[~truth.observed] == 0).all()


@pytest.mark.parametrize("seed", range(5))
def test_noise_has_no_mean_and_a_few_centimetres(standing, seed):
    truth, _ = as_tracked(standing, seed)
    off = (truth.positions - standing.positions[0])[truth.observed]
    assert np.sqrt((off**2).mean()) < 0.02 * np.sqrt(2) * 1.2
    assert np.abs(off.mean()) < 0.002


def test_half_of_the_trackers_stamp_late_and_none_early(standing):
    kept = [as_tracked(standing, seed)[0].stamps_ns for seed in range(60)]
    ideal = standing.stamps_ns[:: round(RATE_HZ / 35)]
    late = np.array([(stamps - ideal).max() for stamps in kept]) * 1e-9
    assert all((np.diff(stamps) > 0).all() for stamps in kept)
    assert all((stamps >= ideal).all() for stamps in kept)
    assert 15 <= (late == 0).sum() <= 45  # of 60 draws with even odds, nearly surely
    assert LATE_S / 2 < late.max() <= LATE_S + 1e-6


def test_the_same_seed_draws_the_same(standing):
    one, other = (as_tracked(standing, 7) for _ in range(2))
    np.testing.assert_array_equal(one[0].positions, other[0].positions)
    np.testing.assert_array_equal(one[0].stamps_ns, other[0].stamps_ns)
    np.testing.assert_array_equal(one[1], other[1])
