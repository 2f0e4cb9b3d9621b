"""Verdict of the self-check on this tick's forecasts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.protocol.reasons import Reason

BY_CHANCE = 1.1
"""Maximum factor that is not reported: even well-calibrated radii miss occasionally. They widen,
but this is not reported, and the standard's assumptions still apply."""


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """Trust in this tick's forecasts. P people of the snapshot, H steps.

    Attributes:
        residual_m: (P,) metres; NaN if no forecast is old enough to be judged.
        error_m: (P, 2, J) metres, see ``learned_scale.Evidence``; NaN if unknown.
        widen: (P, H) factors >= 1 for the calibrated radii.
        out_of_distribution: (P,) whether motion is outside the calibration: use physical limits.
    """

    residual_m: Floats
    error_m: Floats
    widen: Floats
    out_of_distribution: Bools

    @property
    def widened(self) -> Bools:
        """(P,) whether radii are widened by more than chance explains; NaN counts as widened."""
        return ~np.asarray((self.widen <= BY_CHANCE).all(1))

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """``MOTION_UNLIKE`` and ``ZONES_WIDENED`` where applicable, worst first."""
        found: Sequence[tuple[bool, Reason]] = (
            (bool(self.out_of_distribution.any()), Reason.MOTION_UNLIKE),
            (bool((self.widened & ~self.out_of_distribution).any()), Reason.ZONES_WIDENED),
        )
        return tuple(reason for holds, reason in found if holds)

    def residual_alone(self) -> "Trust":
        """Return a copy with only the past errors: no widening, no physical limits."""
        return replace(
            self,
            widen=np.ones_like(self.widen),
            out_of_distribution=np.zeros_like(self.out_of_distribution),
        )
