"""The self-check's counts: how often past forecasts held, for the run's summary."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Floats
from hri_predict.zones.trust import Trust

_SUMS = 5
"""Judged, judged with radii in use, missed as calibrated, missed as used, mean errors."""
_MAX_IDS = 64
"""Ids kept in the report: flickering ids must not fill the memory."""


class Tally:
    """Running sums per person and band of horizons.

    Args:
        people: slots for people.
        bands_s: (B,) where each band ends, seconds ahead.
    """

    def __init__(self, people: int, bands_s: Sequence[float]) -> None:
        self._bands_s = tuple(bands_s)
        self._sums: Floats = np.zeros((people, _SUMS, len(bands_s)))
        self._past: Floats = np.zeros((_SUMS, len(bands_s)))
        self._left: dict[int, Floats] = {}
        self._ticks = self._widened_ticks = self._outside_ticks = 0
        self._largest = 1.0

    def tick(self, trust: Trust) -> None:
        """Count whether a person is widened or out of distribution in this tick."""
        self._ticks += 1
        self._widened_ticks += bool(trust.widened.any())
        self._outside_ticks += bool(trust.out_of_distribution.any())
        self._largest = max(self._largest, float(trust.widen.max(initial=1.0)))

    def add(self, slots: NDArray[np.intp], sums: Floats) -> None:
        """Add (Q, ``_SUMS``, B) to those of Q people."""
        self._sums[slots] += sums

    def close(self, slot: int, number: int) -> None:
        """The person with this id has left the slot."""
        sums = self._sums[slot].copy()
        self._sums[slot] = 0.0
        self._past += sums
        self._left[number] = sums + self._left.pop(number, 0.0)
        if len(self._left) > _MAX_IDS:
            del self._left[next(iter(self._left))]

    def report(self, ids: Sequence[int | None]) -> dict[str, Any]:
        """Everything since the start; ``ids`` are those in the slots now.

        ``covered`` is the share of the ``judged_in_use`` (or of their joints) that held with the
        widening in force when they were made. Forecasts of people who were out of distribution at
        that time are not among them. ``covered_as_calibrated`` is the share of all ``judged``
        without widening.
        Shares are ``None`` if nothing was judged. The newest ids have their own entries.
        """
        people = dict(self._left)
        for slot, number in enumerate(ids):
            if number is not None:
                people[number] = self._sums[slot] + people.pop(number, 0.0)
        everybody = self._past + self._sums.sum(0)
        return {
            "ticks": self._ticks,
            "ticks_widened": self._widened_ticks,
            "ticks_unlike": self._outside_ticks,
            "largest_factor": self._largest,
            **_shares(everybody.sum(1)),
            "horizons": self._horizons(everybody),
            "people": {
                str(number): {**_shares(sums.sum(1)), "horizons": self._horizons(sums)}
                for number, sums in list(people.items())[-_MAX_IDS:]
            },
        }

    def _horizons(self, sums: Floats) -> list[dict[str, Any]]:
        return [
            {"up_to_s": end, **_shares(sums[:, band])} for band, end in enumerate(self._bands_s)
        ]


def _shares(sums: Floats) -> dict[str, Any]:
    judged, used, bare, then, error = (float(value) for value in sums)
    return {
        "judged": round(judged),
        "judged_in_use": round(used),
        "covered": 1.0 - then / used if used else None,
        "covered_as_calibrated": 1.0 - bare / judged if judged else None,
        "mean_error_m": error / judged if judged else None,
    }
