"""TRC files as OpenSim and Motion Analysis write them, and what can be wrong with them."""

import re
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.naming import map_of_names
from tests.hri_predict.recording.made import of_scenes

# As programs write it: empty columns after each name, a blank line, a trailing tab, empty cells.
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
    "3\t0.033333\t120\t1000\t300\t\t\t\n"
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
        ("60.00\t60.00\t3\t", "fast\t60.00\t3\t", "'DataRate' is 'fast', not a number"),
        ("300\t\t\t\n", "300\n", "row 9: has 5 cells; expected 8"),
        ("300\t\t\t\n", "300\t\t\n", "row 9: has 7 cells; expected 8"),
        ("1\t0.000000\t100\t", "1\t0.000000\t", "row 7: marker 2 has 2 of 3 coordinates"),
        ("1000\t300\t100", "1000\t300", "row 7: marker 2 has 2 of 3 coordinates"),
        ("R.Wrist\t\t\tL.Wrist", "R.Wrist\t\tL.Wrist\t", "the name 'L.Wrist' is not above"),
        ("0.016667", "0.05", "its 'Time' is not after"),
        ("\tmm\t", "\tpx\t", "its 'Units' are 'px'"),
        ("110.5", "ten", "row 8: column 6 holds 'ten', which is not"),
        ("110.5", "1_0", "row 8: column 6 holds '1_0', which is not"),
        ("110.5\t1000\t-300", "110.5\t1000\t-300\t7\t8\t9", "row 8: has 11 cells; expected 8"),
        ("DataRate\tC", "Rate\tC", ": no 'DataRate'"),
    ],
)
def test_what_is_wrong_is_named(save, old, new, message):
    with pytest.raises(RecordingError) as caught:
        open_recording(save(OPENSIM.replace(old, new, 1)), any_joints=True)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def rows(numbers, times, decimals=5):
    head = OPENSIM[: OPENSIM.index("1\t0.000000")]
    cells = "100\t1000\t300\t100\t1000\t-300"
    lines = [f"{n}\t{t:.{decimals}f}\t{cells}" for n, t in zip(numbers, times, strict=True)]
    return head.replace("60.00\t3\t", f"60.00\t{len(lines)}\t", 1) + "\n".join(lines) + "\n"


@pytest.mark.parametrize("decimals", [2, 3, 6])
@pytest.mark.parametrize("first", [0, 1, 371])
def test_a_rate_that_explains_the_rounded_times_holds(save, decimals, first):
    """60 per second with two decimals has steps of 0.01 and 0.02 s."""
    times = 5 + np.arange(90) / 60
    text = rows(range(first, first + 90), times, decimals)
    recording = open_recording(save(text), any_joints=True)
    assert (recording.rate_hz, recording.note) == (60.0, "")
    assert [s.stamp_ns for s in recording.scenes] == [round(k * 1e9 / 60) for k in range(90)]


@pytest.mark.parametrize("rate_hz", [0.5, 25, 30, 59, 62, 100, 119.88, 240])
def test_of_a_stale_rate_and_the_times_the_times_hold(save, rate_hz):
    times = np.arange(120) / rate_hz
    recording = open_recording(save(rows(range(1, 121), times, 6)), any_joints=True)
    assert recording.rate_hz == pytest.approx(rate_hz, rel=1e-4)  # times are rounded to 1 us
    stamps = np.array([scene.stamp_ns for scene in recording.scenes]) * 1e-9
    np.testing.assert_allclose(stamps, times, atol=1e-6)
    assert f"'DataRate' is 60, but by 'Time' it is {recording.rate_hz:g}" in recording.note


@pytest.mark.parametrize("numbered", [True, False])
@pytest.mark.parametrize("timed", [True, False])
def test_frames_cut_out_are_a_gap(save, numbered, timed):
    k = np.concatenate([np.arange(30), np.arange(150, 180)])
    numbers = k + 1 if numbered else np.arange(60) + 1
    times = k / 60 if timed else np.arange(60) / 60
    recording = open_recording(save(rows(numbers, times, 6)), any_joints=True)
    stamps = np.array([scene.stamp_ns for scene in recording.scenes]) * 1e-9
    np.testing.assert_allclose(stamps, times, atol=1e-6)
    gap = "120 frames are missing; the longest gap is 2.02 s, after 0.48 s"
    assert (gap in recording.note) == timed
    assert ("'Frame#' and 'Time' differ" in recording.note) == (numbered != timed)


