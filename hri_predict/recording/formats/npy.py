"""Joints of one person as a single NumPy array, as FreeMoCap saves them.

FreeMoCap (https://github.com/freemocap/freemocap, split_and_save.py and path_getters.py) writes
``output_data/mediapipe_body_3d_xyz.npy``: (F, 33, 3), MediaPipe's landmarks in millimetres; and
``mediapipe_skeleton_3d.npy``, or ``mediapipe_3dData_numFrames_numTrackedPoints_spatialXYZ.npy``,
with hands and, in most versions, the face after the body. Neither file has names or times.
"""

import tokenize
from pathlib import Path

import numpy as np

from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording.bounded import check_joints
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, noted, recording_of_one
from hri_predict.recording.wanted import Wanted

POINTS = {33: "", 75: "hands", 543: "hands and face", 553: "hands and face"}
"""Number of points in an array -> the points after MediaPipe's body, which are not used."""
UNIT_M = 0.001
_BROKEN: tuple[type[Exception], ...] = (ValueError, EOFError, SyntaxError, MemoryError)
_BROKEN += (OverflowError, RecursionError, TypeError, tokenize.TokenError)
"""Exceptions that a damaged header can raise."""


def read_npy(path: Path, wanted: Wanted) -> Recording:
    """Read an array of FreeMoCap; in millimetres, z up if nothing else is wanted.

    Raises:
        RecordingError: the array is damaged, has another shape, or ``wanted.rate_hz`` is not given.
        ConfigError: impossible units or axes.
    """
    try:
        array = np.lib.format.open_memmap(path, mode="r")  # np.load would open a zip, too
    except _BROKEN as error:
        raise RecordingError(
            f"recording {path}: truncated, or not an array of numbers; copy it again"
        ) from error
    known = array.ndim == 3 and array.shape[1] in POINTS and array.shape[2] == 3
    if not known or not len(array) or array.dtype.kind not in "fiu":
        raise RecordingError(
            f"recording {path}: is an array of {array.dtype} of shape {array.shape}; the "
            f"only single arrays read are FreeMoCap's (frames, {' or '.join(map(str, POINTS))}, 3);"
            f" save other arrays as .npz with 'joints', 'joint_names' and 'fps'"
        )
    rate_hz = wanted.rate_of(path)
    names = load_joint_map("mediapipe33").source_joints
    check_joints(path, len(array), 1, len(names))
    joint_map = wanted.of_file(map_of_names(names), UNIT_M)
    body = np.array(array[:, : len(names)], np.float64)
    recording = recording_of_one(
        path, "npy", joint_map, body, rate_hz=rate_hz, person=wanted.person
    )
    after = POINTS[array.shape[1]]
    return noted(recording, f"{after} are not used" if after else "")
