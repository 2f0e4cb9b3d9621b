"""Writes BVH: the canonical skeleton under common rig names, with rigid bones.

A BVH file holds rotations of one hierarchy for one person. So only canonical joints are written,
bone lengths are constant, and an unobserved joint stays where it was last seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS, PARENTS
from hri_predict.contracts.joint_map import axes_rotation
from hri_predict.recording.frames import Written, frames_of_one
from hri_predict.recording.naming import check_known
from hri_predict.recording.recording import Recording

# -- rigid bones that follow joints: rotations that bring a hierarchy close to given positions -----
#
# Every bone has its own rotation, so only its length can be wrong. It starts at the computed end
# of its parent and is turned the shortest way towards the true place of its joint (positions do
# not show twist about a bone). A joint that carries several bones gets the rotation that fits
# their ends best (Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta
# Cryst. A32, 1976).

_PRIOR = 1e-6  # square metres: a rotation that nothing determines stays as in the parent


@dataclass(frozen=True, eq=False)
class Bones:
    """A hierarchy that follows joints.

    Attributes:
        offsets: (J, 3) offset of each joint from its parent, in the rest pose.
        rotations: (F, J, 3, 3) rotation of each joint in its parent's frame.
        positions: (F, J, 3) resulting positions of the joints.
    """

    offsets: Floats
    rotations: Floats
    positions: Floats


def follow(targets: Floats, parents: Sequence[int], rest: Floats) -> Bones:
    """Turn rigid bones towards ``targets``.

    Args:
        targets: (F, J, 3) finite.
        parents: parent of each joint, which precedes it; -1 for the first joint, the root.
        rest: (J, 3) unit directions of the bones in the rest pose; the root's is not used. A joint
            that always coincides with its parent turns only the bones that it carries.
    """
    frames, joints = targets.shape[:2]
    offsets = np.zeros((joints, 3))
    for j in range(1, joints):
        lengths = np.linalg.norm(targets[:, j] - targets[:, parents[j]], axis=-1)
        offsets[j] = rest[j] * np.median(lengths)
    children = [[k for k in range(joints) if parents[k] == j] for j in range(joints)]
    turned = np.empty((frames, joints, 3, 3))
    positions = np.empty_like(targets)
    for j in range(joints):
        before = turned[:, parents[j]] if j else np.broadcast_to(np.eye(3), (frames, 3, 3))
        positions[:, j] = targets[:, 0]
        if j:
            positions[:, j] = positions[:, parents[j]] + before @ offsets[j]
        hanging = [e for c in children[j] for e in (children[c] if not offsets[c].any() else [c])]
        ends = targets[:, hanging] - positions[:, j, None]
        turned[:, j] = _turned(before, offsets[hanging], ends)
    rotations = turned.copy()
    for j in range(1, joints):
        rotations[:, j] = np.swapaxes(turned[:, parents[j]], -1, -2) @ turned[:, j]
    return Bones(offsets, rotations, positions)


def _turned(before: Floats, offsets: Floats, ends: Floats) -> Floats:
    """Return (F, 3, 3) the rotation of a joint that moves its bones' ends to ``ends`` (F, C, 3)."""
    if len(offsets) == 0 or not offsets.any():
        return before
    if len(offsets) == 1:
        return _shortest(before @ offsets[0], ends[:, 0]) @ before
    wanted = np.einsum("fci,cj->fij", ends, offsets) + _PRIOR * before
    u, _, vt = np.linalg.svd(wanted)
    u[..., -1] *= np.sign(np.linalg.det(u @ vt))[:, None]  # a rotation, not a mirror image
    turned: Floats = u @ vt
    return turned


