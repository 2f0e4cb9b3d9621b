"""Whether a body is as large as people are: who sends millimetres as metres is far off otherwise.

A tracker whose units are not as configured puts everybody a thousand times too far away, or all
into one point at its own origin. Nothing else shows it: such a body moves as evenly as a true one.
"""

import numpy as np

from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import CANONICAL

MIDDLE_M = 2.0
"""No joint is farther from the middle of its body: a tall man's fingers are 1.6 m, arms raised."""
STRAY = 0.25
"""Up to this share of joints beyond is a fault of those joints; see ``hri_predict.track``."""
LONG_BONE_M = 0.1
"""The longest of somebody's upper arms, forearms, thighs and shanks is longer, a child's too."""
_LONG = np.array(
    [
        (segment.joint_a, segment.joint_b)
        for segment in CANONICAL.segments
        if segment.name[2:] in ("upper_arm", "forearm", "thigh", "shank")
    ]
)


def is_human_sized(positions: Floats, observed: Bools) -> bool:
    """Whether the observed joints can be those of one body.

    Nothing tells the size of a single joint, nor too small a size where no long bone is observed.

    Args:
        positions: (J, 3) metres, canonical joints; finite where observed.
        observed: (J,) at least one.
    """
    seen = positions[observed]
    apart = np.linalg.norm(seen - np.median(seen, axis=0), axis=1)
    if np.count_nonzero(apart > MIDDLE_M) > STRAY * len(seen):
        return False
    long = _LONG[observed[_LONG].all(axis=1)]
    bones = np.linalg.norm(positions[long[:, 0]] - positions[long[:, 1]], axis=1)
    return not bones.size or bool(bones.max() > LONG_BONE_M)
