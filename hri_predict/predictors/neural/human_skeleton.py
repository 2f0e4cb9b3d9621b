"""The skeleton of Human3.6M: 32 joints with one set of bones for all people, 22 scored.

The offsets are those that its papers' code shares (Mao et al., "Learning Trajectory Dependencies
for Human Motion Prediction", ICCV 2019); 22 joints: Dang et al., "MSR-GCN", ICCV 2021.
"""

import numpy as np

from hri_predict.base.skeleton import Skeleton, make_skeleton

# name, parent, offset from the parent in mm; x to the left, y up, z forward
_TABLE = (
    ("Hips", -1, (0.0, 0.0, 0.0)),
    ("RightUpLeg", 0, (-132.948591, 0.0, 0.0)),
    ("RightLeg", 1, (0.0, -442.894612, 0.0)),
    ("RightFoot", 2, (0.0, -454.206447, 0.0)),
    ("RightToeBase", 3, (0.0, 0.0, 162.767078)),
    ("RightToeBase_End", 4, (0.0, 0.0, 74.999437)),
    ("LeftUpLeg", 0, (132.948826, 0.0, 0.0)),
    ("LeftLeg", 6, (0.0, -442.894413, 0.0)),
    ("LeftFoot", 7, (0.0, -454.20659, 0.0)),
    ("LeftToeBase", 8, (0.0, 0.0, 162.767426)),
    ("LeftToeBase_End", 9, (0.0, 0.0, 74.999948)),
    ("Spine", 0, (0.0, 0.1, 0.0)),
    ("Spine1", 11, (0.0, 233.383263, 0.0)),
    ("Neck", 12, (0.0, 257.077681, 0.0)),
    ("Head", 13, (0.0, 121.134938, 0.0)),
    ("Head_End", 14, (0.0, 115.002227, 0.0)),
    ("LeftShoulder", 12, (0.0, 257.077681, 0.0)),
    ("LeftArm", 16, (0.0, 151.034226, 0.0)),
    ("LeftForeArm", 17, (0.0, 278.882773, 0.0)),
    ("LeftHand", 18, (0.0, 251.733451, 0.0)),
    ("LeftHand_Twin", 19, (0.0, 0.0, 0.0)),
    ("LeftHandThumb", 20, (0.0, 0.0, 99.999627)),
    ("LeftHand_End", 19, (0.0, 100.000188, 0.0)),
    ("LeftHand_EndTwin", 22, (0.0, 0.0, 0.0)),
    ("RightShoulder", 12, (0.0, 257.077681, 0.0)),
    ("RightArm", 24, (0.0, 151.031437, 0.0)),
    ("RightForeArm", 25, (0.0, 278.892924, 0.0)),
    ("RightHand", 26, (0.0, 251.72868, 0.0)),
    ("RightHand_Twin", 27, (0.0, 0.0, 0.0)),
    ("RightHandThumb", 28, (0.0, 0.0, 99.999888)),
    ("RightHand_End", 27, (0.0, 137.499922, 0.0)),
    ("RightHand_EndTwin", 30, (0.0, 0.0, 0.0)),
)
OFFSETS_MM = np.array([row[2] for row in _TABLE])
PARENTS = tuple(row[1] for row in _TABLE)

_NOT_SCORED = (0, 1, 6, 11, 16, 20, 23, 24, 28, 31)
"""Joints that do not move, or lie on another joint."""
SCORED = tuple(j for j in range(len(_TABLE)) if j not in _NOT_SCORED)
_TWINS = {16: 13, 24: 13, 20: 19, 28: 27}

_PARTS = {
    "torso": (11, 12, 13, 14, 15),
    "left_arm": tuple(range(16, 24)),
    "right_arm": tuple(range(24, 32)),
    "left_leg": tuple(range(6, 11)),
    "right_leg": tuple(range(1, 6)),
}


def _skeleton(name: str, joints: tuple[int, ...]) -> Skeleton:
    names = [_TABLE[j][0] for j in joints]
    parents = []
    for joint in joints:
        parent = PARENTS[joint]
        while parent >= 0 and parent not in joints:
            parent = _TWINS.get(parent, PARENTS[parent])
        parents.append(joints.index(parent) if parent >= 0 else -1)
    pairs = [(i, names.index("Right" + n[4:])) for i, n in enumerate(names) if n[:4] == "Left"]
    parts = {
        part: tuple(i for i, j in enumerate(joints) if j in members)
        for part, members in _PARTS.items()
    }
    return make_skeleton(name, names, parents, left_right_pairs=pairs, parts=parts)


HUMAN22: Skeleton = _skeleton("human22", SCORED)
"""The joints whose positions are predicted and scored."""

HUMAN32: Skeleton = _skeleton("human32", tuple(range(len(_TABLE))))
"""All joints; exponential maps belong to these."""
