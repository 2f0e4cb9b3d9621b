"""Detects bodies too low to stand: they sit, crouch or bend, and their legs may be anywhere.

Where the legs of a standing person are, the posture above a bench shows. A person on a stool may
stretch them out, and looks the same from the hips up.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.body.stature import LIMBS

HIPS, SHOULDERS = 0.47, 0.68
"""Minimum heights above the floor of a standing person's hips and shoulders, as shares of the
stature. Of recorded people who walk, play and work at a window or with tools, one in a hundred was
below 0.49 to 0.57 and 0.64 to 0.81; medians are 0.54 to 0.60 and 0.81 to 0.85."""
LEAST_M, MOST_M = 1.5, 1.8
"""Range of assumed statures: noise must not make a person low, nor a lack of limbs in view."""
_HIPS, _SHOULDERS = (
    [JOINTS.index(f"{side}_{name}") for side in "lr"] for name in ("hip", "shoulder")
)


def is_low(positions: Floats, observed: Bools) -> Bools:
    """Return (n,) whether bodies are too low to stand, by their hips or else by their shoulders.

    A body of which neither is seen is not low, nor is anything inferred of it.

    Args:
        positions: (n, J, 3) metres above the floor; finite where observed.
        observed: (n, J).
    """
    stature = _statures_m(positions, observed)
    hips, shoulders = (_height_m(positions, observed, pair) for pair in (_HIPS, _SHOULDERS))
    by_hips = hips < HIPS * stature
    low: Bools = np.where(np.isnan(hips), shoulders < SHOULDERS * stature, by_hips)
    return low


def _height_m(positions: Floats, observed: Bools, pair: list[int]) -> Floats:
    """Return (n,) mean heights of a pair's seen joints; NaN if none is seen."""
    seen = observed[:, pair]
    total = np.where(seen, positions[:, pair, 2], 0.0).sum(1)
    return np.where(seen.any(1), total / np.maximum(seen.sum(1), 1), np.nan)


def _statures_m(positions: Floats, observed: Bools) -> Floats:
    """Return (n,) statures that the seen limbs indicate; the least if none is seen."""
    starts, ends, shares = LIMBS
    whole = observed[:, starts] & observed[:, ends]
    each = np.where(whole, norm(positions[:, starts] - positions[:, ends]) / shares, 0.0)
    mean = each.sum(1) / np.maximum(whole.sum(1), 1)
    return np.clip(np.where(whole.any(1), mean, LEAST_M), LEAST_M, MOST_M)
