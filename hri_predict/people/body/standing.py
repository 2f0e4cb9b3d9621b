"""A standing body, for measurements that need an example body."""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.skeleton import JOINTS

_HEIGHT = {"waist": 1.0, "torso": 1.2, "neck": 1.45, "head": 1.6, "head_top": 1.75}
_LIMB = {  # forward, outward, up
    "shoulder": (0.0, 0.18, 1.4), "elbow": (0.0, 0.2, 1.1), "wrist": (0.0, 0.2, 0.85),
    "hand": (0.0, 0.2, 0.68), "hip": (0.0, 0.1, 0.95), "knee": (0.0, 0.1, 0.5),
    "ankle": (0.0, 0.1, 0.1), "foot": (0.18, 0.1, 0.03),
}  # fmt: skip


def standing_body() -> Floats:
    """(J, 3) canonical joints in metres: upright at the origin, facing +x, with its arms down."""
    place = {joint: (0.0, 0.0, z) for joint, z in _HEIGHT.items()}
    for side, sign in (("l_", 1.0), ("r_", -1.0)):
        place |= {side + joint: (x, sign * y, z) for joint, (x, y, z) in _LIMB.items()}
    return np.array([place[joint] for joint in JOINTS])
