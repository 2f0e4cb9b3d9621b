"""One person's history: preallocated, with one writer and many readers that never block it.

The writer announces a push (``_begun``), fills the slot, then commits it (``_committed``). A reader
copies the newest ``capacity`` samples and then reads ``_begun``: a sample may be torn if its slot
was reused in the meantime, and only such samples are dropped. A few spare slots make this rare. If
it happens, the reader retries a bounded number of times, and at worst loses some of the oldest
samples, but never returns a torn one. The order of the counters' updates relies on CPython
executing one bytecode at a time (the interpreter lock), or on a machine with total store order.
"""

from dataclasses import dataclass
from enum import Enum
from functools import lru_cache

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Stamps

NEVER = np.iinfo(np.int64).min
"""Time stamp of a joint that was never observed."""
_SPARE_SLOTS = 16
_READ_TRIES = 8


class PushResult(Enum):
    """The result of a push."""

    ACCEPTED = "accepted"
    OUT_OF_ORDER = "out_of_order"
    DUPLICATE = "duplicate"
    FUTURE = "future"
    BACKWARD_JUMP = "backward_jump"


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """History resampled at a fixed rate, oldest step first.

    Attributes:
        positions: (n, J, 3) metres, finite everywhere; where not observed, the nearest earlier
            observed value, or 0.
        observed: (n, J) whether observed samples support the step.
    """

    positions: Floats
    observed: Bools


