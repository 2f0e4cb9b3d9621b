"""Checks that a body is of human size, to detect wrong units such as millimetres sent as metres.

A tracker with units other than configured puts people a thousand times too far away, or a whole
body into one point at its own origin. No other check detects this: such a body moves as smoothly as
a real one.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import CANONICAL

MIDDLE_M = 2.0
"""Maximum distance of a joint from the body's middle: 1.6 m for a tall man's raised fingers."""
STRAY = 0.25
"""Maximum share of joints beyond that distance for which only the joints are wrong; see
``track``."""
LONG_BONE_M = 0.1
"""Minimum length of the longest limb bone (upper arm, forearm, thigh or shank), even of a child."""
_LONG = np.array(
    [
        (segment.joint_a, segment.joint_b)
        for segment in CANONICAL.segments
        if segment.name[2:] in ("upper_arm", "forearm", "thigh", "shank")
    ]
)
_START, _END = _LONG.T


def is_human_sized(positions: Floats, observed: Bools) -> bool:
    """Return whether the observed joints can belong to one human body.

    A single joint has no size, and without an observed long bone a body cannot be too small.

    Args:
        positions: (J, 3) metres, canonical joints; finite where observed.
        observed: (J,) at least one.
    """
    seen = positions[observed]
    if not _fits(seen) and _strays(seen) > STRAY * len(seen):
        return False
    whole = observed[_START] & observed[_END]
    bones = norm(positions[_START] - positions[_END])[whole]
    return not bones.size or float(bones.max()) > LONG_BONE_M


def _fits(seen: Floats) -> bool:
    """Return whether the box around all joints, and their middle, is too small for a stray."""
    x, y, z = (np.maximum.reduce(seen) - np.minimum.reduce(seen)).tolist()
    return bool(x * x + y * y + z * z < MIDDLE_M**2)


def _strays(seen: Floats) -> int:
    """Return the number of joints far from the middle, the median of each coordinate."""
    count = len(seen)
    ordered = np.sort(seen, axis=0)
    middle = (ordered[(count - 1) // 2] + ordered[count // 2]) / 2
    return int(np.count_nonzero(norm(seen - middle) > MIDDLE_M))
