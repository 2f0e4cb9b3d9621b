import sys
import threading
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.people.ring_buffer import NEVER, PushResult, RingBuffer

MS = 1_000_000
GAP = 100 * MS


def filled(stamps, positions, observed, capacity=64):
    ring = RingBuffer(joints=observed.shape[1], capacity=capacity, max_gap_ns=GAP)
    for stamp, row, seen in zip(stamps, positions, observed, strict=True):
        assert ring.push(int(stamp), row, seen, int(stamp)) is PushResult.ACCEPTED
    return ring


def naive_window(samples, t_end, n, rate, joints):
    """What ``window`` says it does, one joint and one step at a time."""
    positions = [[[0.0] * 3 for _ in range(joints)] for _ in range(n)]
    observed = [[False] * joints for _ in range(n)]
    for k in range(n):
        t = t_end - round((n - 1 - k) * 1e9 / rate)
        for j in range(joints):
            seen = [(s, p[j]) for s, p, o in samples if o[j] and s <= t_end]
            earlier = [x for x in seen if x[0] <= t]
            later = [x for x in seen if x[0] > t]
            if not earlier:
                continue
            start, a = earlier[-1]
            positions[k][j] = list(a)
            observed[k][j] = start == t
            if start != t and later and later[0][0] - start <= GAP:
                stop, b = later[0]
                w = (t - start) / (stop - start)
                positions[k][j] = [x + w * (y - x) for x, y in zip(a, b, strict=True)]
                observed[k][j] = True
    return np.array(positions), np.array(observed)


@st.composite
def histories(draw):
    joints = draw(st.integers(1, 4))
    count = draw(st.integers(0, 30))
    # a few values, so that exact hits and gaps of just the limit occur
    steps = draw(
        st.lists(
            st.sampled_from([MS, 20 * MS, 40 * MS, 100 * MS, 101 * MS, 333 * MS]),
            min_size=count,
            max_size=count,
        )
    )
    stamps = np.cumsum(np.array([0, *steps], np.int64))[1:]
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    share = draw(st.sampled_from([0.0, 0.3, 0.9, 1.0]))
    observed = rng.random((count, joints)) >= share
    return stamps, rng.normal(size=(count, joints, 3)), observed


@given(
    histories(),
    st.integers(1, 12),
    st.sampled_from([25.0, 30.0, 50.0]),
    st.sampled_from([0, -1, 1, -40 * MS, 500 * MS, -(10**10)]),
    st.sampled_from([5, 64]),
)
def test_window_equals_the_naive_model(history, n, rate, shift, capacity):
    stamps, positions, observed = history
    ring = filled(stamps, positions, observed, capacity)
    t_end = int(stamps[-1] if len(stamps) else 0) + shift
    window = ring.window(t_end, n, rate)
    kept = list(zip(stamps.tolist(), positions, observed, strict=True))[-capacity:]
    expected, seen = naive_window(kept, t_end, n, rate, observed.shape[1])
    assert window.positions.shape == (n, observed.shape[1], 3)
    np.testing.assert_array_equal(window.observed, seen)
    np.testing.assert_allclose(window.positions, expected, atol=1e-12)
    recalled, last, when = ring.recall(t_end, n, rate)
    np.testing.assert_array_equal(recalled.positions, window.positions)
    np.testing.assert_array_equal(last, ring.recall(t_end, 1, 25.0)[1])
    np.testing.assert_array_equal(when, ring.recall(t_end, 1, 25.0)[2])


@given(histories(), st.integers(0, 29), st.integers(0, 2**32 - 1))
def test_nothing_after_the_windows_end_matters(history, cut, seed):
    stamps, positions, observed = history
    cut = min(cut, len(stamps))
    t_end = int(stamps[cut - 1]) if cut else 0
    other = np.random.default_rng(seed)
    changed = positions.copy()
    changed[cut:] = other.normal(size=changed[cut:].shape)
    changed_seen = observed.copy()
    changed_seen[cut:] = other.random(changed_seen[cut:].shape) > 0.5
    one = filled(stamps, positions, observed)
    two = filled(stamps, changed, changed_seen)
    none = filled(stamps[:cut], positions[:cut], observed[:cut])
    for ring in (two, none):
        a, b = one.window(t_end, 10, 25.0), ring.window(t_end, 10, 25.0)
        np.testing.assert_array_equal(a.positions, b.positions)
        np.testing.assert_array_equal(a.observed, b.observed)
        for x, y in zip(
            one.recall(t_end, 1, 25.0)[1:], ring.recall(t_end, 1, 25.0)[1:], strict=True
        ):
            np.testing.assert_array_equal(x, y)


