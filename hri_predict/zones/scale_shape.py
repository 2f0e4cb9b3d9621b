"""Shape: how the tail of the errors depends on the size of the learned scale.

The network estimates the size of an error, but not how heavy its tail is. A person who stands still
has a small scale but may start to walk; a moving arm has a large scale, and its errors seldom
exceed it by much. One factor for both would make the zones of arms too large and those of standing
people too small. The scale is therefore first multiplied by a factor that depends on the scale
itself, the trunk's speed class and the step.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.zones.motion_class import SPEED_CLASSES

KNOTS = 8
"""Number of knots: sizes of the scale with a known factor; log-log interpolation in between."""


@dataclass(frozen=True, slots=True, eq=False)
class ScaleShape:
    """Factors on the scale by its size. H steps, B knots.

    Attributes:
        size_m: (3, H, B) sizes, metres, ascending, by speed class and step.
        factor: (3, H, B) factors at these sizes; beyond the knots, the nearest factor applies.
    """

    size_m: Floats
    factor: Floats

    def of(self, scale_m: Floats, fast: Ints) -> Floats:
        """(W, H, J) metres: the scale times its factor.

        Args:
            scale_m: (W, H, J); steps beyond the end of the shape use its last step.
            fast: (W,) speed class.
        """
        knots, logs = self.logarithms(scale_m.shape[1])
        return shaped_by(scale_m, knots[fast], logs[fast])

    def logarithms(self, steps: int) -> tuple[Floats, Floats]:
        """Return the logarithms of sizes and factors, (3, ``steps``, B) each."""
        step = np.minimum(np.arange(steps), self.size_m.shape[1] - 1)
        return np.log(self.size_m[:, step]), np.log(self.factor[:, step])

    def to_json(self) -> dict[str, Any]:
        """Return plain data: sizes in whole micrometres, factors in whole thousandths."""
        return {
            "size_um": np.round(self.size_m * 1e6).astype(np.int64).tolist(),
            "thousandths": np.ceil(self.factor * 1000.0 - 1e-6).astype(np.int64).tolist(),
        }

    @classmethod
    def of_json(cls, data: dict[str, Any], steps: int) -> "ScaleShape":
        """Read the output of ``to_json``.

        Raises:
            ValueError: the data are not a shape, or not for ``steps``.
        """
        if set(data) != {"size_um", "thousandths"}:
            raise ValueError("shape must have size_um and thousandths")
        shape = (len(SPEED_CLASSES), steps, KNOTS)
        try:
            size = np.array(data["size_um"], dtype=np.float64) * 1e-6
            factor = np.array(data["thousandths"], dtype=np.float64) / 1000.0
        except (OverflowError, TypeError, ValueError) as error:
            raise ValueError(f"shape is not a table of numbers ({error})") from error
        if size.shape != shape or factor.shape != shape:
            raise ValueError(f"shape's tables must have the shape {shape}")
        good = (size > 0).all() and (np.diff(size) > 0).all() and (size < 100).all()
        if not good or not ((factor > 0) & (factor < 1000)).all():
            raise ValueError("shape: sizes must ascend from above 0, factors be between 0 and 1000")
        return cls(size, factor)


def shaped_by(scale_m: Floats, knots: Floats, logs: Floats) -> Floats:
    """Return (W, H, J) metres: the scale times its factor, from (W, H, B)
    ``ScaleShape.logarithms``."""
    knots, logs = knots[:, :, None], logs[:, :, None]
    size = np.log(scale_m)
    below = np.count_nonzero(size[..., None] >= knots[..., 1:-1], axis=-1)[..., None]
    low, high = _at(knots, below), _at(knots, below + 1)
    part = np.clip((size - low) / (high - low), 0.0, 1.0)
    first = _at(logs, below)
    result: Floats = scale_m * np.exp(first + part * (_at(logs, below + 1) - first))
    return result


def _at(table: Floats, index: Ints) -> Floats:
    """Return the entries of (W, H, 1, B) at (W, H, J, 1), as (W, H, J)."""
    wide = np.broadcast_to(table, (*index.shape[:-1], table.shape[-1]))
    found: Floats = np.take_along_axis(wide, index, axis=-1)[..., 0]
    return found
