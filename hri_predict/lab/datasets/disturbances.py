"""Motion unlike anything in the calibration: whole recordings, disturbed capture by capture.

``corruption`` disturbs each window by itself to evaluate predictors. The self-check compares
captures with each other, so here every capture is disturbed once, as by a real sensor.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats

DISTURBED_S = 0.4
"""Horizon at which the zones of disturbed recordings are judged."""
Kind = Literal["plain", "noise", "scale", "shift"]


@dataclass(frozen=True, slots=True)
class Disturbance:
    """One condition.

    Attributes:
        kind: "plain": nothing. "noise": each coordinate of each capture has Gaussian noise of
            ``amount`` metres added. "scale": the body is scaled by ``amount`` about the point of
            the floor (z = 0) beneath it. "shift": from ``at_s`` on everything is shifted
            horizontally by ``amount`` metres.
        amount: see ``kind``.
        at_s: seconds after the first capture.
        seed: random seed of the noise, and of the direction of the shift.
    """

    kind: Kind
    amount: float = 0.0
    at_s: float = 0.0
    seed: int = 0

    @property
    def name(self) -> str:
        """Name in tables."""
        if self.kind == "plain":
            return "as recorded"
        if self.kind == "noise":
            return f"noise of {self.amount * 100:g} cm"
        if self.kind == "scale":
            return f"body scaled by {self.amount:g}"
        return f"camera shifted by {self.amount * 100:g} cm after {self.at_s:.3g} s"

    def apply(
        self,
        positions: Floats,
        observed: Bools,
        stamps_ns: NDArray[np.int64],
        trunk: Sequence[int],
    ) -> Floats:
        """Return disturbed positions; the observed mask does not change.

        Args:
            positions: (F, J, 3) metres, z up; anything where not observed.
            observed: (F, J).
            stamps_ns: (F,) capture times.
            trunk: joints whose mean is above the body's point on the floor; the mean of all joints
                is used where none of them is observed.
        """
        result = positions.copy()
        if self.kind == "noise":
            rng = np.random.default_rng(self.seed)
            result = positions + self.amount * rng.standard_normal(positions.shape)
        elif self.kind == "scale":
            foot = _beneath(positions, observed, trunk)[:, None]
            result = foot + self.amount * (positions - foot)
        elif self.kind == "shift":
            angle = np.random.default_rng(self.seed).uniform(0, 2 * np.pi)
            side = self.amount * np.array([np.cos(angle), np.sin(angle), 0.0])
            late = stamps_ns - stamps_ns[:1] >= round(self.at_s * 1e9)
            result = positions + np.where(late[:, None, None], side, 0.0)
        return np.where(observed[..., None], result, positions)


def _beneath(positions: Floats, observed: Bools, trunk: Sequence[int]) -> Floats:
    """(F, 3) the floor beneath the body."""
    chosen = np.zeros_like(observed)
    chosen[:, list(trunk)] = observed[:, list(trunk)]
    chosen = np.where(chosen.any(1, keepdims=True), chosen, observed)
    count = np.maximum(chosen.sum(1), 1)[:, None]
    mean: Floats = np.where(chosen[..., None], positions, 0.0).sum(1) / count
    mean[:, 2] = 0.0
    return mean


def standard(shift_at_s: float, seed: int = 0) -> tuple[Disturbance, ...]:
    """The conditions that the self-check is tested on."""
    return (
        Disturbance("plain"),
        Disturbance("noise", 0.02, seed=seed),
        Disturbance("noise", 0.05, seed=seed),
        Disturbance("scale", 0.7),
        Disturbance("scale", 1.4),
        Disturbance("shift", 0.2, at_s=shift_at_s, seed=seed),
    )
