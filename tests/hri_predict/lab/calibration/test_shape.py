"""The scale's shape from errors: tails are found at the sizes at which they are."""

import numpy as np

from hri_predict.base.skeleton import JOINTS
from hri_predict.lab.calibration.conformal import SHAPE_LEVEL, shape_of
from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS
from hri_predict.zones.scale_shape import ScaleShape

COUNT = len(JOINTS)


def drawn(recordings, tail_of, windows=60, seed=0):
    """Errors and scales of (W, 1, J), and the recordings; ``tail_of`` gives error over scale."""
    rng = np.random.default_rng(seed)
    size = np.exp(rng.uniform(np.log(0.02), np.log(0.5), (recordings * windows, 1, COUNT)))
    error = size * tail_of(size) * rng.uniform(0, 1, size.shape)
    return error, size, np.repeat(np.arange(recordings), windows)


def test_a_heavy_tail_at_small_sizes_is_found_there_alone():
    def tail(size):
        return np.where(size < 0.1, 5.0, 1.0)

    error, size, unit = drawn(40, tail)
    fast = np.zeros(len(unit), int)
    shape = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    at = np.array([[[0.025, 0.05, 0.25, 0.45]]])
    found = shape.of(at, np.array([0])) / at
    # of uniform errors the quantile of the level, with the caution of 40 recordings (0.2)
    level = 1 - (1 - SHAPE_LEVEL) * (1 - 8 / 40)
    np.testing.assert_allclose(found[0, 0], np.array([5, 5, 1, 1]) * level, rtol=0.02)
    untouched = shape.of(at, np.array([1])) / at  # nobody was slow
    np.testing.assert_allclose(untouched, 1.0)


def test_few_recordings_have_no_shape():
    error, size, unit = drawn(2 * LEAST_RECORDINGS - 1, lambda size: 3.0)
    fast = np.full(len(unit), 2)
    shape = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    np.testing.assert_allclose(shape.factor, 1.0)


def test_unknown_errors_do_not_count_for_the_shape():
    error, size, unit = drawn(20, lambda size: 2.0)
    fast = np.ones(len(unit), int)
    wanted = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    error, size = (np.repeat(v, 2, axis=2) for v in (error, size))
    error[..., 1::2] = np.nan
    found = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    np.testing.assert_allclose(found.factor, wanted.factor)
    np.testing.assert_allclose(found.size_m, wanted.size_m)


def test_errors_of_nothing_leave_a_scale_that_can_be_stored():
    error, size, unit = drawn(20, lambda size: 0.0)
    fast = np.zeros(len(unit), int)
    shape = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    assert (shape.factor > 0).all()
    ScaleShape.of_json(shape.to_json(), 1)


def test_a_scale_of_one_size_has_no_shape():
    error, size, unit = drawn(20, lambda size: 3.0)
    size = np.full_like(size, 0.1) * (1 + 1e-6 * size)
    fast = np.zeros(len(unit), int)
    shape = shape_of(error=error, scale_m=size, fast=fast, unit=unit)
    np.testing.assert_allclose(shape.factor, 1.0)
    ScaleShape.of_json(shape.to_json(), 1)
