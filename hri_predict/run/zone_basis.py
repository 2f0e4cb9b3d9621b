"""Basis of a predictor's zones, as every comparison prints it."""

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True, kw_only=True)
class ZoneBasis:
    """Basis of a predictor's zones.

    Attributes:
        label, name: of the predictor.
        weights: its own file, as the user named it; ``None``: the shipped one, or none.
        calibration: the file; ``None``: it has none, and zones are those of the physical limits.
        shipped: whether the calibration came with the node.
    """

    label: str
    name: str
    weights: Path | None
    calibration: Path | None
    shipped: bool

    @property
    def line(self) -> str:
        """The basis as a line to read, with the remedy."""
        if self.calibration is not None:
            where = ", shipped" if self.shipped else ""
            return f"Zones of {self.label}: calibrated by {self.calibration.name}{where}."
        words = ["hri-predict", "calibrate", "--predictor", self.name]
        words += [] if self.weights is None else ["--weights", str(self.weights)]
        return (
            f"Zones of {self.label}: not calibrated: physical limits alone, which costs work; "
            f"calibrate it on a folder of your recordings: "
            f"{shlex.join([*words, '--data', 'recordings'])}"
        )

    def as_json(self) -> dict[str, Any]:
        """The basis as JSON; files by name, because folders differ between machines."""
        return {
            "label": self.label,
            "predictor": self.name,
            "weights": None if self.weights is None else self.weights.name,
            "calibrated": self.calibration is not None,
            "calibration": None if self.calibration is None else self.calibration.name,
        }
