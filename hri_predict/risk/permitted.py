"""Find the tabled speeds of a robot that a distance permits, with loops and with arrays.

Both versions perform the same operations in the same order. N tabled speeds, M margins or
distances.
"""

from math import inf

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.machine.compiled import kernel, part

REACH_SPEED_M_S = 2.0
"""K of ISO 13855:2010 for a separation of up to ``NEAR_M``."""
WALK_SPEED_M_S = 1.6
"""K of ISO 13855:2010 beyond ``NEAR_M``; the separation is then at least ``NEAR_M``."""
NEAR_M = 0.5

Curve = tuple[Floats, Floats, Floats]
"""Speeds, stopping times and distances of a stopping curve, (N,) each."""


# -- any direction ---------------------------------------------------------------------------------


def _any_way_by_arrays(
    distance_m: Floats, farthest_m: Floats, clearance_m: float, margins_m: Floats
) -> tuple[float, Ints]:
    """Return the distance beyond the clearance at rest, and the number of speeds per margin (M,).

    Args:
        distance_m: (K,) distance to the robot at its present position, for each step.
        farthest_m: (K, N) maximum travel by the end of each step, at each speed.
        clearance_m: C + Z_d + Z_r.
        margins_m: (M,) added to the clearance.
    """
    left = (distance_m[:, None] - farthest_m).min(0)
    any_way = np.minimum.accumulate(left) - clearance_m  # (N,) falls with speed
    return float(any_way[0]), np.searchsorted(-any_way, -margins_m, side="right")


def _any_way_by_loops(
    distance_m: Floats, farthest_m: Floats, clearance_m: float, margins_m: Floats
) -> tuple[float, Ints]:
    steps, speeds = farthest_m.shape
    left = np.full(speeds, inf)
    for k in range(steps):
        for n in range(speeds):
            left[n] = min(left[n], distance_m[k] - farthest_m[k, n])
    fits = np.zeros(len(margins_m), np.int64)
    least = inf
    for n in range(speeds):
        least = min(least, left[n])
        for m in range(len(margins_m)):
            if least - clearance_m >= margins_m[m]:
                fits[m] = n + 1
    return left[0] - clearance_m, fits


# -- the standard's separation ---------------------------------------------------------------------


def person_travel(
    time_s: Floats | float, other_m: Floats | float, human_m_s: float = 0.0
) -> Floats:
    """Return S_h: a person's travel in ``time_s``; ``other_m``: sum of the other terms of S_p.

    v_h is 2.0 m/s while S_p is at most 0.5 m; otherwise it is 1.6 m/s, and S_p is at least 0.5 m
    (ISO 13855:2010). The result is continuous and increases with the sum of both arguments. For a
    person with a higher measured speed, ``human_m_s`` is used; the standard does not cover this
    case.
    """
    near = REACH_SPEED_M_S * np.asarray(time_s)
    far = np.maximum(WALK_SPEED_M_S * np.asarray(time_s), NEAR_M - other_m)
    assumed = np.where(near + other_m <= NEAR_M, near, far)
    return np.maximum(assumed, human_m_s * np.asarray(time_s))


def _by_standard_by_arrays(
    curve: Curve, reaction_s: float, terms: tuple[float, float], distances_m: Floats
) -> tuple[float, Ints]:
    """Return S_p at rest if people move as assumed, and the number of speeds per distance (M,).

    Args:
        curve: the robot's stopping curve.
        reaction_s: T_r, from the capture.
        terms: C + Z_d + Z_r, and the speed of a person faster than assumed, otherwise 0.
        distances_m: (M,) distances to the person.
    """
    (speed_m_s, time_s, stopping_m), (clearance_m, human_m_s) = curve, terms
    other = speed_m_s * reaction_s + stopping_m + clearance_m
    assumed = other + person_travel(reaction_s + time_s, other)
    needed = assumed
    if human_m_s > 0:
        needed = other + person_travel(reaction_s + time_s, other, human_m_s)
    return float(assumed[0]), np.searchsorted(needed, distances_m, side="right")


def _by_standard_by_loops(
    curve: Curve, reaction_s: float, terms: tuple[float, float], distances_m: Floats
) -> tuple[float, Ints]:
    speed_m_s, time_s, stopping_m = curve
    clearance_m, human_m_s = terms
    other = speed_m_s[0] * reaction_s + stopping_m[0] + clearance_m
    at_rest = other + come_m(reaction_s + time_s[0], other, 0.0)
    fits = np.zeros(len(distances_m), np.int64)
    for m in range(len(distances_m)):
        low, high = 0, len(speed_m_s)
        while low < high:  # needed distances grow with speed
            n = (low + high) // 2
            other = speed_m_s[n] * reaction_s + stopping_m[n] + clearance_m
            needed = other + come_m(reaction_s + time_s[n], other, human_m_s)
            if needed <= distances_m[m]:
                low = n + 1
            else:
                high = n
        fits[m] = low
    return at_rest, fits


@part
def come_m(time_s: float, other_m: float, human_m_s: float) -> float:
    """Fast ``person_travel`` for a single time."""
    near = REACH_SPEED_M_S * time_s
    far = max(WALK_SPEED_M_S * time_s, NEAR_M - other_m)
    return max(near if near + other_m <= NEAR_M else far, human_m_s * time_s)


any_way = kernel(_any_way_by_loops, _any_way_by_arrays)
by_standard = kernel(_by_standard_by_loops, _by_standard_by_arrays)
