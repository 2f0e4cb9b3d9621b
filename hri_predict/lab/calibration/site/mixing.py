"""Effect of a site's own recordings on the factors of a calibration.

**Rule.** A factor is a quantile of errors over the learned scale. The base gives the distribution
of these ratios among its own people, and the site's parts give the distribution at the site. The
new distribution is a mixture: the base counts as a fixed number of recordings, each part of the
site as one. The new factor is the mixture's quantile. So a single part changes little, and many
outweigh the base. The tail follows shares of windows, which averaged factors would not do.

- The base counts as ``GROW`` recordings where the site needs larger factors and as ``SHRINK``
  where smaller ones would do: a zone too small may hurt a person, one too large costs time.
- A factor that shrinks stays at least the site's own quantile.
- A part in which a speed class occurs for less than ``FULL_WINDOWS`` counts in proportion.
- As in every calibration, the share that the site's parts may miss is reduced if they are few
  (``conformal.caution``).
- Where the base has no data, the site's quantile alone is used, from ``LEAST_RECORDINGS`` on.

The base provides its factors at three levels only. Between them the logarithm of the share above a
ratio is linear in the logarithm of the ratio, and beyond them this line is extended. (Such a Pareto
tail is heavier than that of bodies, whose speed is bounded: it errs towards larger factors.)
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS, caution
from hri_predict.zones.settings import LEVELS

GROW, SHRINK = 15.0, 30.0
"""Number of recordings that the base counts as; see the module."""
FULL_WINDOWS = 80
"""Minimum number of windows for a part's full weight: ten seconds of one person."""
_LEAST_SHARE = 1e-6
_ABOVE = 1.0 - np.array(LEVELS)


@dataclass(frozen=True, slots=True, eq=False)
class Ratios:
    """The site's ratios of one question, speed class and step.

    Attributes:
        values: (n,) ascending.
        above: (n,) weight of the ratios that are larger than each.
        weight: total weight of all ratios, in parts.
    """

    values: Floats
    above: Floats
    weight: float

    @staticmethod
    def of(values: Floats, unit: Ints, weights: Floats) -> "Ratios":
        """Ratios (n,) of the parts ``unit`` (n,), which weigh ``weights`` (U,) if they have any."""
        known = np.isfinite(values)
        values, unit = values[known], unit[known]
        counts = np.bincount(unit, minlength=len(weights))
        each = (weights / np.maximum(counts, 1))[unit]
        order = np.argsort(values)
        total = float(weights[counts > 0].sum())
        return Ratios(values[order], np.maximum(total - np.cumsum(each[order]), 0.0), total)

    def own(self, level: float) -> float:
        """Quantile of the site's ratios; infinite without any."""
        if not len(self.values):
            return np.inf
        missed = (1.0 - level) * self.weight - self.cut(level)
        at = bisect_left(range(len(self.values)), x=True, key=lambda i: self.above[i] <= missed)
        return float(self.values[min(at, len(self.values) - 1)])

    def cut(self, level: float) -> float:
        """The weight by which the allowed misses are reduced."""
        if self.weight <= 0:
            return 0.0
        return (1.0 - level) * self.weight * caution(self.weight)


class BaseTail:
    """The tail of the base's ratios, from its factors (L,) at ``LEVELS``."""

    def __init__(self, factors: Floats) -> None:
        ratio = np.log(np.maximum.accumulate(factors))
        ratio = ratio + 1e-6 * np.arange(len(ratio))  # equal factors: a step
        share = np.log(_ABOVE)
        first, last = np.diff(ratio)[[0, -1]] / np.diff(share)[[0, -1]]
        ends = np.array([0.0, np.log(_LEAST_SHARE)])
        reach = [ratio[0] + first * (ends[0] - share[0]), ratio[-1] + last * (ends[1] - share[-1])]
        self._ratio = np.concatenate([reach[:1], ratio, reach[1:]])
        self._share = np.concatenate([ends[:1], share, ends[1:]])

    def above(self, ratio: float) -> float:
        """Share of the base's ratios above ``ratio``."""
        return float(np.exp(np.interp(np.log(max(ratio, 1e-9)), self._ratio, self._share)))

    def ratio(self, share: float) -> float:
        """The ratio that ``share`` of the ratios exceed; infinite for a share of nearly 0."""
        if share <= _LEAST_SHARE:
            return np.inf
        return float(np.exp(np.interp(-np.log(min(share, 1.0)), -self._share, self._ratio)))


def moved(base: Floats, site: Ratios) -> Floats:
    """The factors (L,) of the mixture; the base's own if the site shows nothing."""
    own = np.array([site.own(level) for level in LEVELS])
    if site.weight <= 0:
        return base
    if not np.isfinite(base).all():
        known = own if site.weight >= LEAST_RECORDINGS else np.full(len(own), np.inf)
        return np.where(np.isfinite(base), np.maximum(base, own), known)
    tail = BaseTail(base)
    mixed = [
        np.array([_quantile(tail, counts, site, level) for level in LEVELS])
        for counts in (GROW, SHRINK)
    ]
    found = np.maximum(np.maximum(*mixed), np.minimum(base, own))
    rising: Floats = np.maximum.accumulate(found)
    return rising


def _quantile(base: BaseTail, counts: float, site: Ratios, level: float) -> float:
    """The smallest ratio that at most 1 - level of the mixture exceeds."""
    budget = (counts + site.weight) * (1.0 - level) - site.cut(level)
    values, above = site.values, site.above
    at = bisect_left(
        range(len(values)),
        x=True,
        key=lambda i: counts * base.above(float(values[i])) + above[i] <= budget,
    )
    # between the value before and this one, the site's share is constant and the base's falls
    before = above[at - 1] if at else site.weight
    lower = float(values[at - 1]) if at else 0.0
    within = max(lower, base.ratio((budget - before) / counts))
    return min(within, float(values[at])) if at < len(values) else within


def weights_of(windows: Sequence[int] | Ints) -> Floats:
    """Return the weights of parts by their number of windows: 1, or less for few windows."""
    return np.minimum(np.asarray(windows, float) / FULL_WINDOWS, 1.0)