class RingBuffer:
    """The newest ``capacity`` samples of one person.

    Args:
        joints: J, joints per sample.
        capacity: samples kept.
        max_gap_ns: longest gap between two observations of a joint that is bridged by linear
            interpolation.
        future_tolerance_ns: maximum time by which a stamp may be ahead of "now".
        backward_limit_ns: a stamp that is older than the newest by more than this is a backward
            jump of the clock; otherwise it is a sample out of order. Both are refused.

    Attributes:
        counts: number of occurrences of each ``PushResult``.
        reads_cut: reads that dropped the oldest samples because the writer overtook them.
    """

    def __init__(
        self,
        *,
        joints: int,
        capacity: int,
        max_gap_ns: int,
        future_tolerance_ns: int = 20_000_000,
        backward_limit_ns: int = 500_000_000,
    ) -> None:
        if joints < 1 or capacity < 1 or max_gap_ns < 0:
            raise ValueError("joints and capacity must be at least 1, max_gap_ns at least 0")
        self.joints = joints
        self.capacity = capacity
        self.counts = dict.fromkeys(PushResult, 0)
        self.reads_cut = 0
        self._max_gap_ns = max_gap_ns
        self._future_tolerance_ns = future_tolerance_ns
        self._backward_limit_ns = backward_limit_ns
        self._size = capacity + _SPARE_SLOTS
        self._stamps: Stamps = np.zeros(self._size, np.int64)
        self._positions: Floats = np.zeros((self._size, joints, 3))
        self._observed: Bools = np.zeros((self._size, joints), np.bool_)
        self._errors_m: Floats = np.zeros(self._size)
        # one view per slot, made once, because indexing an array makes a new view each time
        self._position_rows = list(self._positions)
        self._flat_rows = [row.reshape(-1) for row in self._positions]
        self._observed_rows = list(self._observed)
        self._finite = np.zeros((joints, 3), np.bool_)
        self._finite_columns = tuple(self._finite.T)
        self._newest_ns: int | None = None
        self._begun = 0
        self._committed = 0

    def __len__(self) -> int:
        """Samples held."""
        return min(self._committed, self.capacity)

    def push(
        self,
        capture_ns: int,
        positions: Floats,
        observed: Bools,
        now_ns: int,
        *,
        error_m: float = 0.0,
    ) -> PushResult:
        """Append a sample; only the writing thread may call it.

        Joints with a coordinate that is not finite count as unobserved.

        Args:
            capture_ns: capture time, node's clock.
            positions: (J, 3) metres; any value where not observed.
            observed: (J,).
            now_ns: current time, node's clock.
            error_m: see ``hri_predict.contracts.scene.Person``.

        Returns:
            Whether the sample was accepted, or the reason for refusal; each result is counted.

        Raises:
            ValueError: an array has the wrong shape, which numpy would otherwise broadcast to all
                joints.
        """
        joints = self._observed_rows[0].shape[0]
        if positions.shape != (joints, 3) or observed.shape != (joints,):
            raise ValueError(
                f"shapes {positions.shape} and {observed.shape}; give ({joints}, 3) and ({joints},)"
            )
        result = self._judge(capture_ns, now_ns)
        self.counts[result] += 1
        if result is not PushResult.ACCEPTED:
            return result
        index = self._committed
        slot = index % self._size
        self._begun = index + 1
        self._stamps[slot] = capture_ns
        self._errors_m[slot] = error_m
        row = self._position_rows[slot]
        seen = self._observed_rows[slot]
        row[...] = positions
        seen[...] = observed
        flat = self._flat_rows[slot]
        if not flat.dot(flat) < np.inf:  # one product finds NaN and infinity anywhere
            x, y, z = self._finite_columns
            np.isfinite(row, out=self._finite)
            np.logical_and(seen, x, out=seen)
            np.logical_and(seen, y, out=seen)
            np.logical_and(seen, z, out=seen)
            np.logical_not(self._finite, out=self._finite)
            np.putmask(row, self._finite, 0.0)
        self._newest_ns = capture_ns
        self._committed = index + 1
        return result

    @property
    def error_m(self) -> float:
        """Return the largest error of the kept samples and a few earlier ones; for any thread."""
        return float(self._errors_m.max())

    def _judge(self, capture_ns: int, now_ns: int) -> PushResult:
        if capture_ns > now_ns + self._future_tolerance_ns:
            return PushResult.FUTURE
        newest_ns = self._newest_ns
        if newest_ns is None or capture_ns > newest_ns:
            return PushResult.ACCEPTED
        if capture_ns == newest_ns:
            return PushResult.DUPLICATE
        if newest_ns - capture_ns > self._backward_limit_ns:
            return PushResult.BACKWARD_JUMP
        return PushResult.OUT_OF_ORDER

    def samples(self, newest: int | None = None) -> tuple[Stamps, Floats, Bools]:
        """Return copies, oldest first: stamps (M,), positions (M, J, 3), observed (M, J).

        Positions are finite everywhere, but meaningless where not observed.

        Args:
            newest: maximum number of samples; ``None``: all.
        """
        most = self.capacity if newest is None else min(newest, self.capacity)
        for attempt in range(_READ_TRIES):
            end = self._committed
            first = max(0, end - most)
            slots = np.arange(first, end) % self._size
            stamps = self._stamps.take(slots)
            positions = self._positions.take(slots, axis=0)
            observed = self._observed.take(slots, axis=0)
            overtaken = self._begun - self._size - first
            if overtaken <= 0:
                return stamps, positions, observed
            if attempt == _READ_TRIES - 1:
                self.reads_cut += 1
        return stamps[overtaken:], positions[overtaken:], observed[overtaken:]

    def window(self, t_end_ns: int, n: int, rate_hz: float) -> Window:
        """Resample the history that ends at ``t_end_ns``; for any thread.

        Step k is at ``t_end_ns - (n - 1 - k) / rate_hz``. Each joint is interpolated linearly
        between its neighbouring observations if they are at most ``max_gap_ns`` apart; a step that
        coincides with an observation takes its value; everything else is unobserved. Samples
        captured after ``t_end_ns`` are ignored.

        Raises:
            ValueError: ``n`` is below 0, or ``rate_hz`` is not above 0 and finite.
        """
        if n < 0 or not 0 < rate_hz < np.inf:
            raise ValueError(f"n {n}, rate_hz {rate_hz}: n must be 0 or more, rate_hz above 0")
        return self._resampled(self.samples(), t_end_ns, n, rate_hz)

    def recall(self, t_end_ns: int, n: int, rate_hz: float) -> tuple[Window, Floats, Stamps]:
        """Return ``window``, and position and time of each joint's last observation; for any
        thread.

        Both come from one copy of the samples.

        Returns:
            the window; positions (J, 3), NaN if not observed within the buffer; stamps (J,),
            ``NEVER`` if not.
        """
        samples = self.samples()
        window = self._resampled(samples, t_end_ns, n, rate_hz)
        return window, *last_observed(*samples, t_end_ns)

    def _resampled(
        self, samples: tuple[Stamps, Floats, Bools], t_end_ns: int, n: int, rate_hz: float
    ) -> Window:
        stamps, positions, observed = samples
        return resample(
            stamps=stamps,
            positions=positions,
            observed=observed,
            t_end_ns=t_end_ns,
            n=n,
            rate_hz=rate_hz,
            max_gap_ns=self._max_gap_ns,
        )


