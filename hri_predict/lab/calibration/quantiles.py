"""Quantiles over recordings of equal weight, and the caution that few recordings need."""

import math
from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Floats

LEAST_RECORDINGS = 4
_CAUTION = 8.0


def of_equals(samples: Sequence[Floats], level: float) -> float:
    """The quantile of several samples with equal weights, whatever their sizes.

    Infinite without data. A quantile from few recordings misses a larger share of new ones than
    stated, so the allowed share of misses is reduced by ``caution``.
    """
    known = [values[np.isfinite(values)] for values in samples]
    known = [values for values in known if values.size]
    if not known:
        return math.inf
    level += (1.0 - level) * caution(len(known))
    values = np.concatenate(known)
    weight = np.concatenate([np.full(v.size, 1.0 / v.size) for v in known])
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) / len(known)
    return float(values[order][min(int(reached.searchsorted(level - 1e-12)), values.size - 1)])


def caution(recordings: float) -> float:
    """Return the reduction of the allowed misses: a half for few recordings, less for more.

    Conformal prediction would add one recording in which nothing holds. That is right only in the
    worst case, impossible at 99 % with fewer than 99 recordings, and too cautious on average: see
    ``docs/decisions/few-recordings.md``.
    """
    return min(0.5, _CAUTION / recordings)