def test_without_times_the_rate_holds(save):
    text = rows([1, 2, 5], [0, 0, 0]).replace("\t0.00000\t", "\t\t")
    recording = open_recording(save(text), any_joints=True)
    assert [s.stamp_ns for s in recording.scenes] == [0, 16_666_667, 66_666_667]
    assert "rows without a 'Time': 'DataRate' is used" in recording.note


@pytest.mark.parametrize("promised", [1, 2, 4, 900])
def test_all_rows_are_read_whatever_the_header_counts(save, promised):
    text = OPENSIM.replace("60.00\t60.00\t3\t", f"60.00\t60.00\t{promised}\t")
    recording = open_recording(save(text), any_joints=True)
    assert len(recording.scenes) == 3
    assert f"'NumFrames' is {promised}, but there are 3 frames" in recording.note


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "latin-1"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings_line_ends_and_decimal_commas(tmp_path, encoding, end):
    path = tmp_path / "a.trc"
    path.write_text(OPENSIM)
    expected = joints(open_recording(path, any_joints=True))
    for text in (OPENSIM, OPENSIM.replace("R.W", "W").replace("L.W", "V").replace(".", ",")):
        path.write_bytes(text.replace("\n", end).encode(encoding))
        np.testing.assert_array_equal(joints(open_recording(path, any_joints=True)), expected)


def test_spaces_instead_of_tabs(save):
    text = rows(range(1, 4), np.arange(3) / 60)
    spaced = "\n".join("   ".join(line.split()) for line in text.split("\n"))
    expected = joints(open_recording(save(text), any_joints=True))
    np.testing.assert_array_equal(joints(open_recording(save(spaced), any_joints=True)), expected)
    with pytest.raises(RecordingError, match="row 8: has 7 cells; expected 8"):
        open_recording(save(spaced.replace("2   0.01667   100   ", "2   0.01667   ")))


@pytest.mark.parametrize(
    ("label", "left", "said"),
    [
        ("R.Wrist", "", "row 4: 'NumMarkers' is 2, but 1 are named: marker 1 has no name"),
        ("L.Wrist", "", "row 4: 'NumMarkers' is 2, but 1 are named"),
        ("R.Wrist\t\t\t", "", "row 4: 'NumMarkers' is 2, but 1 are named"),
    ],
)
def test_a_label_that_was_deleted_is_named_with_its_row(save, label, left, said):
    with pytest.raises(RecordingError, match=re.escape(said)):
        open_recording(save(OPENSIM.replace(label, left)), any_joints=True)


def test_a_trace_of_a_can_bus_has_the_same_ending(save):
    with pytest.raises(RecordingError, match="bus traffic, not motion"):
        open_recording(save(";$FILEVERSION=2.0\n;$STARTTIME=45000.1\n"))


def test_names_that_would_break_the_columns_are_refused(tmp_path):
    person = Person(1, np.zeros((1, 3)), np.ones(1, bool))
    scenes = [Scene(0, 0, True, (person,)), Scene(1, 1, True, (person,))]
    recording = of_scenes(scenes, map_of_names(["a\tb"]), 30.0, arrival_ns=[0, 33_333_333])
    with pytest.raises(ConfigError, match="rename it"):
        write_recording(recording, tmp_path / "a.trc", "trc")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("times", [["", "", "", ""], ["0", "0.01", "0.02", "1e305"]])
def test_a_frame_at_no_time_is_refused(save, times):
    text = OPENSIM[: OPENSIM.index("\n\n") + 2]
    for number, time in zip(("1", "2", "3", "1e305"), times, strict=True):
        text += f"{number}\t{time}\t100\t1000\t300\t100\t1000\t-300\n"
    with pytest.raises(RecordingError, match="scene 4 arrives 1e\\+09 s after"):
        open_recording(save(text.replace("60.00\t60.00\t3", "60.00\t60.00\t4")), any_joints=True)
