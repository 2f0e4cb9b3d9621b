"""Drift: check, over minutes, that forecasts hold as often as their calibration states.

The self-check widens the zones of one person within a second, and narrows them again. Drift
concerns all people and longer times: another tracker, other people, other work, or an unsuitable
calibration. It does not change zones; it reports that this site needs a new calibration.

**Blocks.** Forecasts overlap: one capture judges 30 forecasts of a person, and errors persist, so
judgements are not independent. A *block* is ``BLOCK_S`` of captures with a judged person. It gives
one number y from 0 to 1: the share of its judgements, over all people and horizons, that missed the
radii *as calibrated*. Blocks are ten times as long as a forecast.

**Test.** At a stated level l, the acceptable share of misses is up to m0 = min(2 (1 - l), (1 - l) +
0.03). With lambda = min(4, 1 / (5 m0)), each block multiplies the evidence by

    1 + lambda (y - m0)

The mean of this factor is at most 1 while the expected y, given all earlier blocks, is at most m0:
an e-process (I. Waudby-Smith, A. Ramdas, "Estimating means of bounded random variables by betting",
JRSS B 86 (2024) 1). The distribution of y does not matter. The evidence never falls below 1, so
that a good week does not hide a bad day (CUSUM of e-values; J. Shin, A. Ramdas, A. Rinaldo,
"E-detectors", NEJSDS 2023): at the acceptable share, the mean time to a false alarm is at least
``EVIDENCE`` blocks (280 h of people), and at the stated share it is much longer.

- *Raised* when the evidence reaches ``EVIDENCE``. At a stated 99 %, this takes 2 minutes of people
  if half of the forecasts miss, 7 minutes if a tenth do, and 17 minutes if a twentieth do.
- *Cleared* when the evidence has returned to 1: after at least 23 minutes of people without a miss,
  or 47 minutes in which 99 % hold. The state does not flap, because each change requires the full
  range of evidence.

An alarm caused by one person who is hard to predict for a long time is not a false alarm: the
stated level does not hold here.
"""

import logging
import math
from typing import Any

log = logging.getLogger(__name__)

BLOCK_S = 10.0
EVIDENCE = 1e5
SAID_EVERY_S = 3600.0
"""Interval at which the log repeats the warning while drift lasts."""
_MAX_DT_S = 0.1
_MARGIN = 0.03
_MOST_LAMBDA = 4.0


class Drift:
    """The evidence against a calibration; one per run, deterministic.

    Args:
        level: level of the calibrated radii, 0 < level < 1.
    """

    def __init__(self, level: float) -> None:
        self._level = level
        stated = 1.0 - level
        self._bearable = min(2.0 * stated, stated + _MARGIN)
        self._lambda = min(_MOST_LAMBDA, 0.2 / self._bearable)
        self._evidence = 0.0  # its logarithm
        self._raised = 0
        self._blocks, self._misses = 0, 0.0  # since the evidence left 1
        self._judged_s = self._judged = self._missed = 0.0
        self._before_ns: int | None = None
        self._said_ns = 0
        self.drifting = False

    def add(self, now_ns: int, missed: float, judged: float) -> None:
        """Add the judgements of one tick.

        Args:
            now_ns: time of the tick.
            missed: number of misses of the calibrated radii; part of a body counts as a fraction.
            judged: number of judgements.
        """
        if judged <= 0:
            return
        before = now_ns if self._before_ns is None else self._before_ns
        self._judged_s += min(max((now_ns - before) * 1e-9, 0.0), _MAX_DT_S)
        self._before_ns = now_ns
        self._judged += judged
        self._missed += missed
        if self._judged_s >= BLOCK_S - 1e-6:
            self._close(self._missed / self._judged)
            self._judged_s = self._judged = self._missed = 0.0
            self._say(now_ns)

    def report(self) -> dict[str, Any]:
        """Return data for the run's summary.

        ``missed`` is the share of misses since the evidence began to grow; ``None`` if there is no
        evidence.
        """
        return {"drifting": self.drifting, "raised": self._raised, "missed": self._share}

    @property
    def _share(self) -> float | None:
        return self._misses / self._blocks if self._blocks else None

    def _close(self, share: float) -> None:
        top = math.log(EVIDENCE)
        moved = self._evidence + math.log1p(self._lambda * (share - self._bearable))
        self._evidence = min(max(moved, 0.0), top)
        self._blocks, self._misses = self._blocks + 1, self._misses + share
        if self._evidence <= 0.0:
            self._blocks, self._misses = 0, 0.0
            if self.drifting:
                log.info("forecasts hold again as often as the calibration states")
            self.drifting, self._said_ns = False, 0
        elif self._evidence >= top and not self.drifting:
            self.drifting = True
            self._raised += 1

    def _say(self, now_ns: int) -> None:
        due = self._said_ns == 0 or now_ns - self._said_ns >= SAID_EVERY_S * 1e9
        if not self.drifting or not due:
            return
        self._said_ns = now_ns
        log.warning(
            "the calibration no longer fits: %.1f %% of the forecasts missed, %.3g %% were stated; "
            "check for a moved sensor or another tracker, or calibrate on this site: "
            "hri-predict calibrate --onto",
            100 * (self._share or 0.0),
            100 * (1.0 - self._level),
        )
