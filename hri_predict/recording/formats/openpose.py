"""OpenPose's keypoints: a folder with a JSON file for each frame (``--write_json FOLDER``).

OpenPose, doc/02_output.md: ``NAME_000000000012_keypoints.json`` holds ``people``, each with
``pose_keypoints_2d`` (x, y, c of 25 joints of BODY_25, or 18 of COCO) and, of calibrated cameras
with ``--3d``, ``pose_keypoints_3d`` (x, y, z, c; c is 0 where a joint was not reconstructed), in
the unit of the calibration. Without ``--3d``, ``pose_keypoints_3d`` is empty: pixels have no place
in the room.
"""

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import RecordingError
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording.bounded import MAX_BYTES, READING, check_joints, watched
from hri_predict.recording.naming import map_of_names
from hri_predict.recording.recording import Recording, check_gaps, noted, recording_of_one
from hri_predict.recording.wanted import Wanted

AXES = ("z", "-x", "-y")
"""Forward, left and up of the first camera: x to the right, y down, z away."""
_COCO = (
    "Nose", "Neck", "RShoulder", "RElbow", "RWrist", "LShoulder", "LElbow", "LWrist",
    "RHip", "RKnee", "RAnkle", "LHip", "LKnee", "LAnkle", "REye", "LEye", "REar", "LEar",
)  # fmt: skip
_NAME = re.compile(r"(.*?)_?(\d{1,15})_keypoints\.json", re.DOTALL)
_MAX_FILE = 2**22
_MIN_SURE = 0.3
_SHOWN = 4


def frames_in(folder: Path) -> list[Path]:
    """The keypoints' files of a folder; empty if the path is not a folder, or cannot be read."""
    try:
        return sorted(path for path in folder.iterdir() if _NAME.fullmatch(path.name))
    except OSError:
        return []


def read_openpose(path: Path, wanted: Wanted) -> Recording:
    """Read all frames of the sequence to which ``path`` belongs; metres in the camera's frame.

    Raises:
        RecordingError: the file is other JSON, has only pixels, shows several people, is damaged or
            too large, or ``wanted.rate_hz`` is not given.
        ConfigError: impossible units or axes.
    """
    match = _NAME.fullmatch(path.name)
    if match is None:
        raise RecordingError(
            f"recording {path}: of .json only OpenPose's are read, NAME_000000000000_keypoints.json"
        )
    found: dict[int, Path] = {}
    others: Counter[str] = Counter()
    for each in frames_in(path.parent):
        other = _NAME.fullmatch(each.name)
        if other is not None and other[1] != match[1]:
            others[other[1]] += 1
        elif other is not None:
            if int(other[2]) in found:
                raise RecordingError(f"recording {each}: its frame is there twice; delete one")
            found[int(other[2])] = each
    numbers = sorted(found)
    files = [found[number] for number in numbers]
    if sum(each.stat().st_size for each in files) > MAX_BYTES:
        raise RecordingError(f"recording {path}: its frames have more than {MAX_BYTES} bytes")
    rows = [_person(each) for each in watched(files, READING, len(files))]
    sizes = {len(row) for row in rows if row is not None}
    if not sizes:
        raise RecordingError(f"recording {path}: shows no person in {len(files)} frames")
    if len(sizes) > 1:
        raise RecordingError(f"recording {path}: has frames of BODY_25 and of COCO; separate them")
    names = _COCO if sizes == {len(_COCO)} else load_joint_map("body25").source_joints
    rate_hz = wanted.rate_of(path)
    check_joints(path, len(rows), 1, len(names))
    nothing = np.full((len(names), 3), np.nan)
    raw = np.stack([nothing if row is None else row for row in rows])
    joint_map = wanted.of_file(map_of_names(names), 1.0, AXES)
    recording = recording_of_one(
        files[0], "openpose", joint_map, raw, rate_hz=rate_hz, person=wanted.person
    )
    return noted(_timed(recording, numbers, files), _left_out(match[1], others))


def _left_out(name: str, others: Counter[str]) -> str:
    """Return a note on the folder's other sequences, with frame counts; "" if none."""
    if not others:
        return ""
    shown = ", ".join(f"{other[:40]!r} ({others[other]})" for other in sorted(others)[:_SHOWN])
    more = len(others) - _SHOWN
    return (
        f"of the folder only the sequence {name[:40]!r} is read, not {shown}"
        f"{f', and {more} more' if more > 0 else ''} (to read another sequence, name one of its "
        f"frames)"
    )


def _timed(recording: Recording, numbers: Sequence[int], files: Sequence[Path]) -> Recording:
    """The recording with the times of its numbered frames."""
    stamps = [round((n - numbers[0]) * 1e9 / recording.rate_hz) for n in numbers]
    check_gaps(recording.path, stamps)
    scenes = [
        replace(scene, stamp_ns=stamp)
        for scene, stamp in zip(recording.scenes, stamps, strict=True)
    ]
    missing = numbers[-1] - numbers[0] + 1 - len(numbers)
    recording = replace(recording, scenes=scenes, arrival_ns=stamps, parts=tuple(files))
    return noted(recording, f"{missing} frames are missing" if missing else "")


def _person(path: Path) -> Floats | None:
    """(J, 3) of the person in a frame, NaN where not reconstructed; ``None`` without a person.

    Raises:
        RecordingError: the frame has only pixels, shows several people, or is not OpenPose's.
    """
    if path.stat().st_size > _MAX_FILE:
        raise RecordingError(f"recording {path}: larger than {_MAX_FILE} bytes; OpenPose's are not")
    try:
        content = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise RecordingError(f"recording {path}: not JSON, or truncated; copy it again") from error
    people = content.get("people") if isinstance(content, dict) else None
    if not isinstance(people, list) or not all(isinstance(each, dict) for each in people):
        raise RecordingError(f"recording {path}: no 'people'; only OpenPose's JSON is read")
    if not people:
        return None
    if len(people) > 1:
        raise RecordingError(
            f"recording {path}: shows {len(people)} people, in an order that changes between "
            f"frames; record one (--number_people_max 1)"
        )
    return _joints(path, people[0])


def _joints(path: Path, person: dict[str, Any]) -> Floats:
    numbers = person.get("pose_keypoints_3d")
    if not numbers:
        raise RecordingError(
            f"recording {path}: has only 2-D pixels, which give no position in the room; record "
            f"with "
            f"calibrated cameras and --3d, or triangulate with Pose2Sim and give its .trc"
        )
    good = isinstance(numbers, list) and all(type(n) in (int, float) for n in numbers)
    if not good or len(numbers) not in (4 * len(_COCO), 100):
        raise RecordingError(
            f"recording {path}: 'pose_keypoints_3d' must have x, y, z and c of 25 joints (BODY_25) "
            f"or 18 (COCO)"
        )
    try:
        table = np.array(numbers, np.float64).reshape(-1, 4)
    except OverflowError as error:
        raise RecordingError(f"recording {path}: a number is too large; copy it again") from error
    table[~(table[:, 3] >= _MIN_SURE), :3] = np.nan
    joints: Floats = table[:, :3]
    return joints
