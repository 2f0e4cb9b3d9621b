"""Folders of OpenPose's keypoints."""

import json
from pathlib import Path

import numpy as np
import pytest

from hri_predict.recording import open_recording
from tests.hri_predict.recording.dumps import FRAMES, OPTICAL, of_tracker, refused, stands


def openpose(folder: Path, layout: str, scale: float = 1.0) -> Path:
    names, joints = of_tracker("body25")
    if layout == "COCO":
        joints = joints[:, [k for k, name in enumerate(names) if k < 8 or 8 < k < 19]]
    camera = np.concatenate([joints @ OPTICAL.T * scale, np.ones((*joints.shape[:2], 1))], axis=-1)
    folder.mkdir()
    for k, row in enumerate(camera):
        person = {
            "person_id": [-1],
            "pose_keypoints_2d": row[:, [0, 1, 3]].ravel().tolist(),
            "face_keypoints_2d": [],
            "hand_left_keypoints_2d": [],
            "pose_keypoints_3d": row.ravel().tolist(),
        }
        name = folder / f"walk_{k:012}_keypoints.json"
        name.write_text(json.dumps({"version": 1.3, "people": [person]}))
    return folder


@pytest.mark.parametrize(("layout", "scale"), [("BODY_25", 1.0), ("COCO", 1000.0)])
def test_a_folder_of_openpose(tmp_path, layout, scale):
    folder = openpose(tmp_path / "json", layout, scale)
    recording = open_recording(folder, rate_hz=30.0)
    stands(recording)
    assert len(recording.parts) == FRAMES
    assert "--fps 30" in refused(folder)
    first = sorted(folder.iterdir())[0]
    before = recording.digest
    first.write_text('{"version": 1.3, "people": []}')
    (folder / "walk_000000000005_keypoints.json").unlink()
    again = open_recording(first, rate_hz=30.0)
    assert not again.scenes[0].people[0].observed.any()
    assert again.scenes[5].stamp_ns == round(6e9 / 30)
    assert "1 frames are missing" in again.note
    assert again.digest != before


def test_other_sequences_in_a_folder_of_openpose_are_noted(tmp_path):
    folder = openpose(tmp_path / "json", "BODY_25")
    alone = open_recording(folder, rate_hz=30.0)
    assert "sequence" not in alone.note
    content = next(folder.iterdir()).read_bytes()
    for name in ("xa", "xb", "xc", "xd", "xe"):
        for k in range(2):
            (folder / f"{name}_{k:012}_keypoints.json").write_bytes(content)
    recording = open_recording(folder, rate_hz=30.0)
    assert len(recording.scenes) == len(alone.scenes)
    assert (
        "'walk' is read, not 'xa' (2), 'xb' (2), 'xc' (2), 'xd' (2), and 1 more" in recording.note
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"pose_keypoints_3d": []}, "only 2-D pixels"),
        ({"pose_keypoints_3d": [1.0, 2.0]}, "x, y, z and c of 25 joints"),
        ({"pose_keypoints_3d": ["1"] * 100}, "x, y, z and c of 25 joints"),
        ({"pose_keypoints_3d": [10**400] * 100}, "a number is too large"),
        ([], ": no 'people'"),
    ],
)
def test_openposes_pixels_and_damaged_frames(tmp_path, change, message):
    folder = openpose(tmp_path / "json", "BODY_25")
    first = sorted(folder.iterdir())[0]
    content = json.loads(first.read_text())
    first.write_text(json.dumps({"people": [content["people"][0] | change]} if change else change))
    assert message in refused(folder, rate_hz=30.0)
    first.write_text("[" * 100_000)
    assert "not JSON" in refused(folder, rate_hz=30.0)
    first.write_text(json.dumps({"people": content["people"] * 2}))
    assert "shows 2 people" in refused(folder, rate_hz=30.0)