@given(histories())
def test_last_observed_equals_the_naive_model(history):
    stamps, positions, observed = history
    ring = filled(stamps, positions, observed)
    _, last, when = ring.recall(int(stamps[-1]) if len(stamps) else 0, 1, 25.0)
    for j in range(observed.shape[1]):
        indices = np.flatnonzero(observed[:, j])
        if len(indices):
            np.testing.assert_array_equal(last[j], positions[indices[-1], j])
            assert when[j] == stamps[indices[-1]]
        else:
            assert np.isnan(last[j]).all()
            assert when[j] == NEVER


@given(st.lists(st.integers(0, 3000), min_size=1, max_size=40), st.integers(0, 60))
def test_each_stamp_is_judged_and_counted(milliseconds, tolerance):
    now = 2000 * MS
    ring = RingBuffer(
        joints=1,
        capacity=8,
        max_gap_ns=GAP,
        future_tolerance_ns=tolerance * MS,
        backward_limit_ns=500 * MS,
    )
    accepted: list[int] = []
    expected = dict.fromkeys(PushResult, 0)
    for ms in milliseconds:
        newest = accepted[-1] if accepted else None
        if ms > 2000 + tolerance:
            verdict = PushResult.FUTURE
        elif newest is None or ms > newest:
            verdict = PushResult.ACCEPTED
            accepted.append(ms)
        elif ms == newest:
            verdict = PushResult.DUPLICATE
        elif newest - ms > 500:
            verdict = PushResult.BACKWARD_JUMP
        else:
            verdict = PushResult.OUT_OF_ORDER
        expected[verdict] += 1
        value = np.full((1, 3), float(ms))
        assert ring.push(ms * MS, value, np.array([True]), now) is verdict
    assert ring.counts == expected
    stamps, positions, _ = ring.samples()
    assert stamps.tolist() == [ms * MS for ms in accepted[-8:]]
    assert positions[:, 0, 0].tolist() == [float(ms) for ms in accepted[-8:]]
    assert len(ring) == min(len(accepted), 8)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_joint_that_is_not_a_number_is_unobserved(bad):
    ring = RingBuffer(joints=3, capacity=8, max_gap_ns=GAP)
    positions = np.ones((3, 3))
    ring.push(MS, positions, np.ones(3, bool), MS)
    positions = np.full((3, 3), 2.0)
    positions[1, 2] = bad
    ring.push(2 * MS, positions, np.ones(3, bool), 2 * MS)
    window = ring.window(2 * MS, 1, 25.0)
    assert window.observed.tolist() == [[True, False, True]]
    assert window.positions[0].tolist() == [[2.0] * 3, [1.0] * 3, [2.0] * 3]


def test_an_empty_buffer_gives_an_unobserved_window():
    window = RingBuffer(joints=2, capacity=8, max_gap_ns=GAP).window(0, 4, 25.0)
    assert window.positions.shape == (4, 2, 3)
    assert not window.positions.any()
    assert not window.observed.any()


def test_pushing_allocates_nothing_that_stays():
    ring = RingBuffer(joints=21, capacity=100, max_gap_ns=GAP)
    positions = np.zeros((21, 3))
    some = np.zeros((21, 3))
    some[3] = np.nan
    observed = np.ones(21, bool)
    stamps = [i * MS for i in range(1, 4001)]
    start, warm, middle, rest = stamps[:1000], stamps[1000:1010], stamps[1010:2500], stamps[2500:]
    for stamp in start:
        ring.push(stamp, positions, observed, stamp)
    tracemalloc.start()
    try:
        for stamp in warm:
            ring.push(stamp, positions, observed, stamp)
        before, _ = tracemalloc.get_traced_memory()
        tracemalloc.reset_peak()
        for stamp in middle:
            ring.push(stamp, positions, observed, stamp)
        for stamp in rest:
            ring.push(stamp, some, observed, stamp)
        after, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 256  # a few Python integers
    # a sample's positions are 504 bytes: not even a passing copy of one is made per push
    assert peak - before < 504


