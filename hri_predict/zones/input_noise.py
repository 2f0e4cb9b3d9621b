"""Noise of a tracker, measured at run time, and the growth of zones with it.

The true lengths of a person's thighs, shanks and arms are constant, but their measured lengths
vary. The measure is the spread of these eight lengths, each about its own median, over the history
used for a forecast. The learned scale already covers errors that are independent between captures.
Persistent errors look like motion to it, so they are measured here: lengths are averaged over
``SMOOTHED`` steps, and the remaining share of white noise is subtracted. Medians limit the effect
of one bad bone or a burst of wrong captures.

In marker-based recordings, 97 of 100 windows stay below ``FLOOR_M``, where radii do not change at
all. Above it, a radius r becomes the root of r² + (g n)², where n is the noise above the floor and
g the *growth* of the calibration, by level and step. Two cases are not covered: errors across a
bone hardly change its length, and without visible bones zones are those of a noise-free tracker.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import Skeleton
from hri_predict.zones.settings import LEVELS

BONES = tuple(
    (f"{side}_{inner}", f"{side}_{outer}")
    for side in "lr"
    for inner, outer in (
        ("shoulder", "elbow"), ("elbow", "wrist"), ("hip", "knee"), ("knee", "ankle"),
    )
)  # fmt: skip
SMOOTHED, LEAST_SEEN = 5, 3
"""Number of steps over which a length is averaged, and the minimum number in which it is seen."""
FLOOR_M, MOST_M = 0.004, 0.03
"""Noise below ``FLOOR_M`` counts as 0; the excess over it is capped at ``MOST_M``."""
DEVIATIONS = 1.4826
"""Ratio of standard deviation to median absolute deviation of the normal distribution."""
MOST_GROWTH = 1000.0


def input_noise_m(history: Floats, measured: Bools, skeleton: Skeleton) -> Floats:
    """Return (P,) metres of noise above ``FLOOR_M``, from 0 to ``MOST_M``; 0 without a known bone.

    Args:
        history: (P, T, J, 3) metres; any value where not measured.
        measured: (P, T, J), without inferred joints, because their bones vary without noise.
        skeleton: names the joints.
    """
    names = list(skeleton.joints)
    bones = [(names.index(a), names.index(b)) for a, b in BONES if a in names and b in names]
    people, steps = measured.shape[:2]
    if not people or steps < SMOOTHED or not bones:
        return np.zeros(people)
    inner, outer = np.array(bones).T
    length = norm(history[:, :, outer] - history[:, :, inner])
    seen = measured[:, :, outer] & measured[:, :, inner] & np.isfinite(length)
    white = _deviation(np.diff(length, axis=1), seen[:, 1:] & seen[:, :-1]) / np.sqrt(2.0)
    length, seen = _smoothed(length, seen)
    spread = _deviation(length - _median(length, seen)[:, None], seen)
    lasting = np.sqrt(np.maximum(spread**2 - white**2 / SMOOTHED, 0.0))
    found: Floats = np.clip(lasting - FLOOR_M, 0.0, MOST_M)
    return found


def _deviation(off: Floats, known: Bools) -> Floats:
    """Return (P,) robust standard deviations of values (P, ...) about 0."""
    rows = len(off)
    return DEVIATIONS * _median(np.abs(off).reshape(rows, -1), known.reshape(rows, -1))


def _smoothed(length: Floats, seen: Bools) -> tuple[Floats, Bools]:
    """Return (P, T - ``SMOOTHED`` + 1, B) means, and whether each had enough observed steps."""
    windows = np.lib.stride_tricks.sliding_window_view
    count = windows(seen, SMOOTHED, axis=1).sum(-1)
    total = windows(np.where(seen, length, 0.0), SMOOTHED, axis=1).sum(-1)
    return total / np.maximum(count, 1), count >= LEAST_SEEN


def _median(values: Floats, known: Bools) -> Floats:
    """Return the median of known values along axis 1; 0 where none is known."""
    count = np.expand_dims(known.sum(1), 1)
    ordered = np.sort(np.where(known, values, np.inf), axis=1)
    low = np.take_along_axis(ordered, np.maximum(count - 1, 0) // 2, axis=1)
    high = np.take_along_axis(ordered, np.minimum(count // 2, values.shape[1] - 1), axis=1)
    found: Floats = np.where(count > 0, (low + high) / 2.0, 0.0)[:, 0]
    return found


@dataclass(frozen=True, slots=True, eq=False)
class NoiseGrowth:
    """Growth of radii with noise. L levels, H steps.

    Attributes:
        table: per question (L, H) metres of radius for each metre of noise.
    """

    table: Mapping[Any, Floats]

    def grown(self, radius_m: Floats, noise_m: Floats, of: str, level: int) -> Floats:
        """Return (P, H, J) radii, never smaller than ``radius_m`` (P, H, J).

        Args:
            radius_m: radii without noise; steps beyond the end of the table use its last step.
            noise_m: (P,) noise from ``input_noise_m``.
            of: the question, ``joint`` or ``body``.
            level: index into ``LEVELS``.
        """
        if not noise_m.any():
            return radius_m
        growth = self.table[of][level]
        at = np.minimum(np.arange(radius_m.shape[1]), len(growth) - 1)
        more = noise_m[:, None, None] * growth[at][None, :, None]
        found: Floats = np.hypot(radius_m, more)
        return found

    def to_json(self) -> dict[str, Any]:
        """Return plain data: whole thousandths, rounded up."""
        return {
            of: np.ceil(rows * 1000.0 - 1e-6).astype(np.int64).tolist()
            for of, rows in self.table.items()
        }

    @classmethod
    def of_json(
        cls, data: Mapping[str, Any], questions: tuple[str, ...], steps: int
    ) -> "NoiseGrowth":
        """Read the output of ``to_json``.

        Raises:
            ValueError: the data do not describe growth factors for these questions and steps.
        """
        if set(data) != set(questions):
            raise ValueError(f"noise must have {' and '.join(questions)}")
        try:
            table = {of: np.array(rows, dtype=np.float64) / 1000.0 for of, rows in data.items()}
        except (OverflowError, TypeError, ValueError) as error:
            raise ValueError(f"noise is not a table of numbers ({error})") from error
        for rows in table.values():
            if rows.shape != (len(LEVELS), steps):
                raise ValueError(f"noise's tables must have the shape {(len(LEVELS), steps)}")
            if not ((rows >= 0) & (rows <= MOST_GROWTH)).all():
                raise ValueError(f"noise: growth factors must be between 0 and {MOST_GROWTH:g}")
            if (np.diff(rows, axis=0) < 0).any() or (np.diff(rows, axis=1) < 0).any():
                raise ValueError(
                    "noise: growth factors must not decrease with the level or the step"
                )
        return cls(table)
