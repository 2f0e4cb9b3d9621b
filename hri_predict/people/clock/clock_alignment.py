"""Aligns a source's stamps with the node's clock.

Only the source has the time of a capture, on its own clock; only the node has the time of receipt.
One difference is known for every scene: receipt - stamp = offset between the clocks + latency of
this scene. Latency is never negative, so the smallest difference is the best estimate of the offset
(the filter of NTP and of Cristian's algorithm). The minimum latency cannot be measured from one
side, so it is a setting (``min_latency_s``). Four effects look alike in that difference and must be
distinguished:

- *Delay*: scenes start to arrive later, suddenly or gradually. It must appear as age, however long
  it lasts.
- *Drift*: the clocks run at slightly different rates. ``OffsetLine`` follows it, within the limits
  of real clocks.
- *Jump*: the stamp's step disagrees, by more than ``jump_limit_ns``, both with the sequence's step
  times the nominal period (not a delay: a late scene has a true stamp) and with the receipt's step
  (not a pause: a source that pauses resumes with stamps and receipts advanced alike). The capture
  is then extrapolated, and the line is moved to it. If the sequence does not confirm a backward
  jump (the source paused or restarted, or many scenes are missing), it may as well be a delay, and
  is treated as one up to ``SAME_CLOCK_NS``.
- *Spike*: wrong stamps for a short time. Beyond the limit they are jumps; the previous line is kept
  for ``TRIAL_NS``, and stamps that fit it again are accepted. Below the limit, stamps that are too
  new shift the captures into the past, but not the line: after two buckets they have no effect. A
  stamp that is too new by more than ``SPIKE_NS`` is ignored unless ``SPIKE_CONFIRMATIONS`` scenes
  within ``SPIKE_WITHIN_NS`` confirm it.

Backward steps of a clock below the limit count as delay, and so does a clock that stops while its
source sleeps. All errors make the age larger, never smaller, with these exceptions:

- A delay that exists since the first scene, or since the scene of a jump, counts as offset. No
  one-way alignment can detect it. A delay of the scene before a jump is carried across it
  permanently: on the new clock, an ended and a continuing delay look the same.
- A delay that grows no faster than the clock may drift: from the first half hour on by
  ``MAX_WANDER``, and by ``wander_ns`` in all; before, by ``MAX_DRIFT`` at most.
"""

from collections import deque
from dataclasses import dataclass

from hri_predict.people.clock.offset_line import LOCK_NS, WANDER_NS, OffsetLine

NS_PER_S = 1_000_000_000
BUCKET_NS = 5 * NS_PER_S
"""Length of a bucket. The minimum is taken over the current and the previous bucket: 5 to 10 s."""
SPIKE_NS = 20_000_000
SPIKE_CONFIRMATIONS = 3
SPIKE_WITHIN_NS = 2 * NS_PER_S
MIN_JUMP_NS = 100_000_000
"""ntpd slews offsets below 128 ms, and steps larger ones (STEPT, RFC 5905, section 11.1)."""
JUMPED_SCENES = 10
TRIAL_NS = 10 * NS_PER_S
"""Time for which the line from before a jump is kept."""
SAME_CLOCK_NS = 10 * NS_PER_S
"""Maximum delay after a restart at which the source's clock is assumed unchanged."""


@dataclass(frozen=True, slots=True)
class ClockEstimate:
    """The estimate of a source's clock, for display only.

    Attributes:
        offset_ns: current estimate of capture (node's clock) minus stamp (source's clock).
        drift_ppm: rate by which the source's clock runs fast; ``None`` before three buckets are
            full.
        jumps: jumps seen since start, including restarts.
        spikes: stamps that were too new.
        rise_ns: rise of the offset since the first scene, attributed to drift rather than to delay.
            Negative if the source's clock runs fast.
        wandered_ns: part of it beyond the steady drift.
        late_ns: delay of even the fastest scenes of the last seconds.
    """

    offset_ns: int
    drift_ppm: float | None
    jumps: int
    spikes: int
    rise_ns: int = 0
    wandered_ns: int = 0
    late_ns: int = 0


@dataclass(frozen=True, slots=True)
class _Step:
    """Time from one scene to the next, according to the stamp, the sequence and the receipt."""

    stamp_ns: int
    scenes: int
    receipt_ns: int


