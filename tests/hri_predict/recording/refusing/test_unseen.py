"""Recordings: lost joints written as 0, 0, 0 are not seen; hips that are the origin are refused."""

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording.opening import open_recording
from hri_sim.people.body import Body
from tests.cases import CASES
from tests.hri_predict.recording.test_plausibility import written

FILES = CASES / "files"
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([2.0, 0.3]), 0.4))
WRIST = JOINTS.index("l_wrist")
needs_cases = pytest.mark.skipif(not FILES.is_dir(), reason=f"needs {FILES}")


@pytest.mark.parametrize("place", [[0.0, 0.0, 0.0], [0.01, 0.0, 0.0]])
def test_a_lost_joint_is_not_seen_and_counted(tmp_path, place):
    lost = BODY.copy()
    lost[WRIST] = place
    recording = open_recording(written(tmp_path / "a.csv", BODY, lost))
    seen = np.array([scene.people[0].observed for scene in recording.scenes])
    assert seen[:30].all()
    assert not seen[30:, WRIST].any()
    assert seen.sum() == seen.size - 30
    assert "joints taken as not seen: 30 " in recording.note


@needs_cases
def test_zero_is_read_as_nothing_is():
    zero, null = (open_recording(FILES / f"s2_{name}.csv") for name in ("zero", "null"))
    for a, b in zip(zero.scenes, null.scenes, strict=True):
        np.testing.assert_array_equal(a.people[0].observed, b.people[0].observed)


@needs_cases
def test_coordinates_about_the_hips_are_refused():
    with pytest.raises(RecordingError, match="relative to the hips"):
        open_recording(FILES / "v05_mediapipe_world_zup.csv")


def test_hips_that_were_lifted_are_refused_where_the_legs_walk(tmp_path):
    bodies = []
    for k in range(8):
        body = BODY - [*BODY[0, :2], 0.0]
        for sign, side in ((1, "l_"), (-1, "r_")):
            for name in ("ankle", "foot"):
                body[JOINTS.index(side + name), 0] += sign * 0.3 * np.sin(k * np.pi / 4)
        bodies.append(body)
    with pytest.raises(RecordingError, match="relative to the hips"):
        open_recording(written(tmp_path / "a.csv", *bodies))
    open_recording(written(tmp_path / "b.csv", bodies[0], bodies[0] + [0.1, 0.1, 0.0]))
