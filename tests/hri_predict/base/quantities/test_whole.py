"""Whole numbers in texts: digits alone, and no more than fit 64 bits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.quantities.whole import whole


@given(st.integers(0, 10**18 - 1))
def test_digits_are_their_number(number):
    assert whole(str(number)) == number


@pytest.mark.parametrize(
    "text", ["", "-1", "+1", "1.0", "1_0", " 1", "²", "x", "9" * 19, "9" * 5000]
)
def test_other_texts_are_none(text):
    assert whole(text) is None


@given(st.text())
def test_any_text_is_a_number_of_64_bits_or_none(text):
    found = whole(text)
    assert found is None or 0 <= found < 2**63
