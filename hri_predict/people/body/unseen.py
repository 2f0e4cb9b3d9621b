"""Joints that a source sends and did not see: at its own origin, or too far from the body.

Many trackers write a joint that they lost as 0, 0, 0. That place is the sensor, or where the room's
axes begin, and a limb that ends there is metres long. Neither is a measurement.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL

SLACK_M = 0.15
"""Two joints may be farther apart than the longest bones between them by this: noise, and rigs
whose joints are not the survey's landmarks. The largest excess of any recording was 0.04 m."""
MISNAMED = 0.3
"""If more than this share of a whole body contradicts itself, its joints have other names than the
map says: that says nothing about where the body is."""
WHOLE_BODY_JOINTS = 8
"""Fewer joints are not a whole body."""
_MOST_APART = CANONICAL.reach + SLACK_M
_MOST_APART_2 = _MOST_APART**2


def at_origin(positions: Floats, origin: Floats) -> Bools:
    """Return (...,) which joints (..., 3) are exactly at their source's origin (3,)."""
    there: Bools = np.asarray((positions == origin).all(axis=-1))
    return there


def contradicts(positions: Floats, observed: Bools) -> Bools:
    """Return (n,) in which of many bodies (n, J, 3), (n, J) two joints are too far apart."""
    apart2: Floats = ((positions[:, :, None] - positions[:, None]) ** 2).sum(axis=-1)
    both = observed[:, :, None] & observed[:, None]
    found: Bools = np.asarray((both & (apart2 > _MOST_APART_2)).any(axis=(1, 2)))
    return found


def out_of_reach(positions: Floats, observed: Bools) -> Bools:
    """Return (J,) which observed canonical joints are farther from others than bones allow.

    The joint that is too far from most others is disbelieved first, then the next, until the rest
    agree. Where two contradict each other and nothing else, both are disbelieved. A whole body that
    contradicts itself everywhere is left as it is.

    Args:
        positions: (J, 3) metres; finite where observed.
        observed: (J,).
    """
    wrong = np.zeros(len(observed), np.bool_)
    where = np.flatnonzero(observed)
    seen = positions[where]
    between = seen[:, None] - seen[None]
    apart2 = np.einsum("ijk,ijk->ij", between, between)
    too_far = apart2 > _MOST_APART_2[where[:, None], where]
    while too_far.any():
        counts = too_far.sum(axis=1)
        worst = counts == counts.max()
        wrong[where[worst]] = True
        too_far[worst] = False
        too_far[:, worst] = False
    misnamed = len(where) >= WHOLE_BODY_JOINTS and wrong.sum() > MISNAMED * len(where)
    return np.zeros_like(wrong) if misnamed else wrong
