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
    frames: dict[str | None, tuple[_Place, _Turn]] = {None: (root[:3], _unit(root[3:]))}
    for name in NAMES:
        pose = bones.get(name)
        if pose is not None:
            (x, y, z), turn = frames[parent_of(name, bones)]
            u, v, w = _turned(turn, pose[:3])
            frames[name] = (x + u, y + v, z + w), _after(turn, _unit(pose[3:]))
    return {name: np.array(frame[0]) for name, frame in frames.items() if name is not None}


# Plain numbers: for one bone at a time, arrays take several times as long.
_Place = tuple[float, ...]
_Turn = tuple[float, ...]


def _unit(quaternion: _Turn) -> _Turn:
    """Return a quaternion of length 1, from one of any length but zero."""
    length = math.hypot(*quaternion)
    return tuple(each / length for each in quaternion)


def _turned(turn: _Turn, vector: _Place) -> _Place:
    """Return the vector, turned: v + 2 w (u x v) + 2 u x (u x v), with u the vector part."""
    (x, y, z, w), (a, b, c) = turn, vector
    i, j, k = 2 * (y * c - z * b), 2 * (z * a - x * c), 2 * (x * b - y * a)
    return a + w * i + y * k - z * j, b + w * j + z * i - x * k, c + w * k + x * j - y * i


def _after(first: _Turn, then: _Turn) -> _Turn:
    """Return the Hamilton product: the turn ``then`` in the frame that ``first`` has turned."""
    (x, y, z, w), (a, b, c, d) = first, then
    return (
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
        w * d - x * a - y * b - z * c,
    )