@dataclass(frozen=True, slots=True)
class _Last:
    """The previous scene."""

    stamp_ns: int
    sequence: int
    receipt_ns: int
    capture_ns: int

    def step_to(self, stamp_ns: int, sequence: int, receipt_ns: int) -> _Step:
        return _Step(
            stamp_ns - self.stamp_ns, sequence - self.sequence, receipt_ns - self.receipt_ns
        )


class _Window:
    """The smallest difference of the last 5 to 10 s, relative to the line."""

    def __init__(self, above_ns: int, now_ns: int) -> None:
        self._start_ns = now_ns
        self._lowest = self._previous = above_ns

    @property
    def lowest(self) -> int:
        return min(self._lowest, self._previous)

    def shift(self, by_ns: int) -> None:
        self._lowest += by_ns
        self._previous += by_ns

    def add(self, above_ns: int, now_ns: int) -> int | None:
        """Add a difference; if it starts a new bucket, return the lowest of the previous bucket."""
        in_bucket_ns = now_ns - self._start_ns
        if in_bucket_ns < BUCKET_NS:
            self._lowest = min(self._lowest, above_ns)
            return None
        full, self._start_ns = self._lowest, now_ns
        self._previous = full if in_bucket_ns < 2 * BUCKET_NS else above_ns
        self._lowest = above_ns
        return full


