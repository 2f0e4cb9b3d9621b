"""Our end-to-end protection against two other implementations, and the judgement of counters."""

from itertools import combinations

import pytest
from cantools.autosar.end_to_end import compute_profile2_crc, compute_profile5_crc
from e2e import p02, p04, p05
from fastcrc import crc8, crc16, crc32
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol import e2e
from hri_predict.protocol.definition import frame_table
from hri_predict.protocol.e2e import CounterCheck, Verdict

NUMBERS = sorted(frame_table(classic=True) | frame_table(classic=False))
numbers = st.sampled_from(NUMBERS)
bytes_ = st.integers(0, 255)


def test_check_values_of_the_crcs() -> None:
    digits = b"123456789"
    assert crc8.autosar(digits) == 0xDF
    assert crc16.ibm_3740(digits) == 0x29B1
    assert crc32.autosar(digits) == 0x1697D06A


@given(numbers, bytes_, st.binary(min_size=6, max_size=6))
def test_profile_2_as_others_do_it(number: int, counter: int, payload: bytes) -> None:
    ids = e2e.data_id_list(number)
    frame = e2e.protect_profile2(counter, payload, ids)
    assert frame[1:] == bytes((counter,)) + payload
    assert p02.e2e_p02_check(frame, ids)
    assert compute_profile2_crc(frame, ids[counter & 15]) == frame[0]
    theirs = bytearray(frame)
    theirs[0] = 0
    p02.e2e_p02_protect(theirs, ids, increment_counter=False)
    assert e2e.check_profile2(bytes(theirs), ids)


@given(numbers, bytes_, st.binary(min_size=1, max_size=61))
def test_profile_5_as_others_do_it(number: int, counter: int, payload: bytes) -> None:
    data_id = e2e.data_id_16(number)
    frame = e2e.protect_profile5(counter, payload, data_id)
    assert frame[2:] == bytes((counter,)) + payload
    assert p05.e2e_p05_check(frame, data_id)
    assert compute_profile5_crc(frame, data_id) == int.from_bytes(frame[:2], "little")
    theirs = bytearray(frame)
    theirs[0] = theirs[1] = 0
    p05.e2e_p05_protect(theirs, data_id, increment_counter=False)
    assert e2e.check_profile5(bytes(theirs), data_id)


@given(numbers, st.integers(0, 0xFFFF), st.binary(min_size=1, max_size=61))
def test_profile_4_as_others_do_it(number: int, counter: int, payload: bytes) -> None:
    data_id = e2e.data_id_32(number)
    frame = e2e.protect_profile4(counter, payload, data_id)
    assert frame[12:] == payload
    assert p04.e2e_p04_check(frame, data_id)
    theirs = bytearray(frame)
    theirs[8:12] = bytes(4)
    p04.e2e_p04_protect(theirs, data_id, increment_counter=False)
    assert bytes(theirs) == frame
    assert e2e.check_profile4(bytes(theirs))


@given(st.binary(max_size=80), numbers)
def test_checks_survive_any_bytes(data: bytes, number: int) -> None:
    e2e.check_profile2(data, e2e.data_id_list(number))
    e2e.check_profile5(data, e2e.data_id_16(number))
    e2e.check_profile4(data)


def test_data_ids_tell_every_frame_from_every_other() -> None:
    for a, b in combinations(NUMBERS, 2):
        pairs = zip(e2e.data_id_list(a), e2e.data_id_list(b), strict=True)
        assert all(x != y for x, y in pairs), (a, b)
    for number in NUMBERS:
        assert len(set(e2e.data_id_list(number))) == 1
    assert len({e2e.data_id_16(n) for n in NUMBERS}) == len(NUMBERS)


@given(numbers, numbers, bytes_, st.binary(min_size=6, max_size=6))
def test_a_frame_under_anothers_id_is_refused(a: int, b: int, counter: int, payload: bytes) -> None:
    frame = e2e.protect_profile2(counter, payload, e2e.data_id_list(a))
    assert e2e.check_profile2(frame, e2e.data_id_list(b)) is (a == b)


@pytest.mark.parametrize("modulus", [256, 65536])
def test_counters_in_order_are_fresh_across_the_wrap(modulus: int) -> None:
    check = CounterCheck(modulus)
    verdicts = {check.check((modulus - 5 + i) % modulus) for i in range(300)}
    assert verdicts == {Verdict.OK}


def test_losses_are_counted_up_to_the_limit() -> None:
    check = CounterCheck(256)
    check.check(10)
    assert check.check(10 + e2e.MAX_DELTA) is Verdict.SOME_LOST
    assert check.lost == e2e.MAX_DELTA - 1
    assert check.check(10 + 2 * e2e.MAX_DELTA + 1) is Verdict.WRONG_SEQUENCE


def test_a_jumped_counter_is_followed_after_a_few_in_sequence() -> None:
    check = CounterCheck(256)
    check.check(100)
    verdicts = [check.check(c) for c in (5, 6, 7, 8)]
    assert verdicts == [Verdict.WRONG_SEQUENCE, Verdict.WRONG_SEQUENCE, Verdict.OK, Verdict.OK]


@given(st.integers(0, 255), st.lists(st.integers(0, 100), max_size=30))
def test_a_repeated_or_older_counter_is_never_fresh(start: int, backs: list[int]) -> None:
    """Between new messages arrives an old one each time: none of them may pass."""
    check = CounterCheck(256)
    newest = start
    assert check.check(newest) is Verdict.OK
    for back in backs:
        assert check.check((newest - back) % 256) in (Verdict.REPEATED, Verdict.WRONG_SEQUENCE)
        newest = (newest + 1) % 256
        assert check.check(newest) is Verdict.OK


def test_a_short_burst_of_old_messages_is_not_followed() -> None:
    check = CounterCheck(256)
    check.check(50)
    for old in range(20, 20 + e2e.RESYNC - 1):
        assert check.check(old) is Verdict.WRONG_SEQUENCE
    assert check.check(51) is Verdict.OK


def test_counters_that_jump_about_are_never_followed() -> None:
    check = CounterCheck(256)
    check.check(100)
    for counter in (10, 40, 41, 70, 12, 13, 60, 20):
        assert check.check(counter) is Verdict.WRONG_SEQUENCE
    assert check.check(101) is Verdict.OK
