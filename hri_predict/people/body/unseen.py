"""Joints that a source sent without seeing them: at its own origin, too far from the body, or at
the place of the limb's next joint.

Many trackers write a lost joint as 0, 0, 0. This is the position of the sensor or of the room's
origin, and a limb that ends there is metres long. Others put it where the joint before it is, or
read the depth of a hand for the elbow behind it. None of these is a measurement.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.people.body.size import LIMB_BONES

SLACK_M = 0.15
"""Maximum excess of the distance between two joints over the longest bones between them, due to
noise and to rigs with joints that differ from the survey's landmarks. The largest excess in any
recording was 0.04 m."""
MISNAMED = 0.3
"""If more than this share of a whole body is contradictory, the joint map has wrong names: the
position of the body may still be right."""
WHOLE_BODY_JOINTS = 8
"""Minimum number of joints of a whole body."""
LEAST_BONE_M = 0.06
"""Minimum length of each limb bone; ``size.LONG_BONE_M`` is that of the longest. The
shortest in 309 recordings of adults and trackers, five captures a second, was 0.11 m."""
_START, _END = LIMB_BONES.T


def _from_bone_on(start: int, end: int) -> Bools:
    """Return (J,) the two ends of a limb's bone, and the joints beyond it."""
    beyond = [end]
    for segment in CANONICAL.segments:  # along each limb
        if segment.joint_a in beyond:
            beyond.append(segment.joint_b)
    return np.isin(np.arange(len(JOINTS)), [start, *beyond])


_FROM_BONE_ON = np.array([_from_bone_on(start, end) for start, end in LIMB_BONES])
_MOST_APART = CANONICAL.reach + SLACK_M
_MOST_APART_2 = _MOST_APART**2


def at_origin(positions: Floats, origin: Floats) -> Bools:
    """Return (...,) whether joints (..., 3) are exactly at their source's origin (3,)."""
    there: Bools = np.asarray((positions == origin).all(axis=-1))
    return there


def collapsed(positions: Floats, observed: Bools) -> Bools:
    """Return (n, J) which observed joints belong to a limb's bone that has no length, or lie beyond
    it: either end may be the wrong one.

    Args:
        positions: (n, J, 3) metres; finite where observed.
        observed: (n, J).
    """
    bone = positions[:, _START] - positions[:, _END]
    short = np.einsum("nbi,nbi->nb", bone, bone) < LEAST_BONE_M**2
    short &= observed[:, _START] & observed[:, _END]
    found: Bools = observed & (short @ _FROM_BONE_ON)
    return found


def contradicts(positions: Floats, observed: Bools) -> Bools:
    """Return (n,) whether two joints of a body are too far apart, for bodies (n, J, 3), (n, J)."""
    between = positions[:, :, None] - positions[:, None]
    apart2: Floats = np.einsum("nijk,nijk->nij", between, between)
    both = observed[:, :, None] & observed[:, None]
    found: Bools = np.asarray((both & (apart2 > _MOST_APART_2)).any(axis=(1, 2)))
    return found


def out_of_reach(positions: Floats, observed: Bools) -> tuple[Bools, bool]:
    """Return (J,) whether observed canonical joints are farther from others than bones allow.

    Also returns whether the joint map must be wrong, because this holds for more than ``MISNAMED``
    of a whole body's joints; then none is marked.

    The joint that is too far from most others is disbelieved first, then the next, until the rest
    agree. If only two joints contradict each other, both are disbelieved.

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
    misnamed = len(where) >= WHOLE_BODY_JOINTS and bool(wrong.sum() > MISNAMED * len(where))
    return (np.zeros_like(wrong) if misnamed else wrong), misnamed
