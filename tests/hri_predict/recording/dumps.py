"""One body that walks, as trackers and data sets write it."""

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.recording import Recording, open_recording
from hri_sim.people.body import Body

WHO = Body(1.75)
FRAMES = 40
WALK = np.stack(
    [WHO.joints(WHO.standing(np.array([2.0, 0.3 + 0.02 * k]), 0.4)) for k in range(FRAMES)]
)
"""(F, 21, 3) metres, z up."""
OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""From forward, left, up to a camera's x right, y down, z away."""
Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
KINECT2 = np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]])


def of_tracker(name: str, walk: np.ndarray = WALK) -> tuple[list[str], np.ndarray]:
    """Names and (F, J, 3) of a tracker's joints; those that it has in addition are at the neck."""
    joint_map = load_joint_map(name)
    joints = np.repeat(walk[:, [JOINTS.index("neck")]], len(joint_map.source_joints), axis=1)
    for row, weights in enumerate(joint_map.weights):
        for column in np.flatnonzero(weights):
            if weights[column] == 1 or JOINTS[row] == "head":
                joints[:, column] = walk[:, row]
    return list(joint_map.source_joints), joints


def table(path: Path, head: list[str], rows: Sequence[Sequence[object]]) -> Path:
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([head, *rows])
    return path


def stands(recording: Recording) -> None:
    """All frames are there, and show the same body upright, in metres."""
    assert len(recording.scenes) == FRAMES
    canonical, seen = recording.joint_map.map(
        np.stack([s.people[0].positions for s in recording.scenes]),
        np.stack([s.people[0].observed for s in recording.scenes]),
    )
    used = [JOINTS.index(name) for name in ("l_wrist", "r_knee", "l_ankle")]
    assert seen[:, used].all()
    waist = canonical[:, [JOINTS.index("waist")]]
    heights = (canonical - waist)[:, used, 2]
    true = (WALK - WALK[:, [JOINTS.index("waist")]])[:, used, 2]
    np.testing.assert_allclose(heights, true, atol=0.02)  # midpoints of hips are not the waist


def refused(path: Path, **options: Any) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path, any_joints=True, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def mediapipe(path: Path, joints: np.ndarray) -> Path:
    """x, y, z and visibility of each landmark, a row for each frame, as scripts write results."""
    names = load_joint_map("mediapipe33").source_joints
    head = ["frame"]
    head += [f"{name.upper()}_{c}" for name in names for c in ("x", "y", "z", "visibility")]
    sure = np.full((*joints.shape[:2], 1), 0.9)
    cells = np.concatenate([joints, sure], axis=-1).reshape(FRAMES, -1)
    return table(path, head, [[k, *row] for k, row in enumerate(cells)])