def _shortest(a: Floats, b: Floats) -> Floats:
    """(F, 3, 3) the smallest rotations that turn ``a`` (F, 3) to the directions of ``b``."""
    a, b = _unit(a), _unit(b)
    cosine = np.einsum("fi,fi->f", a, b)
    away = cosine < -1 + 1e-9  # any perpendicular axis is right
    across = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)])
    half = _unit(np.where(away[:, None], _unit(across), a + b))
    # Two reflections (at a, then at the half-way direction), or a half turn about ``across``.
    turn = 2 * np.einsum("fi,fj->fij", half, half) - np.eye(3)
    first = 2 * np.einsum("fi,fj->fij", a, a) - np.eye(3)
    return np.where(away[:, None, None], turn, turn @ first)


def _unit(v: Floats) -> Floats:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    unit: Floats = np.where(length > 1e-12, v / np.maximum(length, 1e-12), [1.0, 0.0, 0.0])
    return unit


def zxy_degrees(m: Floats) -> Floats:
    """(..., 3) angles z, x, y in degrees with Rz Rx Ry = ``m`` (..., 3, 3)."""
    x = np.arcsin(np.clip(m[..., 2, 1], -1.0, 1.0))
    locked = np.abs(m[..., 2, 1]) > 1 - 1e-12  # z and y turn about one axis: all goes to z
    z = np.where(
        locked,
        np.arctan2(m[..., 1, 0], m[..., 0, 0]),
        np.arctan2(-m[..., 0, 1], m[..., 1, 1]),
    )
    y = np.where(locked, 0.0, np.arctan2(-m[..., 2, 0], m[..., 2, 2]))
    return np.degrees(np.stack([z, x, y], axis=-1))


# --------------------------------------------------------------------------------------------------

AXES = ("z", "x", "y")  # forward, left, up
CM_PER_M = 100.0
NAMES = {"waist": "Hips", "torso": "Spine", "neck": "Neck", "head": "Head", "head_top": "HeadTop"}
for _side, _long in (("l_", "Left"), ("r_", "Right")):
    for _joint, _name in (
        ("shoulder", "Arm"), ("elbow", "ForeArm"), ("wrist", "Hand"), ("hand", "HandMiddle1"),
        ("hip", "UpLeg"), ("knee", "Leg"), ("ankle", "Foot"), ("foot", "ToeBase"),
    ):  # fmt: skip
        NAMES[_side + _joint] = _long + _name
HELPERS = {
    "torso": "LowerBack", "head": "Neck1", "l_shoulder": "LeftShoulder",
    "r_shoulder": "RightShoulder", "l_hip": "LHipJoint", "r_hip": "RHipJoint",
}  # fmt: skip
"""Names of the helpers: a joint with several bones has one helper per bone, which turns only that
bone."""
_REST = {"knee": (0, -1, 0), "ankle": (0, -1, 0), "foot": (0, 0, 1)}  # y up, left is +x
_SIDE = {"l_": (1, 0, 0), "r_": (-1, 0, 0)}


def write_bvh(path: Path, recording: Recording) -> Written:
    """Write one person, centimetres with y up.

    Raises:
        ConfigError: the names of the joints are unknown, so the hierarchy is unknown, too; or
            fewer than two canonical joints are ever observed.
    """
    check_known(recording.joint_map)
    frames = frames_of_one(recording)
    source = frames.positions[:, 0]
    mapped, seen = recording.joint_map.map(source, np.isfinite(source[..., 0]))
    ever: Bools = np.asarray(seen.any(axis=0))
    if np.count_nonzero(ever) < 2:
        raise ConfigError("BVH: fewer than two joints of a body are ever observed")
    names, parents, joints = _hierarchy(ever)
    held = _held(mapped, seen) @ axes_rotation(AXES)
    bones = follow(held[:, joints], parents, _rest(names, joints))
    path.write_text(_text(names, parents, bones, frames.rate_hz), encoding="utf-8", newline="\n")

    used = sorted(set(joints))
    written = replace(frames.written, joints=len(used))
    written.dropped["joints that are not canonical"] += int(
        np.count_nonzero(~recording.joint_map.used)
    )
    unseen = int(np.count_nonzero(~seen[:, used]))
    written.dropped["joint positions that were not observed"] += unseen
    if unseen:
        written.notes.append("BVH cannot store missing joints: they stay where they were last seen")
    _measure(written, bones.positions, held[:, joints], seen[:, joints])
    return written


