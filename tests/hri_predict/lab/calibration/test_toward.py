"""Shares by direction are those of the errors, where enough recordings show a class."""

import numpy as np
import pytest

from hri_predict.lab.calibration.quantiles import caution
from hri_predict.lab.calibration.toward import Missed, toward_shares
from hri_predict.zones.learned_scale import KNOT_STEPS
from hri_predict.zones.settings import LEVELS
from hri_predict.zones.toward import BINS, direction_class

WINDOWS, STEPS, JOINTS = 150, 5, 6
AHEAD, BEHIND = BINS - 2, 1


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def recording(seed, error_of, *, moves=True, fast=1, radius_m=0.5, windows=WINDOWS):
    """A recording whose errors ``error_of`` (rng, ways) makes, of walkers who go anywhere."""
    rng = np.random.default_rng(seed)
    shape = (windows, STEPS, JOINTS)
    way = unit(rng.normal(size=(*shape, 3)) * [1, 1, 0.05])
    return Missed(
        error_m=error_of(rng, way),
        moved_m=way * (0.5 if moves else 0.01),
        radius_m=np.full((len(LEVELS), *shape), radius_m),
        fast=np.full(windows, fast),
    )


def to_all_sides(rng, way):
    """Balls: the errors' size is 0.2 m, in any direction."""
    return 0.2 * unit(rng.normal(size=way.shape))


def ahead(rng, way):
    """Who walks on for longer than was forecast."""
    return way * rng.uniform(0, 0.3, (*way.shape[:-1], 1))


def shares(error_of, count=8, **own):
    found = toward_shares([recording(seed, error_of, **own) for seed in range(count)])
    assert found.shape == (len(LEVELS), 3, STEPS, BINS)
    assert ((found >= 0.2) & (found <= 1)).all()
    return found


def test_errors_to_all_sides_count_by_the_cosine():
    """Of a unit vector that points anywhere, the part along n is uniform in -1 ... 1."""
    found = shares(to_all_sides)
    for level, share in enumerate(LEVELS):
        stated = share + (1 - share) * caution(8)  # of eight recordings, as for the radius
        expected = 2 * stated - 1
        # 7000 values of each recording: the quantile is off by 0.01
        np.testing.assert_allclose(found[level, 1, :, 1:], expected, atol=0.03)


def test_errors_ahead_count_ahead_and_hardly_elsewhere():
    found = shares(ahead)[:, 1]
    np.testing.assert_allclose(found[..., AHEAD], 1.0, atol=0.02)  # the whole of them
    assert (np.diff(found[..., 1 : BINS - 1], axis=-1) >= -0.02).all()  # from behind to ahead
    assert (found[..., BEHIND] == 0.2).all()  # none at all: the least share


def test_the_errors_behind_count_behind():
    found = shares(lambda rng, way: -ahead(rng, way))[:, 1]
    assert (found[..., BEHIND] > 0.85).all()  # of directions within 41 degrees of it
    assert (found[..., AHEAD] == 0.2).all()


def test_the_share_does_not_depend_on_the_radius():
    small, large = (shares(to_all_sides, radius_m=r) for r in (0.1, 3.0))
    np.testing.assert_allclose(small, large, atol=1e-12)


def test_still_joints_have_one_share():
    found = shares(to_all_sides, moves=False)[:, 1]
    for level, share in enumerate(LEVELS):
        stated = share + (1 - share) * caution(8)
        np.testing.assert_allclose(found[level, :, 0], 2 * stated - 1, atol=0.03)
    assert (found[..., 1 : BINS - 1] == 1).all()  # nobody moved


@pytest.mark.parametrize("own", [{"count": 3}, {"windows": 2}])
def test_what_few_recordings_show_counts_whole(own):
    assert (shares(to_all_sides, **own) == 1).all()


def test_speeds_that_nobody_shows_count_whole():
    found = shares(to_all_sides, fast=2)
    assert (found[:, :2] == 1).all()
    assert (found[:, 2, :, 1:] < 1).all()


def test_a_step_between_two_counts_as_the_larger():
    """Errors turn from ahead to behind: what holds at either end of a stretch holds within it."""

    def turning(rng, way):
        error = ahead(rng, way)
        error[:, 4] *= -1
        return error

    knots = [k - 1 for k in KNOT_STEPS if k <= STEPS]
    assert knots == [0, 1, 2, 4]
    found = shares(turning)[:, 1]
    np.testing.assert_allclose(found[:, 2:4, BEHIND], found[:, 4:5, BEHIND].repeat(2, 1))
    assert (found[:, 3, AHEAD] > 0.9).all()
    assert (found[:, 4, BEHIND] > 0.9).all()


def test_unknown_places_say_nothing():
    def with_gaps(rng, way):
        error = to_all_sides(rng, way)
        error[rng.random(error.shape[:-1]) < 0.5] = np.nan
        return error

    found = shares(with_gaps)
    np.testing.assert_allclose(found[-1, 1, :, 1:], 2 * LEVELS[-1] - 1, atol=0.03)


def test_the_same_recordings_give_the_same_shares():
    np.testing.assert_array_equal(shares(to_all_sides, count=5), shares(to_all_sides, count=5))


@pytest.mark.parametrize("error_of", [to_all_sides, ahead])
def test_the_stated_share_of_fresh_errors_is_held_in_every_class(error_of):
    """Of recordings that were not fitted, in any direction: as many as the ball holds."""
    found, stated = shares(error_of)[:, 1], np.array(LEVELS)
    other = recording(99, error_of, windows=600)
    size = np.linalg.norm(other.error_m, axis=-1)
    way = unit(other.moved_m)
    n = unit(np.random.default_rng(5).normal(size=way.shape) * [1, 1, 0.4])
    which = direction_class(n, way)
    along = np.einsum("...i,...i->...", other.error_m, n)
    for level in range(len(LEVELS)):
        ball = np.quantile(size, stated[level])
        for c in range(1, BINS):
            held = along[which == c] <= found[level, 0, c] * ball
            # 500 errors in the rarest class: four standard deviations
            assert held.mean() >= stated[level] - 0.02 - 1.5 * (1 - stated[level]) ** 0.5 / 20
