"""Reading a history in which some joints were not always observed."""

import math

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats

Indices = NDArray[np.intp]


def steps(duration_s: float, rate_hz: float) -> int:
    """Whole steps in a duration, rounded half up, at least one."""
    return max(1, math.floor(duration_s * rate_hz + 0.5))


def steps_to_cover(duration_s: float, rate_hz: float) -> int:
    """Steps that reach at least as far as a duration, at least one."""
    return max(1, math.ceil(duration_s * rate_hz - 1e-9))


def ever(mask: Bools) -> Bools:
    """Whether any entry is true along axis 1: time, or the joints of a (P, J) mask."""
    return np.asarray(mask.any(axis=1))


def last_observed(observed: Bools) -> tuple[Indices, Bools]:
    """(P, J) index of each joint's newest observed step, and whether there is one.

    Args:
        observed: (P, T, J).
    """
    total = observed.shape[1]
    newest = total - 1 - np.argmax(observed[:, ::-1], axis=1)
    return newest, ever(observed)


def at_step(history: Floats, step: Indices) -> Floats:
    """(P, J, 3) each joint at its own step. ``history`` is (P, T, J, 3), ``step`` (P, J)."""
    return np.take_along_axis(history, step[:, np.newaxis, :, np.newaxis], axis=1)[:, 0]


def nearest_seen(seen: Bools, neighbours: Indices) -> Indices:
    """(P, J) the nearest seen joint in the tree for each joint; a seen joint is its own nearest.

    For a person without any seen joint, the joint itself.

    Args:
        seen: (P, J).
        neighbours: (J, J) as ``skeleton.neighbours`` gives them.
    """
    first = np.argmax(seen[:, neighbours], axis=2)
    return neighbours[np.arange(neighbours.shape[0]), first]
