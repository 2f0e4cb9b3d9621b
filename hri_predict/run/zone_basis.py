"""Basis of a predictor's zones, printed with every comparison."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.zones.predictor_identity import CALIBRATED_S, calibrate_command


@dataclass(frozen=True, kw_only=True)
class ZoneBasis:
    """Basis of a predictor's zones.

    Attributes:
        label, name: label and name of the predictor.
        weights: its own weights file, as named by the user; ``None``: the shipped weights, or none.
        calibration: the calibration file; ``None``: there is none, and zones follow from the
            physical limits.
        shipped: whether the calibration came with the node.
        horizon_s: how far ahead the predictor forecasts.
    """

    label: str
    name: str
    weights: Path | None
    calibration: Path | None
    shipped: bool
    horizon_s: float = CALIBRATED_S

    @property
    def line(self) -> str:
        """Return the basis as one readable line, with the remedy."""
        if self.calibration is not None:
            where = ", shipped" if self.shipped else ""
            return f"Zones of {self.label}: calibrated by {self.calibration.name}{where}."
        weights = None if self.weights is None else str(self.weights)
        return (
            f"Zones of {self.label}: not calibrated, physical limits only, which reduces the "
            "robot's speed; calibrate it on a folder of your recordings: "
            f"{calibrate_command(self.name, weights, self.horizon_s)}"
        )

    def as_json(self) -> dict[str, Any]:
        """Return the basis as JSON; files by name only, because folders differ between machines."""
        return {
            "label": self.label,
            "predictor": self.name,
            "weights": None if self.weights is None else self.weights.name,
            "calibrated": self.calibration is not None,
            "calibration": None if self.calibration is None else self.calibration.name,
        }