def _measure(written: Written, ours: Floats, true: Floats, seen: Bools) -> None:
    off = np.linalg.norm(ours - true, axis=-1)[seen] * 1000
    written.notes.append(
        f"rigid bones and rotations: the joints are {off.mean():.1f} mm off on average, "
        f"{off.max():.1f} mm at most"
    )


def _held(mapped: Floats, seen: Bools) -> Floats:
    """(F, J, 3) each joint where it was last seen; before that, where it is first seen."""
    index = np.where(seen, np.arange(len(seen))[:, None], -1)
    index = np.maximum.accumulate(index, axis=0)
    index = np.where(index < 0, np.argmax(seen, axis=0), index)
    held: Floats = np.take_along_axis(mapped, index[..., None], axis=0)
    return held


def _hierarchy(ever: Bools) -> tuple[list[str], list[int], list[int]]:
    """Names, parents and canonical joints (a helper's is its parent's), depth first."""
    kept = [j for j in range(len(JOINTS)) if ever[j]]

    def above(j: int) -> int:
        parent = PARENTS[j]
        while parent >= 0 and not ever[parent]:
            parent = PARENTS[parent]
        return parent if parent >= 0 else kept[0]

    names: list[str] = []
    parents: list[int] = []
    joints: list[int] = []

    def visit(j: int, parent: int) -> None:
        children = [k for k in kept if k != kept[0] and above(k) == j]
        here = len(names)
        names.append(NAMES[JOINTS[j]])
        parents.append(parent)
        joints.append(j)
        for child in children:
            hangs_on = here
            if len(children) > 1:
                hangs_on = len(names)
                names.append(HELPERS.get(JOINTS[child], f"To{NAMES[JOINTS[child]]}"))
                parents.append(here)
                joints.append(j)
            visit(child, hangs_on)

    visit(kept[0], -1)
    return names, parents, joints


def _rest(names: list[str], joints: list[int]) -> Floats:
    """(J, 3) bone directions of a person who stands with the arms stretched out sideways."""
    rest = []
    for j in joints:
        side, part = JOINTS[j][:2], JOINTS[j][2:]
        rest.append(_REST.get(part, _SIDE[side]) if side in _SIDE else (0, 1, 0))
    return np.array(rest, dtype=np.float64)


def _text(names: list[str], parents: list[int], bones: Bones, rate_hz: float) -> str:
    lines = ["HIERARCHY"]

    def joint(j: int, depth: int) -> None:
        pad = "\t" * depth
        lines.extend([f"{pad}{'JOINT' if j else 'ROOT'} {names[j]}", f"{pad}{{"])
        lines.append(f"{pad}\tOFFSET {_numbers(bones.offsets[j] * CM_PER_M)}")
        position = "" if j else "Xposition Yposition Zposition "
        turn = "Zrotation Xrotation Yrotation"
        lines.append(f"{pad}\tCHANNELS {3 if j else 6} {position}{turn}")
        children = [k for k, parent in enumerate(parents) if parent == j]
        for child in children:
            joint(child, depth + 1)
        if not children:
            lines.extend([f"{pad}\tEnd Site", f"{pad}\t{{", f"{pad}\t\tOFFSET 0 0 0", f"{pad}\t}}"])
        lines.append(f"{pad}}}")

    joint(0, 0)
    angles = zxy_degrees(bones.rotations).reshape(len(bones.rotations), -1)
    values = np.concatenate([bones.positions[:, 0] * CM_PER_M, angles], axis=1)
    lines += ["MOTION", f"Frames: {len(values)}", f"Frame Time: {1 / rate_hz:.12g}"]
    lines += [_numbers(row) for row in values]
    return "\n".join(lines) + "\n"


def _numbers(values: Floats) -> str:
    return " ".join(f"{v:.6f}" for v in values.tolist())