def test_readers_never_see_a_torn_sample():
    """Every value of a sample is its stamp: a torn one would mix two."""
    joints, pushes = 40, 20_000
    ring = RingBuffer(joints=joints, capacity=32, max_gap_ns=10**9)
    done = threading.Event()
    faults: list[str] = []
    reads = [0, 0, 0]

    def write():
        positions = np.empty((joints, 3))
        observed = np.ones(joints, bool)
        for stamp in range(1, pushes + 1):
            positions[...] = stamp
            ring.push(stamp, positions, observed, stamp)
        done.set()

    def read(which):
        newest_seen = 0
        while not done.is_set() or reads[which] == 0:
            stamps, positions, _ = ring.samples()
            if not (positions == stamps[:, None, None]).all():
                faults.append("torn sample")
            if len(stamps) and not (np.diff(stamps) == 1).all():
                faults.append("sample missing or out of order")
            if len(stamps):
                if stamps[-1] < newest_seen:
                    faults.append("went back in time")
                newest_seen = stamps[-1]
                end = int(stamps[-1])
                window = ring.window(end, 8, 1e9)
                if window.observed[-1].all():  # the writer may have overtaken ``end`` by now
                    expected = np.arange(end - 7, end + 1)[:, None, None]
                    good = window.observed[..., None]
                    if not np.where(good, window.positions == expected, True).all():
                        faults.append("wrong window")
            reads[which] += 1

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)  # many switches, in the middle of reads and pushes
    try:
        threads = [threading.Thread(target=write)]
        threads += [threading.Thread(target=read, args=(i,)) for i in range(3)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
    finally:
        sys.setswitchinterval(interval)
    assert not faults
    assert min(reads) > 10
    assert ring.counts[PushResult.ACCEPTED] == pushes
    assert len(ring) == 32


def test_a_reader_throws_away_what_the_writer_overtook():
    """The check behind the stress test, made to happen: the writer runs during the copy."""
    ring = RingBuffer(joints=1, capacity=8, max_gap_ns=10**9)
    stamp = 0

    def push(times):
        nonlocal stamp
        for _ in range(times):
            stamp += 1
            ring.push(stamp, np.full((1, 3), stamp), np.array([True]), stamp)

    push(20)

    class Overtaken:
        """Stands for the stamps: each time they are read, the writer gets ahead by 20."""

        def __init__(self, inner):
            self.inner = inner

        def take(self, slots):
            copied = self.inner.take(slots)
            push(20)
            return copied

        def __setitem__(self, slot, value):
            self.inner[slot] = value

    ring._stamps = Overtaken(ring._stamps)  # type: ignore[assignment]
    stamps, positions, observed = ring.samples()
    assert ring.reads_cut == 1
    assert len(stamps) == len(positions) == len(observed) == 4  # 8 + 16 slots, 20 of them anew
    assert (positions[:, 0, 0] == stamps).all()


@pytest.mark.parametrize(("joints", "capacity", "gap"), [(0, 8, 1), (1, 0, 1), (1, 8, -1)])
def test_absurd_sizes_are_refused(joints, capacity, gap):
    with pytest.raises(ValueError, match="at least"):
        RingBuffer(joints=joints, capacity=capacity, max_gap_ns=gap)


@pytest.mark.parametrize(("positions", "observed"), [((3,), (2,)), ((2, 3), (1,)), ((3, 3), (3,))])
def test_a_sample_of_another_shape_is_refused_and_leaves_no_trace(positions, observed):
    ring = RingBuffer(joints=2, capacity=8, max_gap_ns=GAP)
    with pytest.raises(ValueError, match=r"give \(2, 3\) and \(2,\)"):
        ring.push(0, np.zeros(positions), np.ones(observed, bool), 0)
    assert len(ring.samples()[0]) == 0
    assert ring.push(0, np.zeros((2, 3)), np.ones(2, bool), 0) is PushResult.ACCEPTED


@pytest.mark.parametrize(("n", "rate_hz"), [(-1, 25.0), (3, 0.0), (3, -25.0), (3, float("nan"))])
def test_a_window_of_no_sense_is_refused(n, rate_hz):
    ring = RingBuffer(joints=1, capacity=8, max_gap_ns=GAP)
    with pytest.raises(ValueError, match="rate_hz above 0"):
        ring.window(0, n, rate_hz)
