"""Counts of values in narrow bins: percentiles of millions of values in little memory."""

import math

LARGEST = 1e6
"""Maximum plausible distance, speed or age in a cell; larger values come from a damaged file."""


class Spread:
    """Args: ``step``: width of a bin, in the values' unit; the accuracy of percentiles."""

    def __init__(self, step: float) -> None:
        self.step = step
        self.weight = 0.0
        self._sum = 0.0
        self._weights: dict[int, float] = {}

    def add(self, value: float, weight: float = 1.0) -> None:
        """Count a finite value of 0 or more; values above ``LARGEST`` are counted as
        ``LARGEST``.
        """
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
        """Return the upper edge of the bin up to which ``share`` of all values lie."""
        left = share * self.weight
        for k in sorted(self._weights):
            left -= self._weights[k]
            if left <= 1e-9:
                return (k + 1) * self.step
        return None

    def rows(self, most: int) -> list[tuple[float, float]]:
        """Return (lower edge, weight) of the first ``most`` bins; the last one includes all values
        beyond.
        """
        found = [0.0] * most
        for k, weight in self._weights.items():
            found[min(max(k, 0), most - 1)] += weight
        return [(k * self.step, weight) for k, weight in enumerate(found)]

    def share_at_least(self, value: float) -> float | None:
        """Return the share of values in bins that start at ``value`` or above."""
        if not self.weight:
            return None
        least = math.floor(value / self.step + 1e-9)
        return sum(w for k, w in self._weights.items() if k >= least) / self.weight
