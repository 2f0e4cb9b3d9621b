"""Converts the local poses of an avatar's bones to global positions.

Names and hierarchy are those of Unity's ``HumanBodyBones``, which VMC uses. A bone's local pose is
in its parent's frame; the parent is the nearest of these bones that the avatar has (UpperChest,
Chest, Neck, shoulders and toes are optional in VRM). Unity's frame is left-handed: x to the right,
y up, z forward. A quaternion (x, y, z, w) turns a vector in it by the same formula as in a
right-handed frame, so positions are added up in Unity's frame and mirrored by the joint map:
forward, left, up = z, -x, y.
"""

import math
from collections.abc import Collection, Iterable, Mapping

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import rotation_of

ROOT = "root"
HIPS = "Hips"

Pose = tuple[float, ...]
"""Position x, y, z in metres, then the quaternion x, y, z, w."""


def _limb(side: str, start: str, *names: str) -> dict[str, str]:
    bones = [f"{side}{name}" for name in names]
    return dict(zip(bones, [start, *bones[:-1]], strict=True))


PARENTS = {"Spine": HIPS, "Chest": "Spine", "UpperChest": "Chest", "Neck": "UpperChest",
           "Head": "Neck"}  # fmt: skip
for _side in ("Left", "Right"):
    PARENTS |= _limb(_side, "UpperChest", "Shoulder", "UpperArm", "LowerArm", "Hand")
    PARENTS |= _limb(_side, HIPS, "UpperLeg", "LowerLeg", "Foot", "Toes")
NAMES = (HIPS, *PARENTS)
"""All bones needed for joint positions, parents before children."""


def needed(joints: Iterable[str]) -> frozenset[str]:
    """The bones that determine the positions of these: themselves and all possible ancestors."""
    found = set()
    for joint in joints:
        bone: str | None = joint if joint in NAMES else None
        while bone is not None:
            found.add(bone)
            bone = PARENTS.get(bone)
    return frozenset(found)


def parent_of(bone: str, bones: Collection[str]) -> str | None:
    """The nearest ancestor that the avatar has; ``None`` for the hips."""
    parent = PARENTS.get(bone)
    while parent is not None and parent not in bones:
        parent = PARENTS.get(parent)
    return parent


def global_positions(root: Pose, bones: Mapping[str, Pose]) -> dict[str, Floats]:
    """Positions (3,) of the bones in the root's frame of reference.

    Args:
        root: pose of the avatar's root.
        bones: local poses; ``Hips`` among them.
    """
    frames: dict[str | None, tuple[Floats, Floats]] = {
        None: (np.array(root[:3]), rotation(root[3:]))
    }
    for name in NAMES:
        pose = bones.get(name)
        if pose is not None:
            origin, turn = frames[parent_of(name, bones)]
            frames[name] = (origin + turn @ np.array(pose[:3]), turn @ rotation(pose[3:]))
    return {name: frame[0] for name, frame in frames.items() if name is not None}


def rotation(quaternion: Pose) -> Floats:
    """(3, 3) of a quaternion x, y, z, w of any length but zero."""
    length = math.hypot(*quaternion)
    return rotation_of([each / length for each in quaternion])
