import warnings

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays

from hri_predict.base.arrays import Floats, known_median

_NUMBERS = st.one_of(st.just(np.nan), st.floats(-1e6, 1e6))


@given(arrays(np.float64, array_shapes(min_dims=2, max_dims=2, max_side=22), elements=_NUMBERS))
def test_the_median_is_that_of_numpy(rows: Floats) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a row of nothing but NaN
        expected = np.nanmedian(rows, axis=1)
    np.testing.assert_array_equal(known_median(rows), expected)


def test_without_rows_or_columns_there_is_none() -> None:
    assert known_median(np.zeros((0, 21))).shape == (0,)
    assert np.isnan(known_median(np.zeros((2, 0)))).all()
