"""Numbers in registers, in each type and order."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.modbus_client.link import number, words_of

TYPES = ("int16", "uint16", "int32", "uint32", "float32", "float64")


@pytest.mark.parametrize(
    ("words", "kind", "byte_order", "word_order", "expected"),
    [
        # 1.5 is 0x3FC00000 (IEEE 754)
        ([0x3FC0, 0x0000], "float32", "big", "big", 1.5),
        ([0x0000, 0x3FC0], "float32", "big", "little", 1.5),
        ([0xC03F, 0x0000], "float32", "little", "big", 1.5),
        ([0x0000, 0xC03F], "float32", "little", "little", 1.5),
        ([0x3FF8, 0, 0, 0], "float64", "big", "big", 1.5),
        ([0, 0, 0, 0x3FF8], "float64", "big", "little", 1.5),
        ([0xFFFE], "int16", "big", "big", -2),
        ([0xFEFF], "uint16", "little", "big", 0xFFFE),
        ([0xFFFF, 0xFFFE], "int32", "big", "big", -2),
        ([0x0002, 0x0001], "uint32", "big", "little", 0x0001_0002),
    ],
)
def test_a_number_of_each_type_and_order(words, kind, byte_order, word_order, expected):
    assert number(words, kind, byte_order, word_order) == expected


@given(st.sampled_from(TYPES), st.data())
def test_any_words_are_a_number(kind, data):
    words = data.draw(st.lists(st.integers(0, 65_535), min_size=words_of(kind), max_size=4))
    orders = data.draw(st.tuples(*[st.sampled_from(("big", "little"))] * 2))
    found = number(words[: words_of(kind)], kind, *orders)
    assert math.isnan(found) or isinstance(found, int | float)
