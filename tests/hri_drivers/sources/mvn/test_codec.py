"""MVN's datagrams: bytes worked by hand, samples put together, hostile input."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_drivers.sources.mvn.codec import (
    EULER,
    MAX_DATAGRAM,
    QUATERNION,
    SEGMENTS,
    Assembler,
    MalformedDatagram,
    MvnPose,
    Sample,
    StreamSplitter,
    add_segments,
    parse,
)
from hri_predict.contracts.source import SourceCounters
from hri_sim.senders import mvn as mvn_sender

BODY = np.arange(SEGMENTS * 3, dtype=np.float64).reshape(SEGMENTS, 3) / 8  # exact in 32 bits

# Sample 42, the last datagram, 1 item, time code 1000 ms, character 3, 23 segments, 32 bytes:
# segment ID 2 (L5) at 1, -2, 3, its quaternion w = 1, x = y = z = 0.
BY_HAND = bytes.fromhex(
    "4D585450 3032 0000002A 80 01 000003E8 03 17 00 00 0000 0020"
    "00000002 3F800000 C0000000 40400000 3F800000 00000000 00000000 00000000"
)


class Hearing:
    """An assembler, and the counters that it counts into."""

    def __init__(self, number: int = QUATERNION, step: float = 1.0) -> None:
        self.counters = SourceCounters()
        self.assembler = Assembler(number, step, self.counters)

    def add(self, *datagrams: bytes) -> list[Sample]:
        found = [self.assembler.add(parse(data)) for data in datagrams]
        return [sample for sample in found if sample is not None]


def body(sample: int, character: int = 0) -> bytes:
    (data,) = mvn_sender.quaternions(sample, sample * 10, character, BODY)
    return data


def test_a_datagram_worked_by_hand() -> None:
    datagram = parse(BY_HAND)
    assert (datagram.type, datagram.sample, datagram.index, datagram.last) == (2, 42, 0, True)
    assert (datagram.items, datagram.time_code_ms, datagram.character) == (1, 1000, 3)
    pose = MvnPose()
    add_segments(datagram, pose)
    assert pose.positions[1].tolist() == [1.0, -2.0, 3.0]
    assert np.flatnonzero(pose.observed).tolist() == [1]


@pytest.mark.parametrize(
    ("quaternion", "sound"),
    [
        ("3F800000 00000000 00000000 00000000", True),  # w = 1: no rotation
        ("3F3504F3 00000000 00000000 3F3504F3", True),  # w = z = 0.7071: a quarter turn about z
        ("00000000 00000000 00000000 00000000", False),
        ("3F800000 3F800000 00000000 00000000", False),  # of length 1.414
        ("7FC00000 00000000 00000000 00000000", False),  # NaN
    ],
)
def test_a_segment_without_a_sound_rotation_is_unobserved(quaternion: str, sound: bool) -> None:
    pose = MvnPose()
    add_segments(parse(BY_HAND[:40] + bytes.fromhex(quaternion)), pose)
    assert bool(pose.observed[1]) is sound


@pytest.mark.parametrize(
    "data",
    [
        b"",
        BY_HAND[:23],
        BY_HAND[:-1],
        BY_HAND + b"\0",
        b"MXTQ" + BY_HAND[4:],
        b"MXTP0x" + BY_HAND[6:],
        BY_HAND[:11] + b"\2" + BY_HAND[12:],  # two items, one there
        BY_HAND[:22] + b"\0\x21" + BY_HAND[24:],
    ],
)
def test_what_is_no_datagram_is_refused(data: bytes) -> None:
    with pytest.raises(MalformedDatagram):
        parse(data)


def test_before_mvn_2019_no_size_is_stated() -> None:
    assert parse(BY_HAND[:17] + bytes(7) + BY_HAND[24:]).payload == BY_HAND[24:]


@given(st.integers(0), st.integers(1, 23))
def test_what_mvn_says_is_what_we_hear(seed: int, each: int) -> None:
    positions = np.random.default_rng(seed).integers(-8000, 8000, (SEGMENTS, 3)) / 64
    sent = mvn_sender.quaternions(7, 9, 1, positions, items_each=each)
    (sample,) = Hearing().add(*sent)
    assert (sample.counter, sample.time_code_ms) == (7, 9)
    np.testing.assert_array_equal(sample.poses[1].positions, positions)
    assert sample.poses[1].observed.all()


def test_euler_is_in_centimetres_with_y_up() -> None:
    """One metre forward, two left, three up: z, x, y of the stream."""
    positions = np.tile([1.0, 2.0, 3.0], (SEGMENTS, 1))
    (sample,) = Hearing(EULER).add(*mvn_sender.eulers(0, 0, 0, positions))
    assert sample.poses[0].positions[0].tolist() == [200.0, 300.0, 100.0]


def test_a_body_with_fingers_goes_in_two_datagrams_in_any_order() -> None:
    first, second = mvn_sender.quaternions(1, 10, 0, BODY, fingers=40)
    assert (first[10], second[10]) == (0x00, 0x81)
    (sample,) = Hearing().add(second, first)
    np.testing.assert_array_equal(sample.poses[0].positions, BODY)  # fingers are no segments


def test_a_body_of_which_a_datagram_is_lost_is_lost_and_counted() -> None:
    hearing = Hearing()
    three = mvn_sender.quaternions(1, 10, 0, BODY, items_each=8)
    assert [data[10] for data in three] == [0, 1, 0x82]
    assert not hearing.add(three[0], three[2])
    assert hearing.add(body(2))
    assert hearing.counters.incomplete == 1


def test_nobody_vanishes_because_a_datagram_did() -> None:
    hearing = Hearing()
    hearing.add(body(1, 0), body(1, 1))  # 1 is heard for the first time: the next waits for it
    (both,) = hearing.add(body(2, 0), body(2, 1))
    assert sorted(both.poses) == [0, 1]
    assert not hearing.add(body(3, 0))
    (again,) = hearing.add(body(4, 1), body(4, 0))
    assert sorted(again.poses) == [0, 1]
    assert hearing.counters.incomplete == 1


def test_who_is_missing_three_times_has_left() -> None:
    hearing = Hearing()
    hearing.add(body(1, 0), body(1, 1), body(2, 0), body(2, 1))
    assert not hearing.add(body(3, 0), body(4, 0), body(5, 0))
    (alone,) = hearing.add(body(6, 0))
    assert list(alone.poses) == [0]


def test_who_is_never_whole_has_not_left() -> None:
    """Of person 1 the same datagram is lost every time: the room without them is not the room."""
    hearing = Hearing()
    hearing.add(body(1, 0), body(1, 1))
    for n in range(2, 30):
        three = mvn_sender.quaternions(n, 10 * n, 1, BODY, items_each=8)
        assert not hearing.add(body(n, 0), three[0], three[2])
    (both,) = hearing.add(body(30, 0), body(30, 1))
    assert sorted(both.poses) == [0, 1]


def test_losses_repeats_and_order_are_counted() -> None:
    hearing = Hearing()
    hearing.add(body(10), body(10), body(14), body(13))
    assert hearing.counters.replayed == 1
    assert hearing.counters.lost == 3
    assert hearing.counters.out_of_order == 1


def test_samples_that_are_not_streamed_are_not_lost() -> None:
    hearing = Hearing(step=4.0)
    hearing.add(body(0), body(4), body(8), body(16))
    assert hearing.counters.lost == 1


def test_the_counter_may_wrap_and_may_begin_anew() -> None:
    hearing = Hearing()
    assert len(hearing.add(body(1), body(0), body(2))) == 2  # 0 is late
    data = [mvn_sender.quaternions(n, 0, 0, BODY)[0] for n in (0xFFFFFFFF, 0, 1)]
    hearing = Hearing()
    assert len(hearing.add(*data)) == 3
    assert hearing.assembler.session == 0
    assert len(hearing.add(body(5000), body(0), body(1))) == 3
    assert hearing.assembler.session == 1


def test_a_sender_may_begin_anew_soon_after_it_had_begun() -> None:
    hearing = Hearing()
    hearing.add(body(0), body(1), body(2), body(3))
    heard = hearing.add(*(body(n) for n in range(3)), *(body(n) for n in range(3)))
    assert not heard  # a few may just be late
    assert hearing.add(*(body(n % 3) for n in range(4)))
    assert hearing.assembler.session == 1


def test_a_damaged_counter_is_no_loss_of_billions() -> None:
    hearing = Hearing()
    hearing.add(
        *mvn_sender.quaternions(5, 0, 0, BODY), *mvn_sender.quaternions(1 << 31, 0, 0, BODY)
    )
    hearing.add(body(6))
    assert hearing.counters.lost == 0
    assert hearing.assembler.session == 2


def test_types_that_place_nobody_are_counted_alone() -> None:
    hearing = Hearing()
    others = [mvn_sender.meta_data(1, 0, 0, "Ann"), mvn_sender.time_code(1, 0)]
    others += mvn_sender.eulers(1, 0, 0, BODY)
    others += [
        mvn_sender.datagram(
            kind=f"{t}", sample=1, time_code_ms=0, character=0, payload=b"abc", items=1
        )
        for t in ("05", "13", "20", "24")
    ]
    assert not hearing.add(*others)
    assert hearing.counters.ignored == 7


@given(st.binary(max_size=100), st.integers(0, 60), st.integers(0, 255))
@settings(max_examples=20)
def test_no_bytes_break_the_decoder(data: bytes, at: int, byte: int) -> None:
    whole = body(1)
    mutated = whole[:at] + bytes([byte]) + whole[at + 1 :]
    for candidate in (data, b"MXTP02" + data, mutated, whole[: at * 12]):
        hearing = Hearing()
        try:
            samples = hearing.add(candidate)
        except MalformedDatagram:
            continue
        for sample in samples:
            for pose in sample.poses.values():
                assert np.isfinite(pose.positions[pose.observed]).all()


@given(st.binary(min_size=SEGMENTS * 32, max_size=SEGMENTS * 32))
@settings(max_examples=20)
def test_any_numbers_are_positions_or_unobserved(payload: bytes) -> None:
    pose = MvnPose()
    add_segments(
        parse(
            mvn_sender.datagram(
                kind="02", sample=1, time_code_ms=1, character=0, payload=payload, items=SEGMENTS
            )
        ),
        pose,
    )
    assert np.isfinite(pose.positions[pose.observed]).all()


@given(st.lists(st.integers(1, 2000), max_size=8), st.binary(max_size=30))
@settings(max_examples=20)
def test_a_stream_is_found_again_after_anything(cuts: list[int], garbage: bytes) -> None:
    wanted = [body(1), mvn_sender.time_code(1, 0), body(2)]
    stream = wanted[0] + garbage.replace(b"M", b"N") + wanted[1] + wanted[2]
    splitter, found, at = StreamSplitter(), [], 0
    for cut in [*cuts, len(stream)]:
        found += list(splitter.feed(stream[at : at + cut]))
        at += cut
    assert b"".join(found) == stream  # nothing is lost uncounted
    assert [unit for unit in found if unit.startswith(b"MXTP")] == wanted


def test_a_stream_of_anything_takes_no_memory() -> None:
    rng = np.random.default_rng(0)
    splitter = StreamSplitter()
    noise = rng.bytes(65_536)
    list(splitter.feed(noise))
    tracemalloc.start()
    try:
        for _ in range(30):
            list(splitter.feed(noise + b"MXTP13" + b"\xff" * 18))
        assert tracemalloc.get_traced_memory()[0] < 2 * (MAX_DATAGRAM + len(noise))
    finally:
        tracemalloc.stop()
