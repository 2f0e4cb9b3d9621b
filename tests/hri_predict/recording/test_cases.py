"""Small files with one fault each, after public reports: compared with the same file without it."""

import re
import shlex

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording
from hri_predict.recording.opening import opened
from hri_predict.recording.recording import Recording
from tests.cases import CASES
from tests.commands import status_of

FILES = CASES / "files"
pytestmark = pytest.mark.skipif(not FILES.is_dir(), reason=f"needs {FILES}")
SAME_M = 1e-5
"""The files have 5 decimals of metres, or 32-bit floats of millimetres."""


def canonical(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """(n, J, 3) and (n, J) of all people in all scenes."""
    mapped = [
        recording.joint_map.map(person.positions, person.observed)
        for scene in recording.scenes
        for person in scene.people
    ]
    return np.array([m[0] for m in mapped]), np.array([m[1] for m in mapped])


def check_same(name: str, base: str, *, missing: tuple[str, ...] = ()) -> Recording:
    """Check that a file is read as its base, but for joints that it does not have."""
    recording = open_recording(FILES / name)
    found, seen = canonical(recording)
    expected, known = canonical(open_recording(FILES / base))
    known[:, [JOINTS.index(joint) for joint in missing]] = False
    np.testing.assert_array_equal(seen, known)
    np.testing.assert_allclose(found[known], expected[known], atol=SAME_M)
    return recording


def refused(name: str) -> str:
    with pytest.raises(RecordingError) as error:
        opened(FILES / name)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("name", ["b28_chan_upper", "b11_bom"])
def test_bvh_of_another_spelling(name):
    assert not check_same(f"{name}.bvh", "b01_base.bvh").note


def test_bvh_with_latin_1_names():
    recording = check_same("b13_latin1_names.bvh", "b01_base.bvh", missing=("torso",))
    assert "Wirbels\u00e4ule" in recording.joint_map.source_joints


def test_bvh_with_scale_channels():
    assert "'Spine'" in check_same("b31_scale_channels.bvh", "b01_base.bvh").note


def test_bvh_with_columns_of_end_sites():
    assert "81 values for 66 channels" in refused("b55_endsite_columns.bvh")


def test_bvh_that_counts_too_few_frames():
    note = check_same("b15_frames_less.bvh", "b01_base.bvh").note
    assert "'Frames:' is 59, but there are 60 frames" in note


def test_bvh_names_with_spaces():
    recording = check_same("b38_bip.bvh", "b01_base.bvh")
    assert "Bip01 L UpperArm" in recording.joint_map.source_joints


@pytest.mark.parametrize(
    ("name", "base", "option"),
    [
        ("b34_inches.bvh", "b01_base.bvh", "--units inch"),
        ("v31_inch_said_cm.csv", "v01_base.csv", "--units 2.54"),
        ("b65_zup.bvh", "b01_base.bvh", "--axes -y,x,z"),
    ],
)
def test_units_and_axes_are_refused_with_a_remedy_that_works(
    name, base, option, tmp_path, monkeypatch
):
    error = refused(name)
    command = re.search(r"this writes a correct file: hri-predict (.+)$", error)
    assert command is not None
    assert command[1].endswith(option)
    monkeypatch.chdir(tmp_path)
    words = shlex.split(command[1])
    assert status_of(*words) == 0
    found, seen = canonical(opened(tmp_path / words[2]))
    expected, known = canonical(open_recording(FILES / base))
    np.testing.assert_array_equal(seen, known)
    # the inches have 5 or 6 decimals; over a chain of eight bones that is 2e-5 m at most
    np.testing.assert_allclose(found[known], expected[known], atol=5e-5)


@pytest.mark.parametrize(
    ("name", "counts"),
    [
        ("c06_first101_hdr_short", "header 40"),
        ("c06_hdr_raw_range", "header 200"),
        ("c18_data_start0", ""),
    ],
)
def test_c3d_with_stale_or_empty_counts(name, counts):
    recording = check_same(f"{name}.c3d", "c01_base.c3d")
    assert len(recording.scenes) == 60
    assert counts in recording.note
    assert bool(counts) == bool(recording.note)


def test_c3d_with_missing_points_at_zero():
    recording = open_recording(FILES / "c03_gap_zero0.c3d")
    found, seen = canonical(recording)
    expected, known = canonical(open_recording(FILES / "c01_base.c3d"))
    assert "10 points at exactly 0, 0, 0 are not observed" in recording.note
    assert known.sum() - seen.sum() == 10
    np.testing.assert_allclose(found[seen], expected[seen], atol=SAME_M)


def test_trc_with_a_stale_rate():
    recording = check_same("t08_time_vs_rate.trc", "t01_base.trc")
    assert recording.rate_hz == pytest.approx(30, rel=1e-4)  # its times have five decimals
    assert recording.scenes[-1].stamp_ns == pytest.approx(59 / 30 * 1e9, abs=1e4)
    assert "'DataRate' is 25" in recording.note


def test_trc_with_a_gap():
    recording = check_same("t10_gap_frames.trc", "t01_base.trc")
    stamps = [scene.stamp_ns for scene in recording.scenes]
    assert max(np.diff(stamps)) == pytest.approx(61 / 30 * 1e9, abs=1e4)
    assert "60 frames are missing; the longest gap is 2.03 s" in recording.note


@pytest.mark.parametrize(
    ("name", "what"),
    [
        ("t24_cell_missing.trc", "row 26: has 79 cells; expected 80"),
        ("v28_cell_missing.csv", "row 21: has 78 cells; expected 79"),
        ("v30_cell_extra.csv", "row 21: has 80 cells; expected 79"),
    ],
)
def test_rows_with_a_cell_too_few_or_too_many(name, what):
    assert what in refused(name)


def test_csv_in_unix_seconds():
    recording = check_same("v02_unix.csv", "v01_base.csv")
    assert recording.rate_hz == pytest.approx(30, rel=1e-4)


def test_csv_with_confidences():
    recording = open_recording(FILES / "v03_azure_conf0_zeros.csv", unit_m=0.001)
    names = recording.joint_map.source_joints
    hidden = {
        names[j] for scene in recording.scenes for j in np.flatnonzero(~scene.people[0].observed)
    }
    assert len(hidden) == 2
    assert all("WRIST" in name or "ELBOW" in name for name in hidden)
    assert "120 joints with a confidence below 0.3 are not observed" in recording.note


def test_csv_of_two_bodies():
    recording = check_same("v26_person_body_id.csv", "v01_base.csv")
    assert [person.id for scene in recording.scenes for person in scene.people] == [1, 2] * 30


@pytest.mark.parametrize("name", ["a04_joints52", "a07_names_bytes"])
def test_npz_with_a_rate_as_a_list_and_names_as_bytes(name):
    recording = open_recording(FILES / f"{name}.npz")
    assert recording.rate_hz == 30.0
    found, seen = canonical(recording)
    expected, known = canonical(open_recording(FILES / "v01_base.csv"))
    both = seen & known
    limbs = [
        k
        for k, name in enumerate(JOINTS)
        if name[:2] in ("l_", "r_") and not name.endswith("foot") and both[0, k]
    ]  # the front of a foot is its end in one rig, and its ball in the other
    assert len(limbs) == 12
    np.testing.assert_allclose(found[:, limbs], expected[:, limbs], atol=SAME_M)
