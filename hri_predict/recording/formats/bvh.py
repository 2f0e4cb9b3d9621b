"""Reads BVH files with ``bvhio``; the forward kinematics of all frames at once is our own.

``bvh_writer`` writes them.

BVH: each joint has an offset from its parent, and channels per frame. World pose of a joint:
``G_j = G_parent R_j``, ``p_j = p_parent + G_parent t_j``, where ``R_j`` is the product of its axis
rotations in the order of its channels and ``t_j`` its offset, or its position channels.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.arrays import Floats
from hri_predict.errors import ConfigError, RecordingError
from hri_predict.joint_map import JointMap
from hri_predict.recording.bounded import read_bounded
from hri_predict.recording.formats.bvh_writer import AXES, CM_PER_M
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_rate, recording_of_one
from hri_predict.recording.rig import map_of_rig

MAX_FRAMES = 10_000_000


def read_bvh(
    path: Path, person: int, unit_m: float | None = None, axes: Sequence[str] | None = None
) -> Recording:
    """Read a BVH file; common joint names are known, see ``check_known``.

    Args:
        path: the file.
        person: the id for the body.
        unit_m: metres per unit of the file; default 0.01, centimetres (BVH does not say).
        axes: the file's axes that are forward, left and up; default y up (BVH does not say).

    Raises:
        RecordingError: the reader is not installed; the file is truncated, empty, or not BVH.
    """
    try:
        import bvhio
    except ImportError as error:
        raise RecordingError(
            f"recording {path}: reading BVH needs bvhio; pip install 'hri-predict[io]'"
        ) from error
    with_ends = _check_complete(path)
    try:
        bvh = bvhio.readAsBvh(str(path))
        names, raw = forward_kinematics(bvh.Root, with_ends)
    except (SyntaxError, ValueError, IndexError, KeyError, TypeError, RecursionError) as error:
        reason = str(error.args[0]) if error.args else type(error).__name__
        raise RecordingError(
            f"recording {path}: not a valid BVH file ({reason}); export it again"
        ) from error
    if not (bvh.FrameTime > 0 and np.isfinite(bvh.FrameTime)):
        raise RecordingError(
            f"recording {path}: 'Frame Time' is {bvh.FrameTime:g} s; it must be above 0"
        )
    rate_hz = 1.0 / max(bvh.FrameTime, 1e-100)  # avoids an overflow; the rate is refused below
    check_rate(path, "'Frame Time'", rate_hz)
    joint_map = _map(names)
    joint_map = joint_map if unit_m is None else joint_map.with_units(unit_m)
    joint_map = joint_map if axes is None else joint_map.with_axes(axes)
    return recording_of_one(
        path=path, kind="bvh", joint_map=joint_map, raw=raw, rate_hz=rate_hz, person=person
    )


def _map(names: Sequence[str]) -> JointMap:
    named = map_of_names(names).with_units(1 / CM_PER_M).with_axes(AXES)
    try:
        rig = map_of_rig(names)
    except ConfigError:
        return named
    return max(rig, named, key=lambda m: int(m.mapped.sum()))  # the first of equals


def _check_complete(path: Path) -> bool:
    """Check that nothing is missing; otherwise the reader would wait forever.

    Returns whether every chain ends in an "End Site" (otherwise a leaf's end is unknown).
    """
    try:
        text = read_bounded(path)
        if b"\0" in text[:4096]:
            raise RecordingError(f"recording {path}: not a BVH file (not text)")
        lines = [line for line in text.decode("utf-8").splitlines() if line.strip()]
    except UnicodeDecodeError as error:
        raise RecordingError(f"recording {path}: not a BVH file (not text)") from error
    heads = [line.split()[0] for line in lines]
    if not heads or heads[0] != "HIERARCHY":
        raise RecordingError(f"recording {path}: not a BVH file; it must begin with HIERARCHY")
    if "MOTION" not in heads:
        raise RecordingError(f"recording {path}: truncated (no MOTION part); export it again")
    motion = heads.index("MOTION")
    header = [line.split() for line in lines[motion + 1 : motion + 3]]
    if len(header) < 2 or header[0][0] != "Frames:" or len(header[0]) != 2:
        raise RecordingError(f"recording {path}: truncated (no 'Frames:' line); export it again")
    try:
        frames = int(header[0][1])
    except ValueError:
        frames = -1
    if frames < 1:
        raise RecordingError(
            f"recording {path}: is empty ('Frames: {header[0][1]}'); choose another"
        )
    there = len(lines) - motion - 3
    if frames > min(there, MAX_FRAMES):
        raise RecordingError(
            f"recording {path}: truncated: {max(there, 0)} of {frames} frames are there; "
            f"export it again"
        )
    channels = sum(map(_channels, lines[:motion]))
    short = [
        k for k, line in enumerate(lines[motion + 3 :][:frames]) if len(line.split()) < channels
    ]
    if short:
        raise RecordingError(
            f"recording {path}: truncated: frame {short[0]} has fewer than {channels} values; "
            f"export it again"
        )
    return _every_leaf_ends(heads[:motion])


def _channels(line: str) -> int:
    """Number of values that this line gives a frame; the reader itself refuses text."""
    words = line.split()
    if words[0] != "CHANNELS" or len(words) < 2:
        return 0
    try:
        return max(0, int(words[1]))
    except ValueError:
        return 0


def _every_leaf_ends(tree: list[str]) -> bool:
    """Whether every joint has a child or an End Site."""
    inside: list[bool] = []
    for word in tree:
        if word in ("JOINT", "ROOT"):
            if inside:
                inside[-1] = True
            inside.append(False)
        elif word == "End" and inside:
            inside[-1] = True
            inside.append(True)
        elif word == "}" and inside and not inside.pop():
            return False
    return True


def forward_kinematics(root: Any, with_ends: bool) -> tuple[list[str], Floats]:
    """Joint names and world positions (F, J, 3), in the file's units and axes.

    End sites are named after their joint: ``<joint>_End``.
    """
    names: list[str] = []
    columns: list[Floats] = []

    def visit(joint: Any, origin: Floats, basis: Floats) -> None:
        local = np.array([[k.Position.x, k.Position.y, k.Position.z] for k in joint.Keyframes])
        turns = np.array(
            [[k.Rotation.w, k.Rotation.x, k.Rotation.y, k.Rotation.z] for k in joint.Keyframes]
        )
        here = origin + np.einsum("fij,fj->fi", basis, local)
        turned = basis @ _matrices(turns)
        names.append(joint.Name)
        columns.append(here)
        for child in joint.Children:
            visit(child, here, turned)
        if not joint.Children and with_ends:
            end = np.array([joint.EndSite.x, joint.EndSite.y, joint.EndSite.z])
            names.append(f"{joint.Name}_End")
            columns.append(here + turned @ end)

    frames = len(root.Keyframes)
    with np.errstate(all="ignore"):  # absurd numbers become NaN or infinite: not observed
        visit(root, np.zeros((frames, 3)), np.broadcast_to(np.eye(3), (frames, 3, 3)))
    return names, np.stack(columns, axis=1)


def _matrices(wxyz: Floats) -> Floats:
    """(F, 4) quaternions to (F, 3, 3) rotation matrices."""
    w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)
