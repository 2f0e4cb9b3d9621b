"""Drift: whether forecasts still hold as often as their calibration states, over minutes.

The self-check widens the zones of one person within a second, and forgets. Drift is about all
people and longer times: another tracker, other people, other work, a calibration of something else.
It changes no zone; it says that a calibration of this site is due.

**Blocks.** Forecasts overlap: 30 of one person are judged by one capture, and errors last. So no
judgement counts by itself. A *block* is ``BLOCK_S`` of captures with a person judged, and gives one
number y from 0 to 1: the share of its judgements, over all people and all horizons, in which the
radii *as calibrated* were missed. Blocks are ten times as long as a forecast.

**Test.** With a stated level l the share of misses is bearable up to m0 = min(2 (1 - l),
(1 - l) + 0.03). With lambda = min(4, 1 / (5 m0)) each block multiplies the evidence by

    1 + lambda (y - m0)

whose mean is at most 1 while the expected y, given anything before, is at most m0: an e-process (I.
Waudby-Smith, A. Ramdas, "Estimating means of bounded random variables by betting", JRSS B 86 (2024)
1). How y is spread does not matter. The evidence never falls below 1, so that a good week does not
hide a bad day (CUSUM of e-values; J. Shin, A. Ramdas, A. Rinaldo, "E-detectors", NEJSDS 2023): at
the bearable share a false alarm comes after ``EVIDENCE`` blocks (280 h of people) or more in
the mean, and at the stated one much later.

- *Raised* when the evidence reaches ``EVIDENCE``. Of a stated 99 %, with half of the forecasts
  missing it takes 2 minutes of people, with a tenth 7, with a twentieth 17.
- *Cleared* when it is back at 1: after at least 23 minutes of people in which nothing is missed,
  47 in which 99 % hold. Nothing flaps, because each way is the whole way.

A person who errs more than others for long is not a false alarm: what is stated does not hold here.
"""

import logging
import math
from typing import Any

log = logging.getLogger(__name__)

BLOCK_S = 10.0
EVIDENCE = 1e5
SAID_EVERY_S = 3600.0
"""Interval at which the log repeats it while it lasts."""
_MAX_DT_S = 0.1
_MARGIN = 0.03
_MOST_LAMBDA = 4.0


class Drift:
    """The evidence against a calibration; one per run, deterministic.

    Args:
        level: of the calibrated radii, 0 < level < 1.
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
        """Count the judgements of one tick.

        Args:
            now_ns: of the tick.
            missed: number of misses of the calibrated radii; a part of a body counts as a
                fraction.
            judged: their number.
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
        """For the run's summary.

        ``missed`` is the share of misses since the evidence began to grow; ``None`` if there is
        none.
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
            "the calibration does not fit any more: %.1f %% of the forecasts missed, %.3g %% were "
            "stated; look for a moved sensor or another tracker, or calibrate on this site: "
            "hri-predict calibrate --onto",
            100 * (self._share or 0.0),
            100 * (1.0 - self._level),
        )
