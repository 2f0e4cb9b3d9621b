"""The skeleton of the CMU benchmark: 38 joints with one set of bones for all people, 25 predicted.

The exponential maps have 38 joints. Six are constant in the benchmark's pose, in which the root
neither turns nor moves, and seven coincide with another joint. The other 25 are predicted; the
error is taken over all 38 (Mao et al., "Learning Trajectory Dependencies for Human Motion
Prediction", ICCV 2019, and later work).
"""

import numpy as np

from hri_predict.base.skeleton import Skeleton, make_skeleton

# name, parent, offset from the parent in the units of the ASF file, y up, x to the left, z forward
_TABLE = (
    ("Hips", -1, (0.0, 0.0, 0.0)),
    ("LHipJoint", 0, (0.0, 0.0, 0.0)),
    ("LeftUpLeg", 1, (1.65674, -1.80282, 0.62477)),
    ("LeftLeg", 2, (2.5972, -7.13576, 0.0)),
    ("LeftFoot", 3, (2.49236, -6.8477, 0.0)),
    ("LeftToeBase", 4, (0.19704, -0.54136, 2.14581)),
    ("LeftToeBase_End", 5, (0.0, 0.0, 1.11249)),
    ("RHipJoint", 0, (0.0, 0.0, 0.0)),
    ("RightUpLeg", 7, (-1.6107, -1.80282, 0.62476)),
    ("RightLeg", 8, (-2.59502, -7.12977, 0.0)),
    ("RightFoot", 9, (-2.4678, -6.78024, 0.0)),
    ("RightToeBase", 10, (-0.23024, -0.63258, 2.13368)),
    ("RightToeBase_End", 11, (0.0, 0.0, 1.11569)),
    ("LowerBack", 0, (0.0, 0.0, 0.0)),
    ("Spine", 13, (0.01961, 2.0545, -0.14112)),
    ("Spine1", 14, (0.01021, 2.06436, -0.05921)),
    ("Neck", 15, (0.0, 0.0, 0.0)),
    ("Neck1", 16, (0.00713, 1.56711, 0.14968)),
    ("Head", 17, (0.03429, 1.56041, -0.10006)),
    ("Head_End", 18, (0.01305, 1.6256, -0.05265)),
    ("LeftShoulder", 15, (0.0, 0.0, 0.0)),
    ("LeftArm", 20, (3.54205, 0.90436, -0.17364)),
    ("LeftForeArm", 21, (4.86513, 0.0, 0.0)),
    ("LeftHand", 22, (3.35554, 0.0, 0.0)),
    ("LeftFingerBase", 23, (0.0, 0.0, 0.0)),
    ("LeftHandIndex1", 24, (0.66117, 0.0, 0.0)),
    ("LeftHandIndex1_End", 25, (0.53306, 0.0, 0.0)),
    ("LThumb", 23, (0.0, 0.0, 0.0)),
    ("LThumb_End", 27, (0.5412, 0.0, 0.5412)),
    ("RightShoulder", 15, (0.0, 0.0, 0.0)),
    ("RightArm", 29, (-3.49802, 0.75994, -0.32616)),
    ("RightForeArm", 30, (-5.02649, 0.0, 0.0)),
    ("RightHand", 31, (-3.36431, 0.0, 0.0)),
    ("RightFingerBase", 32, (0.0, 0.0, 0.0)),
    ("RightHandIndex1", 33, (-0.73041, 0.0, 0.0)),
    ("RightHandIndex1_End", 34, (-0.58887, 0.0, 0.0)),
    ("RThumb", 32, (0.0, 0.0, 0.0)),
    ("RThumb_End", 36, (-0.59786, 0.0, 0.59786)),
)

OFFSETS = np.array([row[2] for row in _TABLE])
"""(38, 3) bone vectors in ASF units in the rest pose: x left, y up, z forward."""

MM_PER_UNIT = 70.0
"""The benchmark's factor to "mm"; 1.24 of these are a true millimetre."""

CONSTANT = (0, 1, 2, 7, 8, 13)
DUPLICATES = {16: 15, 20: 15, 29: 15, 24: 23, 27: 23, 33: 32, 36: 32}
"""Indices among the 38: joints fixed in the benchmark's pose, and joints that coincide."""

MOVING = tuple(j for j in range(len(_TABLE)) if j not in CONSTANT and j not in DUPLICATES)
"""Index of each of the 25 predicted joints among the 38."""

_PARTS_38 = {
    "torso": (0, *range(13, 20)),
    "left_arm": tuple(range(20, 29)),
    "right_arm": tuple(range(29, 38)),
    "left_leg": tuple(range(1, 7)),
    "right_leg": tuple(range(7, 13)),
}


def _moving_parent(joint: int) -> int:
    """Index of the nearest ancestor in ``MOVING``; -1 if there is none."""
    parent = _TABLE[joint][1]
    while parent >= 0:
        parent = DUPLICATES.get(parent, parent)
        if parent in MOVING:
            return MOVING.index(parent)
        parent = _TABLE[parent][1]
    return -1


def _pairs(names: list[str]) -> list[tuple[int, int]]:
    """Left and right joints of the same name."""
    other = {"Left": "Right", "LHip": "RHip", "LThumb": "RThumb"}
    found = []
    for i, name in enumerate(names):
        for left, right in other.items():
            if name.startswith(left):
                found.append((i, names.index(right + name[len(left) :])))
    return found


def _skeleton(name: str, joints: tuple[int, ...], parents: list[int]) -> Skeleton:
    names = [_TABLE[j][0] for j in joints]
    parts = {
        part: tuple(i for i, j in enumerate(joints) if j in members)
        for part, members in _PARTS_38.items()
    }
    return make_skeleton(name, names, parents, left_right_pairs=_pairs(names), parts=parts)


CMU38: Skeleton = _skeleton("cmu38", tuple(range(len(_TABLE))), [row[1] for row in _TABLE])
"""All joints; exponential maps belong to these."""

CMU25: Skeleton = _skeleton("cmu25", MOVING, [_moving_parent(j) for j in MOVING])
"""The joints that are predicted."""
