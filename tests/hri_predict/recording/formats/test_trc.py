"""TRC files as OpenSim and Motion Analysis write them, and what can be wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from hri_predict.errors import ConfigError, RecordingError
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.naming import map_of_names
from hri_predict.scene import Person, Scene

# As programs write it: empty columns after each name, a blank line, a trailing tab, missing cells.
OPENSIM = (
    "PathFileType\t4\t(X/Y/Z)\ttrial.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t"
    "OrigNumFrames\n"
    "60.00\t60.00\t3\t2\tmm\t60.00\t1\t3\n"
    "Frame#\tTime\tR.Wrist\t\t\tL.Wrist\t\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.000000\t100\t1000\t300\t100\t1000\t-300\t\n"
    "2\t0.016667\t\t\t\t110.5\t1000\t-300\n"
    "3\t0.033333\t120\t1000\t300\n"
)


@pytest.fixture
def save(tmp_path):
    def call(text: str, name: str = "a.trc") -> Path:
        (tmp_path / name).write_text(text, encoding="utf-8")
        return tmp_path / name

    return call


def joints(recording: Recording) -> np.ndarray:
    return np.array([[p.positions for p in scene.people] for scene in recording.scenes])


def test_a_file_of_opensim(save):
    recording = open_recording(save(OPENSIM), any_joints=True)
    assert (recording.kind, recording.rate_hz, recording.note) == ("trc", 60.0, "")
    assert recording.joint_map.source_joints == ("R.Wrist", "L.Wrist")
    nan = [np.nan] * 3
    # x forward, y up, z to the right become x forward, y left, z up
    expected = [
        [[0.1, -0.3, 1.0], [0.1, 0.3, 1.0]],
        [nan, [0.1105, 0.3, 1.0]],
        [[0.12, -0.3, 1.0], nan],
    ]
    np.testing.assert_allclose(joints(recording)[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize(("units", "metres"), [("m", 1.0), ("cm", 0.01), ("inch", 0.0254)])
def test_units_of_the_file_and_of_the_user(save, units, metres):
    path = save(OPENSIM.replace("\tmm\t", f"\t{units}\t"))
    assert joints(open_recording(path, any_joints=True))[0, 0, 0, 2] == pytest.approx(1000 * metres)
    by_hand = open_recording(path, any_joints=True, unit_m=0.001, axes=["x", "y", "z"])
    np.testing.assert_allclose(joints(by_hand)[0, 0, 0], [0.1, 1.0, 0.3])


def test_subjects_are_people(save):
    text = OPENSIM.replace("R.Wrist", "Anna:Wrist").replace("L.Wrist", "Ben:Wrist")
    recording = open_recording(save(text), any_joints=True, person=5)
    assert [p.id for p in recording.scenes[0].people] == [5, 6]
    assert recording.note == "'Anna' is person 5; 'Ben' is person 6"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("PathFileType", "Pfad", "must begin with PathFileType"),
        ("\t2\tmm", "\t3\tmm", "'NumMarkers' is 3, but 2 are named"),
        ("60.00\t60.00\t3\t", "60.00\t60.00\t4\t", "truncated: 3 of 4 frames"),
        ("60.00\t60.00\t3\t", "fast\t60.00\t3\t", "'DataRate' is 'fast', no number"),
        ("60.00\t60.00\t3\t", "0\t60.00\t3\t", "'DataRate' gives 0"),
        ("\tmm\t", "\tpx\t", "its 'Units' are 'px'"),
        ("110.5", "ten", "frame 2 holds what is no number"),
        ("110.5\t1000\t-300", "110.5\t1000\t-300\t7\t8\t9", "frame 2 has more than 2 markers"),
        ("DataRate\tC", "Rate\tC", "has no 'DataRate'"),
    ],
)
def test_what_is_wrong_is_named(save, old, new, message):
    with pytest.raises(RecordingError) as caught:
        open_recording(save(OPENSIM.replace(old, new, 1)), any_joints=True)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_trace_of_a_can_bus_has_the_same_ending(save):
    with pytest.raises(RecordingError, match="bus traffic, not motion"):
        open_recording(save(";$FILEVERSION=2.0\n;$STARTTIME=45000.1\n"))


def test_names_that_would_break_the_columns_are_refused(tmp_path):
    person = Person(1, np.zeros((1, 3)), np.ones(1, bool))
    scenes = [Scene(0, 0, True, (person,)), Scene(1, 1, True, (person,))]
    recording = Recording(
        path=Path("x"),
        kind="csv",
        joint_map=map_of_names(["a\tb"]),
        rate_hz=30.0,
        scenes=scenes,
        arrival_ns=[0, 33_333_333],
    )
    with pytest.raises(ConfigError, match="rename it"):
        write_recording(recording, tmp_path / "a.trc", "trc")
    assert list(tmp_path.iterdir()) == []
