"""3DPW's sequences (``sequenceFiles/*/NAME.pkl``): joints of one or two people outdoors.

von Marcard et al., "Recovering Accurate 3D Human Pose in the Wild Using IMUs and a Moving Camera",
ECCV 2018, and the data set's readme: ``jointPositions`` has for each person (F, 72) numbers, the 24
joints of SMPL in metres in the world's frame, one row for each image of a video of 30 frames per
second; ``campose_valid`` (F,) is 0 where the person could not be placed in the camera's images.
Written by Python 2; ``pickled`` reads it without running anything.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.recording.bounded import MAX_BYTES as MAX_JOINT_BYTES
from hri_predict.recording.bounded import check_joints
from hri_predict.recording.formats.amass import SMPL
from hri_predict.recording.formats.pickled import MAX_BYTES, Array, read_pickle
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, noted, recording_of
from hri_predict.recording.wanted import Wanted

KEY = "jointPositions"
RATE_HZ = 30.0
AXES = ("x", "-z", "y")
"""Default for the axes that are forward, left and up: y is up."""
MOST_PEOPLE = 20


def names_3dpw(path: Path) -> bool:
    """Whether a pickle names 3DPW's joints.

    Raises:
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        return KEY.encode() in file.read(MAX_BYTES)


def read_3dpw(path: Path, wanted: Wanted) -> Recording:
    """Read a sequence: all its people, with ids from ``wanted.person`` on.

    Raises:
        RecordingError: the file is another pickle, holds more than data, is damaged or too large.
        ConfigError: impossible units or axes.
    """
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: larger than {MAX_BYTES / 2**20:g} MiB; 3DPW's files are not"
        )
    try:
        content = read_pickle(data)
    except ValueError as error:
        raise RecordingError(
            f"recording {path}: only 3DPW's pickles are read, and this is not one: {error}"
        ) from error
    people = content.get(KEY) if isinstance(content, dict) else None
    if not isinstance(people, list) or not 0 < len(people) <= MOST_PEOPLE:
        raise RecordingError(
            f"recording {path}: holds no '{KEY}' of 3DPW, a list with an array for each person"
        )
    most = MAX_JOINT_BYTES // 8 // len(people)  # before all: one array may stand for each of them
    bodies = [_body(path, each, most) for each in people]
    frames = len(bodies[0])
    if any(len(body) != frames for body in bodies):
        raise RecordingError(
            f"recording {path}: its people have {', '.join(str(len(b)) for b in bodies)} frames; "
            f"3DPW's have the same number"
        )
    check_joints(path, frames, len(bodies), len(SMPL))
    raw = np.stack(bodies, axis=1)
    lost = ~_placed(path, content, raw.shape[:2])
    raw[lost] = np.nan
    joint_map = wanted.of_file(map_of_names(SMPL), 1.0, AXES)
    ids = range(wanted.person, wanted.person + len(bodies))
    recording = recording_of(path, "3dpw", joint_map, raw, rate_hz=RATE_HZ, ids=ids)
    what = f"a person is not placed in {int(lost.sum())} frames ('campose_valid')"
    return noted(recording, what if lost.any() else "")


def _body(path: Path, each: Any, most: int) -> Floats:
    """(F, 24, 3) of a person, of at most ``most`` numbers."""
    try:
        numbers = each.numbers(most) if isinstance(each, Array) else None
    except ValueError as error:
        raise RecordingError(f"recording {path}: '{KEY}' has {error}") from error
    width = 3 * len(SMPL)
    if numbers is None or numbers.ndim != 2 or not numbers.size or numbers.shape[1] != width:
        shape = "not an array" if numbers is None else f"of shape {numbers.shape}"
        raise RecordingError(
            f"recording {path}: '{KEY}' is {shape}; 3DPW's has (frames, {width}) numbers"
        )
    body: Floats = numbers.reshape(len(numbers), len(SMPL), 3)
    return body


def _placed(path: Path, content: Mapping[str, Any], shape: tuple[int, ...]) -> Any:
    """(F, P) whether a person is placed; all are placed if the file does not say."""
    flags = content.get("campose_valid")
    if flags is None:
        return np.ones(shape, np.bool_)
    found = []
    if isinstance(flags, list | tuple) and len(flags) == shape[1]:
        most = MAX_JOINT_BYTES // 8 // len(flags)
        try:
            found = [each.numbers(most) for each in flags if isinstance(each, Array)]
        except ValueError as error:
            raise RecordingError(f"recording {path}: 'campose_valid' has {error}") from error
    if [flag.shape for flag in found] != [shape[:1]] * shape[1]:
        raise RecordingError(
            f"recording {path}: 'campose_valid' does not have one number for each of the "
            f"{shape[0]} frames of {shape[1]} people; copy it again"
        )
    return np.stack(found, axis=1) != 0
