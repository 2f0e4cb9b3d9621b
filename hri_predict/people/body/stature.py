"""Estimates a person's height from limb lengths, in any posture, and the unit that would fit.

Fractions of the stature after Drillis and Contini (1966), as in D. Winter, "Biomechanics and Motor
Control of Human Movement", fig. 4.1. Trackers differ by a few centimetres in joint positions, a
tenth of a bone; a wrong unit is a factor of more than two.
"""

import math
from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.joint_map import METRES_PER_UNIT

LEAST_M, MOST_M = 1.2, 2.3
"""Range of statures of adults at work, with a margin for trackers' bone lengths."""
USUAL_M = 1.7
_LIKELY = 0.2
"""Maximum logarithm of the ratio to the usual stature (1.39 to 2.08 m) at which a unit itself is
preferred to a mistaken conversion."""
_FRACTIONS = {"upper_arm": 0.186, "forearm": 0.146, "thigh": 0.245, "shank": 0.246}
_BONES = [
    (segment.joint_a, segment.joint_b, _FRACTIONS[segment.name[2:]])
    for segment in CANONICAL.segments
    if segment.name[2:] in _FRACTIONS
]
LIMBS = tuple(np.array(column) for column in zip(*_BONES, strict=True))
"""(B,) joints at both ends of each limb bone, and its share of the stature."""


def statures_m(positions: Floats, observed: Bools) -> Floats:
    """Return the stature indicated by each whole limb bone of a body, metres.

    Args:
        positions, observed: (J, 3) metres and (J,), canonical joints.
    """
    starts, ends, shares = LIMBS
    whole = observed[starts] & observed[ends]
    found: Floats = norm(positions[starts[whole]] - positions[ends[whole]]) / shares[whole]
    return found


def stature_m(bodies: Sequence[tuple[Floats, Bools]]) -> float | None:
    """Return the stature indicated by most bodies' limbs; ``None`` if no whole limb is seen.

    Args:
        bodies: (J, 3) metres and (J,), canonical joints.
    """
    if not bodies:
        return None
    positions = np.array([body[0] for body in bodies])
    observed = np.array([body[1] for body in bodies])
    found = []
    for a, b, fraction in _BONES:
        whole = observed[:, a] & observed[:, b]
        if whole.any():
            lengths = norm(positions[whole, a] - positions[whole, b])
            found.append(float(np.median(lengths)) / fraction)
    return float(np.median(found)) if found else None


def is_adult(stature: float) -> bool:
    """Return whether a person can have this height in metres."""
    return LEAST_M <= stature <= MOST_M


def fitting_unit(stature: float, scale_to_m: float) -> tuple[float, str] | None:
    """Return the metres per unit with which people would be adults, and its name.

    Args:
        stature: stature in metres at the current scale.
        scale_to_m: current metres per unit.

    Returns:
        The unit itself, or the factor of a unit that was mistaken for another one earlier, such as
        inches for centimetres; ``None`` if no unit fits.
    """
    units = {real: name for name, real in METRES_PER_UNIT.items()}
    taken = {
        scale_to_m * real / other: f"{name} mistaken for {wrong}"
        for name, real in METRES_PER_UNIT.items()
        for wrong, other in METRES_PER_UNIT.items()
        if name != wrong
    }
    off = {unit: abs(math.log(stature * unit / scale_to_m / USUAL_M)) for unit in units | taken}
    likely = [unit for unit in units if off[unit] < _LIKELY]
    best = min(likely or off, key=off.__getitem__)
    if not is_adult(stature * best / scale_to_m):
        return None
    return best, units.get(best) or taken[best]