@lru_cache(maxsize=32)
def _steps_ns(n: int, rate_hz: float) -> Stamps:
    """Return (n,) nanoseconds from each step to the window's end."""
    steps: Stamps = np.rint(np.arange(n - 1, -1, -1) * (1e9 / rate_hz)).astype(np.int64)
    steps.flags.writeable = False
    return steps


def resample(
    *,
    stamps: Stamps,
    positions: Floats,
    observed: Bools,
    t_end_ns: int,
    n: int,
    rate_hz: float,
    max_gap_ns: int,
) -> Window:
    """Resample samples (oldest first, with strictly increasing stamps); see ``RingBuffer.window``.

    Args:
        stamps: (M,) nanoseconds.
        positions: (M, J, 3) metres, finite.
        observed: (M, J).
        t_end_ns: time of the last step.
        n: steps.
        rate_hz: steps per second.
        max_gap_ns: longest gap that is bridged.
    """
    joints = observed.shape[1]
    end = int(stamps.searchsorted(t_end_ns, side="right"))
    if end == 0:
        return Window(np.zeros((n, joints, 3)), np.zeros((n, joints), np.bool_))
    stamps, positions, observed = stamps[:end], positions[:end], observed[:end]
    times = t_end_ns - _steps_ns(n, rate_hz)
    after = stamps.searchsorted(times, side="right")
    before = after - 1

    if observed.all():  # one index serves all joints
        earlier, later = before[:, None], after[:, None]
    else:
        order = np.arange(end)[:, None]
        newest_up_to = np.maximum.accumulate(np.where(observed, order, -1), axis=0)
        oldest_from = np.minimum.accumulate(np.where(observed, order, end)[::-1], axis=0)[::-1]
        earlier = newest_up_to.take(before, axis=0, mode="clip")
        earlier[before < 0] = -1
        later = oldest_from.take(after, axis=0, mode="clip")
        later[after == end] = end

    has_earlier = earlier >= 0
    earlier = np.maximum(earlier, 0)
    has_later = later < end
    later = np.minimum(later, end - 1)
    start = stamps[earlier]
    gap = stamps[later] - start
    since = times[:, None] - start
    exact = has_earlier & (since == 0)
    bridged = has_earlier & has_later & (gap <= max_gap_ns)
    # a weight of 0 holds the earlier observation: for the exact hit and for the unobserved alike
    weight = np.where(bridged, since / np.maximum(gap, 1), 0.0)[..., None]
    if earlier.shape[1] == 1:
        held, next_one = positions.take(earlier[:, 0], axis=0), positions.take(later[:, 0], axis=0)
    else:  # taking from a flat table is several times faster than indexing by two arrays
        table, columns = positions.reshape(-1, 3), np.arange(joints)
        held = table.take(earlier * joints + columns, axis=0)
        next_one = table.take(later * joints + columns, axis=0)
    result = held + weight * (next_one - held)
    if not has_earlier.all():
        result *= has_earlier[..., None]
    seen = exact | bridged
    if seen.shape[1] != joints:
        seen = np.repeat(seen, joints, axis=1)
    return Window(result, seen)


def last_observed(
    stamps: Stamps, positions: Floats, observed: Bools, t_end_ns: int
) -> tuple[Floats, Stamps]:
    """Return position and time of each joint's last observation; see ``RingBuffer.recall``."""
    joints = observed.shape[1]
    last: Floats = np.full((joints, 3), np.nan)
    when: Stamps = np.full(joints, NEVER)
    end = int(stamps.searchsorted(t_end_ns, side="right"))
    if end:
        seen = observed[:end]
        index = end - 1 - seen[::-1].argmax(axis=0)
        ever = np.flatnonzero(seen[index, np.arange(joints)])
        last[ever] = positions[index[ever], ever]
        when[ever] = stamps[index[ever]]
    return last, when
