"""Counts of values in narrow bins: percentiles of millions of values in little memory."""

import math

LARGEST = 1e6
"""No distance, speed or age of a cell is larger: what is comes from a damaged file."""


class Spread:
    """Args: ``step``: width of a bin, in the values' unit; percentiles are right to this."""

    def __init__(self, step: float) -> None:
        self.step = step
        self.weight = 0.0
        self._sum = 0.0
        self._weights: dict[int, float] = {}

    def add(self, value: float, weight: float = 1.0) -> None:
        """Count a finite value of 0 or more; one beyond ``LARGEST`` counts as that."""
        value = min(value, LARGEST)
        k = math.floor(value / self.step)
        self._weights[k] = self._weights.get(k, 0.0) + weight
        self._sum += value * weight
        self.weight += weight

    @property
    def mean(self) -> float | None:
        """``None`` without values."""
        return self._sum / self.weight if self.weight else None

    def percentile(self, share: float) -> float | None:
        """The upper edge of the bin below which ``share`` of all values lie."""
        left = share * self.weight
        for k in sorted(self._weights):
            left -= self._weights[k]
            if left <= 1e-9:
                return (k + 1) * self.step
        return None

    def rows(self, most: int) -> list[tuple[float, float]]:
        """(lower edge, weight) of the first ``most`` bins; the last one holds all beyond."""
        found = [0.0] * most
        for k, weight in self._weights.items():
            found[min(max(k, 0), most - 1)] += weight
        return [(k * self.step, weight) for k, weight in enumerate(found)]

    def share_at_least(self, value: float) -> float | None:
        """The share of values in bins that begin at ``value`` or more."""
        if not self.weight:
            return None
        least = math.floor(value / self.step + 1e-9)
        return sum(w for k, w in self._weights.items() if k >= least) / self.weight
