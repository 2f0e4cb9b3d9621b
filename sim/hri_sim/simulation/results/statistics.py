"""Ratios of sums, with intervals that resample by recording.

Many approaches reuse few recordings, so approaches are not independent; recordings nearly are. So
the bootstrap (B. Efron, R. Tibshirani, "An Introduction to the Bootstrap", 1993, ch. 6 and 13)
draws whole recordings with replacement, and takes percentiles of the ratio over the draws.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

DRAWS = 2000
LEVEL = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """A ratio and its 95 % interval; all ``None`` if the denominator is 0."""

    value: float | None
    low: float | None
    high: float | None


def ratio(
    *,
    recordings: Sequence[str],
    numerators: Sequence[float],
    denominators: Sequence[float],
    draws: int = DRAWS,
    seed: int = 0,
) -> Estimate:
    """Return the sum of numerators divided by the sum of denominators, with its interval.

    Args:
        recordings: (N,) the recording of each.
        numerators, denominators: (N,).
        draws: number of resamples.
        seed: random seed of the resampling: the same for every ratio, so that tables reproduce.
    """
    names = sorted(set(recordings))
    index = np.array([names.index(name) for name in recordings], dtype=np.intp)
    top = np.bincount(index, np.asarray(numerators, float), len(names))
    bottom = np.bincount(index, np.asarray(denominators, float), len(names))
    if not bottom.sum() > 0:
        return Estimate(None, None, None)
    value = float(top.sum() / bottom.sum())
    rng = np.random.default_rng(seed)
    weights = rng.multinomial(len(names), np.full(len(names), 1 / len(names)), draws)
    below = weights @ bottom
    drawn = (weights @ top)[below > 0] / below[below > 0]
    tail = (1 - LEVEL) / 2
    low, high = np.quantile(drawn, [tail, 1 - tail])
    return Estimate(value, float(low), float(high))
