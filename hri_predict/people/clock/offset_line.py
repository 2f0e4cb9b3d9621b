"""The estimated offset between a source's clock and the node's clock: a line over time.

From one side, a slow clock and a growing delay look alike: both raise the difference receipt -
stamp. They are distinguished by the behaviour of clocks. A quartz has a constant rate error of 50
ppm or less; two of them differ by up to 100 ppm. Temperature changes this by less than 1 ppm per
degree, so by a few ppm over a shift. ntpd, which disciplines a clock, assumes an error of 15 ppm
for a quartz (PHI in RFC 5905, section 7.2), and corrects at most 500 ppm (MAXFREQ), which only
broken clocks need. Therefore:

- The line never rises by more than ``MAX_DRIFT``.
- In the first ``LEARNING_NS`` of scenes it learns the steady drift, with a bound on its rise that
  tightens over time. From then on it rises by that drift, plus at most ``MAX_WANDER``, up to
  ``wander_ns`` in total.
- It follows only differences within ``LOCK_NS`` above it. If all scenes are later than that, they
  are delayed: clocks do not leap, so the line does not learn from them, however long this lasts. It
  then falls as fast as the clock may run.
- Without scenes it keeps the learnt drift for ``HOLD_NS``, and stops rising after that. Before the
  drift is learnt it does not rise without scenes, and afterwards follows slightly higher
  differences (``_unsure_ns``).

It falls whenever scenes arrive faster: this is evidence, not an assumption.
"""

from dataclasses import dataclass

S = 1_000_000_000
MAX_DRIFT = 200e-6
"""Twice the difference of two 50 ppm crystals: a margin for ageing and cold."""
LOCK_NS = 20_000_000
"""Height above the line beyond which a stamp is late."""
LEARNING_NS = 30 * 60 * S
MAX_WANDER = LOCK_NS / LEARNING_NS
"""11 ppm: possible error of the learnt drift, plus the effect of temperature."""
HOLD_NS = 2 * 3600 * S
YOUNG_NS = 10 * S
WANDER_NS = 100_000_000
BUCKETS = 12
"""Number of minima kept: one minute of a steady source."""
AGREEING = 4
"""Minimum number of buckets that must agree before the line is lowered. A stamp fault shorter than
two buckets affects at most three of them.
"""
MIN_SAMPLES = 3


@dataclass(slots=True)
class _Slope:
    """A straight line by least squares, one point after the other."""

    count: int = 0
    t: float = 0.0
    y: float = 0.0
    tt: float = 0.0
    ty: float = 0.0

    def add(self, t: float, y: float) -> None:
        self.count += 1
        self.t += t
        self.y += y
        self.tt += t * t
        self.ty += t * y

    def value(self) -> float | None:
        """The slope; ``None`` before ``MIN_SAMPLES`` points of different times."""
        spread = self.count * self.tt - self.t * self.t
        if self.count < MIN_SAMPLES or spread <= 0:
            return None
        return (self.count * self.ty - self.t * self.y) / spread


