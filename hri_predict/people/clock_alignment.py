"""Aligns a source's stamps with the node's clock.

Only the source knows the time of a capture, and only on its own clock; only the node knows the time
of receipt. One difference is known for every scene: receipt - stamp = offset between the clocks +
latency of this scene. Latency is never negative, so the smallest difference is the best estimate of
the offset (the filter of NTP and of Cristian's algorithm). The smallest latency cannot be measured
from one side, so it is a setting (``min_latency_s``). Four things look alike in that difference and
must be distinguished:

- *Delay*: scenes begin to arrive later. Must appear as age. The offset therefore rises by at most
  ``MAX_DRIFT``, so that an added delay of 200 ms takes minutes, not seconds, to be taken for drift.
- *Drift*: the clocks run at slightly different rates. Followed downwards at once and upwards up to
  ``MAX_DRIFT``; a clock that is slower still looks like growing delay, and becomes stale.
- *Jump*: the stamp's step disagrees, by more than ``jump_limit_ns``, both with the sequence's step
  times the nominal period (not a delay: a late scene has a true stamp) and with the receipt's step
  (not a pause: a source that pauses resumes with stamps and receipts advanced alike). The capture
  is then extrapolated by the sequence, or by the receipt if that gives a newer one: after a pause
  the sequence falls short. The next scene of less latency corrects a capture that is too new, but a
  capture that is too old would stay so for minutes. The offset is re-estimated from there.
- *Spike*: a single wrong stamp. Beyond the limit it is a jump and a jump back, and carrying across
  both restores the offset. Below it, a stamp that is too new would pull the minimum down, so a fall
  of more than ``SPIKE_NS`` is believed only once ``SPIKE_CONFIRMATIONS`` scenes within
  ``SPIKE_WITHIN_NS`` agree.

Backward steps of a clock that are smaller than the limit count as delay: the age is then too large,
by less than the limit, until drift has caught up. The same holds for a clock that stands still
while its source sleeps: it looks like scenes that are late by that time, and the input stays stale
until the source starts again (its sequence restarts). All remaining errors make the age larger,
never smaller, with one exception: a delay that exists since the first scene, or since the scene of
a jump, counts as offset. No one-way alignment can detect it.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

NS_PER_S = 1_000_000_000
MAX_DRIFT_PER_MILLION = 1000
"""Greatest believed rise of the offset; crystals stay under 100, slewed system clocks under 500."""
BUCKET_NS = 5 * NS_PER_S
"""The minimum is taken over the current and the previous bucket: 5 to 10 s."""
SPIKE_NS = 20_000_000
SPIKE_CONFIRMATIONS = 3
SPIKE_WITHIN_NS = 2 * NS_PER_S
MIN_JUMP_NS = 100_000_000
JUMPED_SCENES = 10
DRIFT_BUCKETS = 24
"""Drift is the slope of the minima of this many buckets: two minutes of a steady source."""
MIN_DRIFT_BUCKETS = 3


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """The estimate of a source's clock, for display only.

    Attributes:
        offset_ns: capture (node's clock) minus stamp (source's clock), as believed now.
        drift_ppm: by how much the source's clock runs fast; ``None`` before three buckets are full.
        jumps: jumps seen since start, restarts among them.
        spikes: stamps that were too new.
    """

    offset_ns: int
    drift_ppm: float | None
    jumps: int
    spikes: int


class ClockAlignment:
    """Turns stamps of a source into capture times of the node's clock.

    Args:
        period_ns: the source's nominal time between captures.
        min_latency_ns: least time from capture to receipt.
        jump_limit_ns: greatest deviation of a stamp; default: the longer of 0.1 s and 3 periods.

    Attributes:
        jumps: jumps seen since start, restarts among them.
        spikes: scenes whose stamp was ahead of the believed offset by more than ``SPIKE_NS``.
    """

    def __init__(
        self, period_ns: int, min_latency_ns: int = 0, jump_limit_ns: int | None = None
    ) -> None:
        if period_ns <= 0 or min_latency_ns < 0:
            raise ValueError("period_ns must be positive, min_latency_ns at least 0")
        self.jumps = 0
        self.spikes = 0
        self._period_ns = period_ns
        self._min_latency_ns = min_latency_ns
        self._jump_limit_ns = jump_limit_ns or max(MIN_JUMP_NS, 3 * period_ns)
        self._last: tuple[int, int, int, int] | None = None  # stamp, sequence, receipt, capture
        self._offset_ns = 0
        self._scenes_since_jump = JUMPED_SCENES
        self._suspects: deque[tuple[int, int]] = deque(maxlen=SPIKE_CONFIRMATIONS)
        self._bucket_start_ns = 0
        self._lowest = 0
        self._previous_lowest = 0
        self._lowest_at_ns = 0
        self._minima: deque[tuple[int, int]] = deque(maxlen=DRIFT_BUCKETS)  # receipt, seen
        self._drift_ppm: float | None = None

    @property
    def offset_ns(self) -> int:
        """Capture (node's clock) minus stamp (source's clock), as believed now."""
        return self._offset_ns

    def estimate(self) -> ClockEstimate | None:
        """Return the present estimate of the source's clock; ``None`` before the first scene."""
        if self._last is None and not self.jumps:
            return None
        return ClockEstimate(self._offset_ns, self._drift_ppm, self.jumps, self.spikes)

    @property
    def jumped(self) -> bool:
        """Whether the source's clock jumped within the last ``JUMPED_SCENES`` scenes."""
        return self._scenes_since_jump < JUMPED_SCENES

    def restart(self) -> None:
        """Forget everything, because the source restarted. This counts as a jump."""
        self._last = None
        self._note_jump()

    def align(self, stamp_ns: int, sequence: int, receipt_ns: int) -> int:
        """Return the scene's capture time on the node's clock, at most receipt - min latency.

        Args:
            stamp_ns: the scene's stamp, the source's clock.
            sequence: the source's counter; the caller passes only scenes that advance it.
            receipt_ns: when it arrived, the node's clock.
        """
        newest_possible = receipt_ns - self._min_latency_ns
        self._scenes_since_jump += 1
        if self._last is None:
            self._set_offset(newest_possible - stamp_ns, receipt_ns)
        elif self._is_jump(stamp_ns, sequence, receipt_ns):
            self._note_jump()
            _, last_sequence, last_receipt_ns, last_capture_ns = self._last
            by_sequence = last_capture_ns + (sequence - last_sequence) * self._period_ns
            by_receipt = last_capture_ns + (receipt_ns - last_receipt_ns)
            carried = min(max(by_sequence, by_receipt), newest_possible)
            self._set_offset(carried - stamp_ns, receipt_ns)
        else:
            self._follow(newest_possible - stamp_ns, receipt_ns)
        capture_ns = min(stamp_ns + self._offset_ns, newest_possible)
        self._last = (stamp_ns, sequence, receipt_ns, capture_ns)
        return capture_ns

    def _is_jump(self, stamp_ns: int, sequence: int, receipt_ns: int) -> bool:
        assert self._last is not None
        stamp_step = stamp_ns - self._last[0]
        by_sequence = stamp_step - (sequence - self._last[1]) * self._period_ns
        by_receipt = stamp_step - (receipt_ns - self._last[2])
        return min(abs(by_sequence), abs(by_receipt)) > self._jump_limit_ns

    def _note_jump(self) -> None:
        self.jumps += 1
        self._scenes_since_jump = 0

    def _set_offset(self, offset_ns: int, receipt_ns: int) -> None:
        self._offset_ns = self._lowest = self._previous_lowest = offset_ns
        self._bucket_start_ns = self._lowest_at_ns = receipt_ns
        self._suspects.clear()
        self._minima.clear()
        self._drift_ppm = None

    def _follow(self, seen_ns: int, receipt_ns: int) -> None:
        """Take one more difference, ``seen_ns`` = receipt - min latency - stamp, into account."""
        assert self._last is not None
        if seen_ns < self._offset_ns - SPIKE_NS:
            self.spikes += 1
            self._suspects.append((receipt_ns, seen_ns))
            if (
                len(self._suspects) == SPIKE_CONFIRMATIONS
                and receipt_ns - self._suspects[0][0] <= SPIKE_WITHIN_NS
            ):
                self._set_offset(max(seen for _, seen in self._suspects), receipt_ns)
            return
        in_bucket_ns = receipt_ns - self._bucket_start_ns
        if in_bucket_ns >= BUCKET_NS:
            self._minima.append((self._lowest_at_ns, self._lowest))
            self._drift_ppm = self._slope_ppm()
            self._previous_lowest = self._lowest if in_bucket_ns < 2 * BUCKET_NS else seen_ns
            self._bucket_start_ns = receipt_ns
        if in_bucket_ns >= BUCKET_NS or seen_ns < self._lowest:
            self._lowest, self._lowest_at_ns = seen_ns, receipt_ns
        elapsed_ns = max(0, receipt_ns - self._last[2])
        may_rise_to = self._offset_ns + elapsed_ns * MAX_DRIFT_PER_MILLION // 1_000_000
        self._offset_ns = min(self._lowest, self._previous_lowest, may_rise_to)

    def _slope_ppm(self) -> float | None:
        """Slope of the buckets' minima, by least squares, since the last jump."""
        if len(self._minima) < MIN_DRIFT_BUCKETS:
            return None
        first_at_ns, first_ns = self._minima[0]
        seconds = np.array([(at_ns - first_at_ns) * 1e-9 for at_ns, _ in self._minima])
        seen_us = np.array([(seen_ns - first_ns) * 1e-3 for _, seen_ns in self._minima])
        seconds -= seconds.mean()
        return -float(seconds @ seen_us / (seconds @ seconds))
