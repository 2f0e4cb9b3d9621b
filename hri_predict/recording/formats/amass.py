"""NumPy archives in the style of AMASS: joints of one person, and the capture rate.

AMASS (https://amass.is.tue.mpg.de; Mahmood et al., ICCV 2019) keeps parameters of the SMPL body
model. Only the body model turns these parameters into joints; the model is licensed, and we may not
ship it. This module reads joints that were computed and saved in addition to the parameters or
instead of them.

| key | shape | what |
|---|---|---|
| ``joints`` or ``Jtr`` | (F, J, 3) | metres, z up |
| ``mocap_framerate``, ``mocap_frame_rate`` or ``fps`` | () | frames per second |
| ``joint_names`` | (J,) | left out: SMPL's names in its order, if J is one of ``BODIES`` |
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.recording.bounded import names_in_zip
from hri_predict.recording.formats.npz import RATES, rate_of, read_arrays, texts
from hri_predict.recording.frames import Written, frames_of_one
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, recording_of_one
from hri_predict.recording.wanted import Wanted

JOINTS = ("joints", "Jtr")
PARAMETERS = ("poses", "trans", "betas", "root_orient", "pose_body", "body_pose")
SMPL = (
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2",
    "left_ankle", "right_ankle", "spine3", "left_foot", "right_foot", "neck",
    "left_collar", "right_collar", "head", "left_shoulder", "right_shoulder",
    "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand",
)  # fmt: skip
"""smplx, joint_names.py; SMPL-H and SMPL-X have the first 22, then fingers."""
BODIES = {22: 22, 24: 24, 45: 24, 52: 22, 55: 22, 73: 22, 127: 22, 144: 22}
"""Number of joints in a file -> how many of them, from the first, are SMPL's. Models with other
numbers (25 of OpenPose or Kinect, 44 of SPIN) have other joints or orders; the file must name
them."""


def is_amass(path: Path) -> bool:
    """Whether an archive has AMASS keys, and no keys of the data pack."""
    names = {name.removesuffix(".npy") for name in names_in_zip(path) or ()}
    return bool(names & {*JOINTS, *PARAMETERS}) and not names & {"positions_world", "positions"}


def read_amass(path: Path, wanted: Wanted) -> Recording:
    """Read the joints of an AMASS archive; in metres, x forward and z up if nothing else is wanted.

    Raises:
        RecordingError: the archive is damaged, has other shapes, or has only the body model's
            parameters.
        ConfigError: impossible units or axes.
    """
    arrays = read_arrays(path, {*JOINTS, *RATES, "joint_names"})
    key = next((k for k in JOINTS if arrays.get(k) is not None), None)
    if key is None:
        raise RecordingError(
            f"recording {path}: contains only SMPL body-model parameters, and computing joints "
            f"requires the licensed model; compute the joints with the model, and add them as "
            f"'joints' (frames, joints, 3), metres"
        )
    raw = np.asarray(arrays[key])
    if raw.ndim == 3 and not len(raw):
        raise RecordingError(f"recording {path}: '{key}' has no frames; record again")
    if raw.ndim != 3 or raw.shape[2] != 3 or 0 in raw.shape or raw.dtype.kind not in "fiu":
        raise RecordingError(
            f"recording {path}: '{key}' is {raw.dtype} of shape {raw.shape}; expected numbers of "
            f"shape (frames, joints, 3)"
        )
    joint_map = wanted.of_file(map_of_names(_names(path, arrays, raw.shape[1])), 1.0)
    rate_hz = rate_of(path, arrays, "mocap_framerate")
    values = raw.astype(np.float64)
    return recording_of_one(path, "amass", joint_map, values, rate_hz=rate_hz, person=wanted.person)


def _names(path: Path, arrays: Mapping[str, Any], count: int) -> list[str]:
    if arrays.get("joint_names") is None:
        known = SMPL[: BODIES.get(count, 0)]
        return [*known, *(f"joint_{k}" for k in range(len(known), count))]
    names = texts(arrays["joint_names"])
    if len(names) != count or len(set(names)) != count:
        raise RecordingError(
            f"recording {path}: 'joint_names' has {len(set(names))} different names for {count} "
            f"joints; give each joint its own name"
        )
    return names


def write_amass(path: Path, recording: Recording) -> Written:
    """Write one person: ``joints`` (32-bit), ``joint_names``, ``mocap_framerate``; NaN: not seen.

    The archive contains no body-model parameters.
    """
    frames = frames_of_one(recording)
    joints: Floats = frames.positions[:, 0]
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            joints=joints.astype(np.float32),
            joint_names=np.array(frames.joints),
            mocap_framerate=np.float64(frames.rate_hz),
        )
    return frames.written
