"""Reads BVH files; ``bvh_text`` reads their text, ``bvh_writer`` writes them.

BVH: each joint has an offset from its parent, and channels per frame. World pose of a joint: ``G_j
= G_parent R_j``, ``p_j = p_parent + G_parent t_j``, where ``R_j`` is the product of its axis
rotations in the order of its channels and ``t_j`` its offset; a position channel replaces the
offset along its axis. Each ROOT is a body.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.contracts.joint_map import JointMap
from hri_predict.recording.bounded import check_joints, read_text
from hri_predict.recording.formats.bvh_text import CHANNEL, Bvh, BvhError, BvhNode, parse_bvh
from hri_predict.recording.formats.bvh_writer import AXES, CM_PER_M
from hri_predict.recording.labels import MAX_ID
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_rate, noted, recording_of
from hri_predict.recording.rig import map_of_rig
from hri_predict.recording.shared_affix import without_shared
from hri_predict.recording.wanted import Wanted

_ABSURD = 1e6  # degrees: no rig counts thousands of turns; its sine would be noise
_AT_ONCE = 4096  # frames; bounds the memory of the rotations


def read_bvh(path: Path, wanted: Wanted) -> Recording:
    """Read a BVH file; common joint names are known, see ``check_known``.

    Bodies of further roots get the next ids. BVH states neither units nor axes: by default, the
    unit is the centimetre and y is up.

    Raises:
        RecordingError: the file is truncated, empty, or not BVH.
    """
    try:
        bvh = parse_bvh(read_text(path, "a BVH file"))
        names, columns = _bodies(bvh.nodes)
    except BvhError as error:
        raise RecordingError(f"recording {path}: {error}") from error
    rate_hz = 1.0 / max(bvh.frame_time_s, 1e-100)  # avoids an overflow; the rate is refused below
    check_rate(path, "'Frame Time'", rate_hz)
    check_joints(path, len(bvh.values), 1, len(bvh.nodes))
    joint_map = wanted.of_file(_map(names), None)
    ids = [(wanted.person + k) % (MAX_ID + 1) for k in range(len(columns))]
    points = forward_kinematics(bvh)[:, columns]
    recording = recording_of(path, "bvh", joint_map, points, rate_hz=rate_hz, ids=ids)
    roots = [node.name for node in bvh.nodes if node.parent < 0]
    if len(roots) > 1:
        bvh.notes.extend(f"'{root}' is person {n}" for root, n in zip(roots, ids, strict=True))
    return noted(recording, "; ".join(bvh.notes))


def _map(names: Sequence[str]) -> JointMap:
    named = map_of_names(names).with_units(1 / CM_PER_M).with_axes(AXES)
    try:
        rig = map_of_rig(names)
    except ConfigError:
        return named
    return max(rig, named, key=lambda m: int(m.mapped.sum()))  # the first of equals


def _bodies(nodes: Sequence[BvhNode]) -> tuple[list[str], list[list[int]]]:
    """Return the names of a body's joints and, for each body, the corresponding nodes.

    Raises:
        BvhError: bodies of one file have different joints.
    """
    bodies: list[list[int]] = []
    for k, node in enumerate(nodes):
        if node.parent < 0:
            bodies.append([])
        bodies[-1].append(k)
    names = [[nodes[k].name for k in body] for body in bodies]
    if len(bodies) == 1:
        return names[0], bodies
    bare = [without_shared(own) for own in names]
    if any(own != bare[0] for own in bare):
        raise BvhError(
            f"has {len(bodies)} roots with different joints; export each body into its own file"
        )
    return bare[0], bodies


def forward_kinematics(bvh: Bvh) -> Floats:
    """World positions (F, nodes, 3), in the file's units and axes."""
    points = np.empty((len(bvh.values), len(bvh.nodes), 3))
    with np.errstate(all="ignore"):  # absurd numbers become NaN or infinite: not observed
        for at in range(0, len(points), _AT_ONCE):
            points[at : at + _AT_ONCE] = _placed(bvh.nodes, bvh.values[at : at + _AT_ONCE])
    return points


def _placed(nodes: Sequence[BvhNode], values: Floats) -> Floats:
    frames = len(values)
    points = np.empty((frames, len(nodes), 3))
    turned: list[Floats] = []  # (F, 3, 3) of each node: its axes as columns
    for k, node in enumerate(nodes):
        local = np.tile(np.asarray(node.offset, np.float64), (frames, 1))
        root = node.parent < 0
        basis = np.tile(np.eye(3), (frames, 1, 1)) if root else turned[node.parent]
        own = basis
        for column, channel in enumerate(node.channels, start=node.column):
            if (match := CHANNEL.fullmatch(channel)) is None:
                continue  # a scale of 1
            axis = "xyz".index(match[1].lower())
            if match[2].lower() == "position":
                local[:, axis] = values[:, column]
            else:
                angles = np.where(np.abs(values[:, column]) < _ABSURD, values[:, column], np.nan)
                own = _turned(own, axis, np.radians(angles))
        points[:, k] = np.einsum("fij,fj->fi", basis, local)
        if not root:
            points[:, k] += points[:, node.parent]
        turned.append(own)
    return points


def _turned(basis: Floats, axis: int, angle: Floats) -> Floats:
    """(F, 3, 3) ``basis`` times the rotations by ``angle`` (F,) about its own axis."""
    cosine, sine = np.cos(angle)[:, None], np.sin(angle)[:, None]
    second, third = (axis + 1) % 3, (axis + 2) % 3
    turned = basis.copy()
    turned[:, :, second] = cosine * basis[:, :, second] + sine * basis[:, :, third]
    turned[:, :, third] = cosine * basis[:, :, third] - sine * basis[:, :, second]
    return turned