class OffsetLine:
    """See this module. Times are the node's, in nanoseconds.

    Args:
        offset_ns: capture (node's clock) minus stamp (source's clock), from the first scene.
        now_ns: time of its receipt.
        wander_ns: maximum total rise beyond the steady drift, once the drift is learnt.

    Attributes:
        rise_ns: rise of the offset since the first scene, without jumps: the estimated drift.
            Negative if the source's clock runs fast.
        wandered_ns: part of ``wander_ns`` that is used up.
    """

    def __init__(self, offset_ns: int, now_ns: int, wander_ns: int = WANDER_NS) -> None:
        self.rise_ns = 0
        self.wandered_ns = 0
        self._wander_ns = wander_ns
        self._offset_ns = offset_ns
        self._now_ns = self._start_ns = self._bucket_ns = self._locked_ns = now_ns
        self._lowest: list[int] = []  # of the last buckets, above the line
        self._slope = _Slope()
        self._learnt_ns = 0  # how long, from the first bucket to the last one that was followed
        self._rate: float | None = None

    @property
    def slope(self) -> float | None:
        """The drift learnt so far, as rise per time; ``None`` before three buckets."""
        return self._rate if self._rate is not None else self._slope.value()

    def at(self, now_ns: int) -> int:
        """Return the estimated offset at ``now_ns``."""
        if self._rate is None:
            return self._offset_ns + round(self._young() * max(0, now_ns - self._now_ns))
        held_ns = max(0, min(now_ns, self._locked_ns + HOLD_NS) - self._now_ns)
        beyond_ns = max(0, now_ns - self._now_ns - held_ns)
        return self._offset_ns + round(self._rate * held_ns + min(0.0, self._rate) * beyond_ns)

    def shift(self, by_ns: int) -> None:
        """Handle a jump of the source's clock; its rate is still known."""
        self._offset_ns += by_ns

    def follow(self, lowest_ns: int, now_ns: int) -> int:
        """Add the lowest difference of a bucket that ends at ``now_ns``.

        ``lowest_ns`` is relative to the line. Return the shift of the line.
        """
        line_ns = self.at(now_ns)
        self.rise_ns += line_ns - self._offset_ns
        self._offset_ns, self._now_ns = line_ns, now_ns
        elapsed_ns, self._bucket_ns = now_ns - self._bucket_ns, now_ns
        if elapsed_ns > YOUNG_NS:  # after a pause, what came before says little
            self._lowest = []
        self._lowest = [*self._lowest, lowest_ns][-BUCKETS:]
        agreed = len(self._lowest) >= AGREEING
        floor_ns = sorted(self._lowest)[AGREEING - 1] if agreed else max(0, *self._lowest)
        unsure_ns = self._unsure_ns()
        locked = floor_ns <= LOCK_NS + unsure_ns
        if locked:
            step_ns = min(floor_ns, self._may_rise_ns(elapsed_ns) + unsure_ns)
        else:
            step_ns = -self._may_fall_ns(min(elapsed_ns, YOUNG_NS))
        self._correct(step_ns, -round(2 * MAX_DRIFT * elapsed_ns))
        if locked:
            self._locked_ns = now_ns
            if agreed and self._rate is None:
                self._learn(lowest_ns - step_ns)
        return step_ns

    def _young(self) -> float:
        """Let the line run by itself before the drift is learnt: it may fall, but not rise."""
        return max(-MAX_DRIFT, min(0.0, self._slope.value() or 0.0))

    def _unsure_ns(self) -> int:
        """Possible error of the line after a pause, before the drift is learnt."""
        alone_ns = self._now_ns - self._locked_ns
        if self._rate is not None or alone_ns <= YOUNG_NS:
            return 0
        least, greatest = self._between()
        return min(round((greatest - least) * alone_ns), self._wander_ns)

    def _between(self) -> tuple[float, float]:
        """Return the minimum and maximum drift consistent with the data so far."""
        slope = self.slope
        if slope is None:
            return -MAX_DRIFT, MAX_DRIFT
        slope, unsure = min(max(slope, -MAX_DRIFT), MAX_DRIFT), LOCK_NS / max(1, self._learnt_ns)
        return max(slope - unsure, -MAX_DRIFT), min(slope + unsure, MAX_DRIFT)

    def _may_rise_ns(self, elapsed_ns: int) -> int:
        """Return the maximum rise of the line beyond its own slope."""
        if self._rate is None:
            return round((self._between()[1] - self._young()) * elapsed_ns)
        left_ns = self._wander_ns - self.wandered_ns
        return max(0, min(round(MAX_WANDER * elapsed_ns), left_ns))

    def _may_fall_ns(self, elapsed_ns: int) -> int:
        """Return the maximum undetected gain of the clock while all scenes were late."""
        if self._rate is None:
            return round(max(0.0, self._young() - self._between()[0]) * elapsed_ns)
        alone = self._now_ns - self._locked_ns > HOLD_NS
        return round(MAX_WANDER * elapsed_ns) if alone else 0

    def _correct(self, step_ns: int, drift_ns: int) -> None:
        """Move the line by ``step_ns``; a fall beyond ``drift_ns`` was due to delay, not drift."""
        self._offset_ns += step_ns
        self._lowest = [lowest - step_ns for lowest in self._lowest]
        self.rise_ns += max(step_ns, drift_ns)
        if self._rate is not None:
            self.wandered_ns = max(0, self.wandered_ns + step_ns)

    def _learn(self, above_ns: int) -> None:
        """Update the drift from a bucket's lowest difference, ``above_ns`` above the line."""
        if abs(above_ns) > LOCK_NS:
            return
        self._learnt_ns = self._now_ns - self._start_ns
        self._slope.add(self._learnt_ns / S, (self.rise_ns + above_ns) / S)
        slope = self._slope.value()
        if slope is not None and self._learnt_ns >= LEARNING_NS:
            self._rate = min(max(slope, -MAX_DRIFT), MAX_DRIFT)
