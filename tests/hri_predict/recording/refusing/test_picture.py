"""Landmarks of a picture are refused, at a cost that does not grow with the recording."""

from dataclasses import replace
from typing import Any, cast

import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.recording import open_recording
from hri_predict.recording.plausibility import MOST_SCENES
from hri_predict.recording.refusing import check_not_picture
from tests.hri_predict.recording.dumps import OPTICAL, mediapipe, of_tracker


def test_a_long_recording_is_judged_by_some_of_its_scenes(tmp_path):
    _, joints = of_tracker("mediapipe33")
    recording = open_recording(mediapipe(tmp_path / "a.csv", joints @ OPTICAL.T), rate_hz=25.0)
    scene = recording.scenes[0]
    person = scene.people[0]
    camera = person.positions @ recording.joint_map.rotation
    hips = camera[23:25].mean(axis=0)
    placed = ((camera - hips) / 2.5 + [0.4, 0.5, 0.0]) @ recording.joint_map.rotation.T
    shown = replace(scene, people=(replace(person, positions=placed),))
    for good, bad in ((scene, False), (shown, True)):
        scenes = [good if k % 3 == 0 else cast(Any, None) for k in range(3 * MOST_SCENES)]
        long = replace(recording, scenes=scenes)
        if bad:
            with pytest.raises(RecordingError, match="those of a picture"):
                check_not_picture(long)
        else:
            check_not_picture(long)
