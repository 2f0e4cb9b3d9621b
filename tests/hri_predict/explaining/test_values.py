"""Values of a recording that is damaged, or made to deceive: numbers that can be computed with."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.explaining.values import number, text, whole

ANY = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.lists(st.integers())


@pytest.mark.parametrize("value", [2**63, -(2**63) - 1, 10**400, True, 1.0, "1", None, [1]])
def test_what_is_no_whole_number_of_64_bits_is_none(value):
    assert whole(value) is None


@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, True, "1", None, [1]])
def test_what_is_no_finite_number_is_none(value):
    assert number(value) is None


@given(ANY)
def test_any_value_is_a_number_to_compute_with_or_none(value):
    found = whole(value)
    assert found is None or math.isfinite(found / 1.0)
    real = number(value)
    assert real is None or math.isfinite(real)
    assert text(value).isprintable()
