"""Any row of fields: a value comes back within a step, on its safe side, or as what it became."""

import math
from enum import IntEnum

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.codec import Malformed, packer, unpacker
from hri_predict.protocol.fields import Field


class Colour(IntEnum):
    """Values of a field."""

    NONE = 0
    RED = 1
    GREEN = 3


def scaled(bits, scale, *, signed, rounding, bounded):
    return Field(
        signal="X", bits=bits, text="", scale=scale, signed=signed, rounding=rounding,
        optional=True, bounded=bounded,
    )  # fmt: skip


NUMBERS = st.builds(
    scaled,
    bits=st.integers(4, 20),
    scale=st.sampled_from([1, 7, 1000, 10_000]),
    signed=st.booleans(),
    rounding=st.sampled_from(["nearest", "down", "up"]),
    bounded=st.booleans(),
)
ROWS = st.lists(st.tuples(NUMBERS, st.none() | st.floats(width=64)), min_size=1, max_size=9)


def expected(field, value):
    """The range of values that may come back; ``None``: not available."""
    low, high = (raw / field.scale for raw in field.raw_range)
    if value is None or math.isnan(value):
        return None
    step = field.resolution
    if value >= high + step or value <= low - step:  # clearly beyond
        return None if field.bounded else (high, high) if value > 0 else (low, low)
    tiny = 2e-6 * step + 1e-15 * abs(value)  # the rounding's allowance, and the product's own
    below = tiny if field.rounding == "up" else step + tiny
    above = tiny if field.rounding == "down" else step + tiny
    return max(low, min(value - below, high)), min(high, max(value + above, low))


@given(ROWS)
def test_numbers_come_back_within_a_step_on_their_safe_side(row):
    fields = [field for field, _ in row]
    spare = -sum(field.bits for field in fields) % 8
    if spare:
        fields = [*fields, Field(signal="SPARE", bits=spare, text="")]
    values = [value for _, value in row] + [0] * bool(spare)
    data = packer(fields, [f"c[{k}]" for k in range(len(fields))])(None, values)
    found = unpacker(fields)(data)
    assert len(data) == sum(field.bits for field in fields) // 8
    for (field, value), back in zip(row, found, strict=False):
        wanted = expected(field, value)
        if wanted is None:
            assert back is None
        elif back is None:  # at the very end of a bounded range, where it may round to beyond
            assert field.bounded
            assert not field.raw_range[0] < value * field.scale < field.raw_range[1]
        else:
            assert wanted[0] <= back <= wanted[1]
            assert field.raw_range[0] <= round(back * field.scale) <= field.raw_range[1]


def one(field, value):
    """Pack and unpack a byte of one field."""
    return unpacker([field])(packer([field], ["m"])(value, ()))[0]


def test_other_kinds_of_fields():
    count = Field(signal="COUNT", bits=8, text="", wraps=True)
    assert one(count, 257) == 1
    flag = Field(signal="FLAG", bits=8, text="", flag=True)
    assert [one(flag, value) for value in (True, False, 1, None)] == [True, False, False, False]
    names = Field(signal="NAME", bits=8, text="", enum=Colour, fallback=Colour.NONE)
    assert one(names, Colour.GREEN) is Colour.GREEN
    assert unpacker([names])(b"\x02") == (Colour.NONE,)
    index = Field(signal="INDEX", bits=8, text="", optional=True, bounded=True)
    assert [one(index, value) for value in (0, 254, 255, 256, -1, None)] == [0, 254, *[None] * 4]
    plain = Field(signal="PLAIN", bits=8, text="")
    assert [one(plain, value) for value in (-1, 7, 300)] == [0, 7, 255]


def test_what_must_be_there_is_demanded_on_both_sides():
    plain = Field(signal="PLAIN", bits=8, text="")
    with pytest.raises(ValueError, match="PLAIN must be a number"):
        packer([plain], ["m"])(None, ())
    length = Field(signal="LENGTH", bits=8, text="", scale=10)
    with pytest.raises(Malformed, match="LENGTH is not available"):
        unpacker([length])(b"\xff")


@given(st.binary(max_size=4))
def test_missing_bytes_at_the_end_read_as_zeros(data):
    fields = [Field(signal=name, bits=bits, text="") for name, bits in (("A", 4), ("B", 12))]
    fields += [Field(signal="C", bits=16, text="")]
    assert unpacker(fields)(data) == unpacker(fields)(data + bytes(4 - len(data)))
