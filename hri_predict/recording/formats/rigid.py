"""Rigid bones that follow joints: rotations that bring a hierarchy close to given positions.

Every bone has its own rotation, so only its length can be wrong. It starts at the computed end of
its parent and is turned the shortest way towards the true place of its joint (positions do not show
twist about a bone). A joint that carries several bones gets the rotation that fits their ends best
(Kabsch, "A solution for the best rotation to relate two sets of vectors", Acta Cryst. A32, 1976).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats

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
    """(F, 3, 3) rotation of a joint that brings its bones' ends to ``ends`` (F, C, 3) from it."""
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
