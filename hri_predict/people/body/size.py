"""Checks that a body is of human size, to detect wrong units such as millimetres sent as metres.

A tracker with units other than configured puts people a thousand times too far away, or a whole
body into one point at its own origin. No other check detects this: such a body moves as smoothly as
a real one.
"""

from collections.abc import Sequence

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL

MIDDLE_M = 2.0
"""Maximum distance of a joint from the body's middle: 1.6 m for a tall man's raised fingers."""
STRAY = 0.25
"""Maximum share of joints beyond that distance for which only the joints are wrong; see
``track``."""
LONG_BONE_M = 0.1
"""Minimum length of the longest limb bone (upper arm, forearm, thigh or shank), even of a child."""
LIMB_BONES = np.array(
    [
        (segment.joint_a, segment.joint_b)
        for segment in CANONICAL.segments
        if segment.name[2:] in ("upper_arm", "forearm", "thigh", "shank")
    ]
)
"""(B, 2) joints at both ends of each."""
_START, _END = LIMB_BONES.T


def are_human_sized(positions: Floats, observed: Bools) -> Bools:
    """Return (n,) whether the observed joints of each body can belong to one human.

    A single joint has no size, and without an observed long bone a body cannot be too small.

    Args:
        positions: (n, J, 3) metres, canonical joints; finite where observed.
        observed: (n, J); a body without any is not judged, and counts as human-sized.
    """
    fits = _fit(positions, observed)
    if not fits.all():
        odd = ~fits
        count = observed[odd].sum(axis=1)
        fits[odd] = _strays(positions[odd], observed[odd], count) <= STRAY * count
    whole = observed[:, _START] & observed[:, _END]
    bones = np.where(whole, norm(positions[:, _START] - positions[:, _END]), 0.0)
    result: Bools = fits & (~whole.any(axis=1) | (bones.max(axis=1) > LONG_BONE_M))
    return result


def most_are_not_human_sized(bodies: Sequence[tuple[Floats, Bools]]) -> bool:
    """Return whether most bodies (J, 3), (J,) are not of human size; false without bodies."""
    if not bodies:
        return False
    positions, observed = map(np.stack, zip(*bodies, strict=True))
    return bool(2 * np.count_nonzero(~are_human_sized(positions, observed)) > len(bodies))


def _fit(positions: Floats, observed: Bools) -> Bools:
    """Return whether the box around all joints, and their middle, is too small for a stray."""
    seen = observed[..., None]
    highest = np.where(seen, positions, -np.inf).max(axis=1)
    box = highest - np.where(seen, positions, np.inf).min(axis=1)
    return np.asarray((norm(box) < MIDDLE_M) | ~observed.any(axis=1))


def _strays(positions: Floats, observed: Bools, count: Ints) -> Ints:
    """Return the number of joints far from the middle, the median of each coordinate."""
    ordered = np.sort(np.where(observed[..., None], positions, np.inf), axis=1)  # unseen ones last
    body = np.arange(len(ordered))
    middle = (ordered[body, (count - 1) // 2] + ordered[body, count // 2]) / 2
    away = norm(positions - middle[:, None]) > MIDDLE_M
    return np.asarray((away & observed).sum(axis=1))
