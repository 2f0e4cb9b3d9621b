"""The skeleton of the trained predictors: canonical joints and those that training data adds.

Training data marks more of the body than most sensors: the balls of the feet, the upper spine, the
knuckles and thumbs. The trained predictors work on all 28 joints that move (the pelvis, the hips
and the 25 of the CMU benchmark) and treat joints that a source lacks as unobserved. A joint has the
canonical name if it is the same point.
"""

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, Skeleton, make_skeleton

# name, parent, joint of cmu38
_TABLE = (
    ("pelvis", -1, 0),
    ("l_hip", 0, 2),
    ("l_knee", 1, 3),
    ("l_ankle", 2, 4),
    ("l_ball", 3, 5),
    ("l_foot", 4, 6),
    ("r_hip", 0, 8),
    ("r_knee", 6, 9),
    ("r_ankle", 7, 10),
    ("r_ball", 8, 11),
    ("r_foot", 9, 12),
    ("torso", 0, 14),
    ("chest", 11, 15),
    ("cervical", 12, 17),
    ("skull_base", 13, 18),
    ("head", 14, 19),
    ("l_shoulder", 12, 21),
    ("l_elbow", 16, 22),
    ("l_wrist", 17, 23),
    ("l_knuckles", 18, 25),
    ("l_hand", 19, 26),
    ("l_thumb", 18, 28),
    ("r_shoulder", 12, 30),
    ("r_elbow", 22, 31),
    ("r_wrist", 23, 32),
    ("r_knuckles", 24, 34),
    ("r_hand", 25, 35),
    ("r_thumb", 24, 37),
)

CMU38 = tuple(row[2] for row in _TABLE)
"""Index of each joint of ``BODY`` among the 38 of the CMU benchmark."""

BODY_PARTS = {
    "torso": (0, 11, 12, 13, 14, 15),
    "left_arm": (16, 17, 18, 19, 20, 21),
    "right_arm": (22, 23, 24, 25, 26, 27),
    "left_leg": (1, 2, 3, 4, 5),
    "right_leg": (6, 7, 8, 9, 10),
}

BODY: Skeleton = make_skeleton(
    "body28",
    [row[0] for row in _TABLE],
    [row[1] for row in _TABLE],
    left_right_pairs=[
        (i, [r[0] for r in _TABLE].index("r_" + row[0][2:]))
        for i, row in enumerate(_TABLE)
        if row[0].startswith("l_")
    ],
    parts=BODY_PARTS,
)

_SHARED = tuple(
    (i, CANONICAL.joints.index(name))
    for i, name in enumerate(BODY.joints)
    if name in CANONICAL.joints
)
SHARED_BODY = tuple(pair[0] for pair in _SHARED)
SHARED_CANONICAL = tuple(pair[1] for pair in _SHARED)
"""Indices of the shared joints in ``BODY`` and in ``CANONICAL``."""


def from_canonical(positions: Floats, observed: Bools) -> tuple[Floats, Bools]:
    """Spread canonical joints (..., 21, 3) over ``BODY`` (..., 28, 3); others are unobserved."""
    body = np.zeros((*positions.shape[:-2], len(BODY.joints), 3))
    seen = np.zeros((*observed.shape[:-1], len(BODY.joints)), dtype=bool)
    body[..., SHARED_BODY, :] = positions[..., SHARED_CANONICAL, :]
    seen[..., SHARED_BODY] = observed[..., SHARED_CANONICAL]
    return body, seen


EXTRAPOLATED_STEPS = 3
"""Number of steps for which a joint keeps moving after its last observation."""
LEVEL_M = 1e-3
"""Minimum horizontal length of the hip or shoulder line for a heading; less is lying sideways."""