class ClockAlignment:
    """Converts stamps of a source to capture times on the node's clock.

    Args:
        period_ns: the source's nominal time between captures.
        min_latency_ns: minimum time from capture to receipt.
        jump_limit_ns: maximum deviation of a stamp; default: the longer of 0.1 s and 3 periods.
        wander_ns: maximum rise of the offset beyond the clock's steady drift.

    Attributes:
        jumps: jumps seen since start, restarts among them.
        spikes: scenes with a stamp ahead of the estimated offset by more than ``SPIKE_NS``.
    """

    def __init__(
        self,
        period_ns: int,
        min_latency_ns: int = 0,
        jump_limit_ns: int | None = None,
        wander_ns: int = WANDER_NS,
    ) -> None:
        if period_ns <= 0 or min_latency_ns < 0:
            raise ValueError("period_ns must be positive, min_latency_ns at least 0")
        self.jumps = 0
        self.spikes = 0
        self._period_ns = period_ns
        self._min_latency_ns = min_latency_ns
        self._jump_limit_ns = jump_limit_ns or max(MIN_JUMP_NS, 3 * period_ns)
        self._wander_ns = wander_ns
        self._last: _Last | None = None
        self._restarted = False
        self._offset_ns = 0
        self._scenes_since_jump = JUMPED_SCENES
        self._suspects: deque[tuple[int, int]] = deque(maxlen=SPIKE_CONFIRMATIONS)
        self._line: OffsetLine | None = None
        self._window = _Window(0, 0)
        self._back_ns: int | None = None  # from the line to that before a jump, during the trial
        self._jump_ns = 0

    @property
    def offset_ns(self) -> int:
        """Current estimate of capture (node's clock) minus stamp (source's clock)."""
        return self._offset_ns

    def estimate(self) -> ClockEstimate | None:
        """Return the current estimate of the source's clock; ``None`` before the first scene."""
        line = self._line
        if line is None:
            return None
        slope = line.slope
        return ClockEstimate(
            offset_ns=self._offset_ns,
            drift_ppm=None if slope is None else -slope * 1e6,
            jumps=self.jumps,
            spikes=self.spikes,
            rise_ns=line.rise_ns,
            wandered_ns=line.wandered_ns,
            late_ns=max(0, self._window.lowest),
        )

    @property
    def jumped(self) -> bool:
        """Whether the source's clock jumped within the last ``JUMPED_SCENES`` scenes."""
        return self._scenes_since_jump < JUMPED_SCENES

    @property
    def late(self) -> bool:
        """Whether all scenes of the last seconds were later than drift can explain."""
        return self._window.lowest > LOCK_NS

    def restart(self) -> None:
        """Handle a restart of the source, perhaps with another clock. This counts as a jump."""
        self._restarted = True
        self._note_jump()

    def align(self, stamp_ns: int, sequence: int, receipt_ns: int) -> int:
        """Return the scene's capture time on the node's clock, at most receipt - min latency.

        Args:
            stamp_ns: the scene's stamp, the source's clock.
            sequence: the source's counter; the caller passes only scenes that advance it.
            receipt_ns: time of receipt, node's clock.
        """
        newest_possible = receipt_ns - self._min_latency_ns
        seen_ns = newest_possible - stamp_ns
        self._scenes_since_jump += 1
        if self._line is None or self._last is None:
            line = self._line = OffsetLine(seen_ns, receipt_ns, self._wander_ns)
            self._window = _Window(0, receipt_ns)
        else:
            line, step = self._line, self._last.step_to(stamp_ns, sequence, receipt_ns)
            above_ns = seen_ns - line.at(receipt_ns)
            if self._back_ns is not None and abs(above_ns - self._back_ns) <= LOCK_NS:
                self._move(line, self._back_ns, receipt_ns)
                self._back_ns = None
            elif self._is_jump(step, above_ns):
                carried = min(self._last.capture_ns + self._carried_ns(step), newest_possible)
                by_ns = carried - stamp_ns - line.at(receipt_ns)
                self._move(line, by_ns, receipt_ns)
                self._back_ns = (self._back_ns or 0) - by_ns
            self._follow(line, seen_ns - line.at(receipt_ns), receipt_ns)
        self._restarted = False
        self._offset_ns = line.at(receipt_ns) + min(0, self._window.lowest)
        capture_ns = min(stamp_ns + self._offset_ns, newest_possible)
        self._last = _Last(stamp_ns, sequence, receipt_ns, capture_ns)
        return capture_ns

    def _is_jump(self, step: _Step, above_ns: int) -> bool:
        """Return whether the source's clock jumped, at a scene ``above_ns`` above the line."""
        if abs(above_ns) <= LOCK_NS:
            return False
        expected_ns = step.scenes * self._period_ns
        vouched = step.stamp_ns - expected_ns < -max(self._jump_limit_ns, expected_ns)
        if 0 < above_ns <= SAME_CLOCK_NS and (self._restarted or not vouched):
            return False
        if self._restarted:
            return True
        deviations = step.stamp_ns - expected_ns, step.stamp_ns - step.receipt_ns
        return min(abs(deviation) for deviation in deviations) > self._jump_limit_ns

    def _carried_ns(self, step: _Step) -> int:
        """Return the time from the last scene to a scene with a rejected stamp.

        The sequence gives this time, unless the source paused or restarted; then the receipt is
        more reliable. A capture that is too new is corrected by the next scene with less latency.
        """
        expected_ns = step.scenes * self._period_ns
        if 0 < expected_ns <= self._jump_limit_ns:
            return max(expected_ns, step.receipt_ns)
        return step.receipt_ns

    def _note_jump(self) -> None:
        self.jumps += 1
        self._scenes_since_jump = 0

    def _move(self, line: OffsetLine, by_ns: int, receipt_ns: int) -> None:
        """Handle a jump of the source's clock: move the line, and forget earlier differences."""
        if not self._restarted:  # that was counted
            self._note_jump()
        line.shift(by_ns)
        self._window = _Window(0, receipt_ns)
        self._jump_ns = receipt_ns
        self._suspects.clear()

    def _follow(self, line: OffsetLine, above_ns: int, receipt_ns: int) -> None:
        """Add one difference, ``above_ns`` above the line."""
        if above_ns < min(0, self._window.lowest) - SPIKE_NS:
            self.spikes += 1
            self._suspects.append((receipt_ns, above_ns))
            if (
                len(self._suspects) < SPIKE_CONFIRMATIONS
                or receipt_ns - self._suspects[0][0] > SPIKE_WITHIN_NS
            ):
                return
            above_ns = max(above_ns for _, above_ns in self._suspects)
            self._suspects.clear()
        if self._back_ns is not None and receipt_ns - self._jump_ns >= TRIAL_NS:
            self._back_ns = None
        lowest_ns = self._window.add(above_ns, receipt_ns)
        if lowest_ns is not None and self._back_ns is None:
            self._window.shift(-line.follow(lowest_ns, receipt_ns))
