import contextlib
import io
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as drawn

from hri_predict.viewing.picture import Picture, empty_shapes, pack, read, unpack

FLOATS = st.floats(-100, 100, width=32)


def rows(dimensions: int):
    sizes = st.tuples(*[st.integers(0, 3)] * (dimensions - 1))
    return sizes.flatmap(lambda size: drawn.arrays(np.float32, (*size, 7), elements=FLOATS))


@given(bodies=rows(3), forecast=rows(4), zones=rows(4), robots=rows(2), text=st.text())
def test_a_picture_comes_through_a_pipe_as_it_was(bodies, forecast, zones, robots, text):
    sent = Picture({"text": text}, bodies, forecast, zones, robots)
    stream = io.BytesIO(2 * pack(sent))
    for _ in range(2):
        got = read(stream)
        assert got is not None
        assert got.facts == sent.facts
        for name in ("bodies", "forecast", "zones", "robots"):
            np.testing.assert_array_equal(getattr(got, name), getattr(sent, name))
    assert read(stream) is None


@given(st.binary(max_size=200))
def test_other_bytes_are_refused(data):
    with pytest.raises(ValueError, match="no picture"):
        unpack(data)


@given(st.integers(0, 400), st.integers(0, 255))
def test_a_damaged_picture_is_a_picture_or_refused(place, value):
    data = bytearray(pack(Picture({"a": 1}, **empty_shapes()))[4:])
    data[place % len(data)] = value
    with contextlib.suppress(ValueError):
        assert isinstance(unpack(bytes(data)), Picture)


def test_a_pipe_that_ends_in_a_picture_ends():
    data = pack(Picture({}, **empty_shapes()))
    assert read(io.BytesIO(data[:-1])) is None
    assert read(io.BytesIO(data[:2])) is None


def test_a_length_that_would_fill_the_memory_is_refused():
    with pytest.raises(ValueError, match="no picture"):
        read(io.BytesIO(b"\xff\xff\xff\xff"))


def test_what_is_not_finite_is_sent_as_not_known():
    facts = {"age_s": math.inf, "robots": [{"x": math.nan}]}
    got = unpack(pack(Picture(facts, **empty_shapes()))[4:])
    assert got.facts == {"age_s": None, "robots": [{"x": None}]}
