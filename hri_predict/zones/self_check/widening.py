"""Adaptive widening: factors on calibrated radii that follow the recent rate of misses.

This is adaptive conformal inference (I. Gibbs, E. Candès, "Adaptive Conformal Inference Under
Distribution Shift", NeurIPS 2021, arXiv:2106.00263, eq. 2: alpha' = alpha + gamma (alpha - err)),
applied to the logarithm w of a factor on the calibrated radii, not to alpha. Radii can thus exceed
the largest error of the calibration. With w >= 0, radii are only widened.

Each person has a state for each band of horizons. Each new capture, ``dt`` seconds after the last,
judges all kept forecasts with an age in the band. With alpha = 1 - level and

    err_f   mean over those forecasts of: some joint is farther off than f times its calibrated
            radius (``of="joint"``: the share of joints that are),

    m       <- m + (err_1 - m) (1 - exp(-dt / tau)),    tau = recover_s / ln(1 / alpha)
    w       <- clip(w + growth_per_s dt (err_e^w - alpha), 0, ln max_factor)  if m > alpha, else 0
    lent    <- min(lent exp(-dt / end of the band) + rise, the largest w of a shorter band); rise is
            the largest by which a shorter band's w rose at this capture

    factor  = exp(max(w, lent))

``m`` is the running miss rate of the radii as calibrated. Judgements of neighbouring captures
overlap, so steps are proportional to time, not to the number of captures: the duration of misses
matters. The factor in force *now* decides which misses move w, not the factor when the forecast was
made: a forecast of 1 s can be judged only 1 s later, and a second of misses that are already
corrected would drive the factor to its bound. During that second the short horizons *lend* their
widening to the long horizons; after it the long horizons have their own judgements.

- Reaction: with every forecast of a band missing by a factor F, m passes alpha after tau ln(1 /
  level) and w passes ln F within ln(F) / (growth_per_s level) after that. At level 0.99 with the
  defaults that is 0.01 s and, for F = 2, 0.18 s; at 0.9 it is 0.23 s and 0.19 s. The time starts
  with the first judgement: one capture after a change for the shortest band, whose factor is lent
  to longer bands; for errors only at a long horizon, after that horizon.
- While m > alpha and below the bound, w grows by at least the sum of its steps, so over T seconds
  the share of misses is at most alpha + ln(max_factor) / (growth_per_s T), no matter what people do
  (Gibbs and Candès, prop. 4.1, in this form). This holds for the factor in force at the judgement;
  for the factor when the forecast was made, nothing is guaranteed, and the report of ``self_check``
  counts its misses.
- Return: the worst state (m = 1) ends after recover_s in which the *calibrated* radii would have
  held (err_1 = 0): m then falls to alpha. While they would not have held, widening remains.
"""

import math

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints


class AdaptiveWidening:
    """The factors of a fixed number of people.

    Args:
        people: S, slots for people.
        ends_s: (B,) upper end of each band of horizons, seconds ahead, ascending.
        level: level of the calibrated radii, 0 < level < 1.
        growth_per_s: growth of w in a second in which every forecast misses.
        recover_s: time of good coverage after which radii are no longer widened.
        max_factor: maximum factor.

    Raises:
        ValueError: the level is out of range.
    """

    def __init__(
        self,
        *,
        people: int,
        ends_s: Floats,
        level: float,
        growth_per_s: float,
        recover_s: float,
        max_factor: float,
    ) -> None:
        if not 0 < level < 1:
            raise ValueError("level must be above 0 and below 1")
        self._ends_s = ends_s
        self._alpha = 1.0 - level
        self._growth_per_s = growth_per_s
        self._tau_s = recover_s / math.log(1.0 / self._alpha)
        self._bound = math.log(max_factor)
        self._log: Floats = np.zeros((people, len(ends_s)))  # w
        self._missed: Floats = np.zeros((people, len(ends_s)))  # m
        self._lent: Floats = np.zeros((people, len(ends_s)))

    def forget(self, slot: int) -> None:
        """Forget everything about the person in a slot."""
        self._log[slot] = self._missed[slot] = self._lent[slot] = 0.0

    def own(self, slots: Ints) -> Floats:
        """Return (Q, B) each band's own factor e^w; ``update`` needs the misses with this
        factor."""
        factor: Floats = np.exp(self._log[slots])
        return factor

    def factor(self, slots: Ints) -> Floats:
        """Return (Q, B) factors on the radii, from 1 to ``max_factor``."""
        factor: Floats = np.exp(np.maximum(self._log[slots], self._lent[slots]))
        return factor

    def update(self, slots: Ints, dt: Floats, *, judged: Bools, bare: Floats, now: Floats) -> Bools:
        """Update the factors with one capture of Q people.

        Args:
            slots: (Q,) slots of these people.
            dt: (Q,) seconds since their last capture.
            judged: (Q, B) whether any forecast was judged; otherwise the band does not change.
            bare: (Q, B) err_1, misses of the calibrated radii.
            now: (Q, B) err_e^w, misses of the bands' own factors.

        Returns:
            (Q,) whether a factor is at its bound and forecasts still miss.
        """
        step, log, missed = dt[:, None], self._log[slots], self._missed[slots]
        part = 1.0 - np.exp(-step / self._tau_s)
        missed = np.where(judged, missed + (bare - missed) * part, missed)
        moved = log + self._growth_per_s * step * (now - self._alpha)
        moved = np.minimum(np.maximum(moved, 0.0), self._bound)
        moved = np.where(judged, np.where(missed > self._alpha, moved, 0.0), log)
        self._lend(slots, step, moved - log, moved)
        self._missed[slots], self._log[slots] = missed, moved
        stuck = judged & (moved >= self._bound - 1e-9) & (now > self._alpha)
        return np.asarray(stuck.any(1))

    def _lend(self, slots: Ints, step: Floats, rise: Floats, log: Floats) -> None:
        """Lend the widening learned by shorter bands, until a band has its own judgements."""
        rise = np.maximum.accumulate(np.maximum(rise, 0.0), axis=1)
        widest = np.maximum.accumulate(log, axis=1)
        lent = self._lent[slots] * np.exp(-step / self._ends_s)
        lent[:, 0] = 0.0
        lent[:, 1:] = np.minimum(lent[:, 1:] + rise[:, :-1], widest[:, :-1])
        self._lent[slots] = lent
