"""Pickles are data: nothing in them runs, and nothing in them can fill the memory or take long."""

import contextlib
import pickle
import pickletools
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.recording.formats.pickled import MAX_STEPS, Array, read_pickle

ENOUGH = 10**6
NUMBERS = {
    "a": [np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6, dtype=">f4").reshape(3, 2))],
    "b": ("text", "\xe9", b"\xff", None, True, -3, 10**30, 2.5, np.float64(3)),
}


class Calls:
    """An object whose pickle calls something."""

    def __init__(self, *what: object) -> None:
        self.what = what

    def __reduce__(self) -> tuple[object, ...]:
        return self.what


@pytest.mark.parametrize("protocol", range(5))
def test_arrays_and_containers_of_every_protocol(protocol):
    found = read_pickle(pickle.dumps(NUMBERS, protocol=protocol))
    for array, true in zip(found["a"], NUMBERS["a"], strict=True):
        np.testing.assert_array_equal(array.numbers(ENOUGH), true)
    assert found["b"][:8] == NUMBERS["b"][:8]


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize(
    "made",
    [
        Calls(eval, ("open('ran', 'w')",)),
        Calls(open, ("ran", "w")),
        Calls(exec, ("open('ran', 'w')",)),
        Calls(np.load, ("ran",)),
        Calls(list, (), {"x": 1}),
    ],
)
def test_nothing_runs(tmp_path, monkeypatch, protocol, made):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match=r"not data alone|not a"):
        read_pickle(pickle.dumps({"jointPositions": made}, protocol=protocol))
    assert not list(tmp_path.iterdir())


HUGE = 2**31 - 1
FEW_BYTES = [
    b"\x80\x04r" + struct.pack("<I", HUGE) + b".",  # LONG_BINPUT: a memo of gigabytes
    b"\x80\x04N r" + struct.pack("<I", HUGE) + b".",
    b"\x80\x04Nr" + struct.pack("<I", HUGE) + b".",
    b"\x80\x05\x96" + struct.pack("<Q", 2**40) + b".",  # BYTEARRAY8
    b"\x80\x04\x8e" + struct.pack("<Q", 2**40) + b".",  # BINBYTES8
    b"\x80\x04\x95" + struct.pack("<Q", 2**62) + b".",  # FRAME
    b"\x80\x04]" + b"2" * (MAX_STEPS + 1) + b".",  # DUP
    b"I" + b"9" * 100_000 + b"\n.",
    b"(lp0\n" + b"(" * 100_000 + b".",
    b"}((I1\ntI2\ns.",  # a dictionary with a tuple for a key
    b"cos\nsystem\n(S'true'\ntR.",
    b"\x80\x02}\x81.",
    b"",
]


@pytest.mark.parametrize("data", FEW_BYTES)
def test_few_bytes_claim_nothing(data):
    with pytest.raises(ValueError, match=r"\w"):
        read_pickle(data)


def test_one_text_is_not_unpacked_again_and_again():
    again = b"c_codecs\nencode\n" + b"h\x00" + b"X\x06\0\0\0latin1" + b"\x86R0"
    data = b"\x80\x02X" + struct.pack("<I", 2**20) + b"a" * 2**20 + b"q\x00" + again * 300 + b"."
    with pytest.raises(ValueError, match="too much"):
        read_pickle(data)


@pytest.mark.parametrize(
    "array",
    [
        Array((2, 3), None, False, b"0" * 48),
        Array([2, 3], None, False, b"0" * 48),
    ],
)
def test_an_array_without_a_type_has_no_numbers(array):
    with pytest.raises(ValueError, match="without a type"):
        array.numbers(ENOUGH)


@pytest.mark.parametrize("values", [np.array([{}], object), np.array(["a"]), np.array([1j])])
def test_arrays_of_other_things_have_no_numbers(values):
    with pytest.raises(ValueError, match="not of numbers"):
        read_pickle(pickle.dumps([values]))[0].numbers(ENOUGH)


@pytest.mark.parametrize("code", ["b2", "b8", "f1", "i3", "u16", "V8", "M8"])
def test_types_that_numpy_does_not_have_are_no_numbers(code):
    data = pickle.dumps([np.zeros(6)], protocol=2).replace(
        b"X\x02\0\0\0f8", b"X" + struct.pack("<I", len(code)) + code.encode()
    )
    with pytest.raises(ValueError, match="not of numbers"):
        read_pickle(data)[0].numbers(ENOUGH)


@pytest.mark.parametrize("kind", ["?", "i1", "u1", "<i2", ">u4", "<i8", "f2", "<f4", ">f8"])
def test_all_numbers_of_numpy_are_read(kind):
    true = np.array([[0, 1, 1]], kind)
    (found,) = read_pickle(pickle.dumps([true], protocol=2))
    np.testing.assert_array_equal(found.numbers(3), true)
    with pytest.raises(ValueError, match="cut it into parts"):
        found.numbers(2)


def test_a_long_tuple_is_not_unpacked_again_and_again():
    arguments = b"(" + b"N" * 100_000 + b"tq\x000"
    call = b"h\x01h\x00R0"
    data = (
        b"\x80\x02" + arguments + b"cnumpy.core.multiarray\nscalar\nq\x010" + call * 100_000 + b"."
    )
    with pytest.raises(ValueError, match="more than 4 arguments"):
        read_pickle(data)


def test_an_array_larger_than_its_data_has_no_numbers():
    data = pickle.dumps([np.zeros((2, 3))], protocol=2)
    for shape in (b"K\x02K\x04\x86", b"K\x02J\xff\xff\xff\xff\x86"):
        with pytest.raises(ValueError, match="do not fill its shape"):
            read_pickle(data.replace(b"K\x02K\x03\x86", shape))[0].numbers(ENOUGH)


_GOOD = [pickle.dumps(NUMBERS, protocol=protocol) for protocol in range(5)]
_STEPS = [step.code.encode("latin1") for step in pickletools.opcodes]


@given(
    data=st.one_of(
        st.binary(max_size=60),
        st.lists(st.one_of(st.sampled_from(_STEPS), st.binary(max_size=6)), max_size=30).map(
            b"".join
        ),
    )
)
def test_any_bytes_are_data_or_refused(data):
    _read(data)


@given(
    good=st.sampled_from(_GOOD),
    at=st.integers(0, 2000),
    bytes_=st.binary(max_size=4),
    cut=st.integers(0, 8),
)
def test_damaged_pickles_are_data_or_refused(good, at, bytes_, cut):
    at %= len(good)
    _read(good[:at] + bytes_ + good[at + cut :])


def _read(data: bytes) -> None:
    try:
        found = read_pickle(data)
    except ValueError:
        return
    arrays = found.get("a", ()) if isinstance(found, dict) else (found,)
    for array in arrays if isinstance(arrays, list | tuple) else ():
        if isinstance(array, Array):
            with contextlib.suppress(ValueError):
                assert array.numbers(ENOUGH).dtype == np.float64
