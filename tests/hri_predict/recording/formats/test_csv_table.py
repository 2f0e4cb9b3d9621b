"""CSV tables: ours, and as other programs write them."""

from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import bounded, open_recording


@pytest.fixture
def read(tmp_path):
    def call(*lines: str, **options):
        path = tmp_path / "a.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8-sig")
        return open_recording(path, **options)

    return call


def test_people_come_and_go_and_the_source_may_be_blind(read):
    recording = read(
        "time_s,sees_room,person,waist_x,waist_y,waist_z,head_x,head_y,head_z",
        "5.0,1,3,1,2,3,1,2,3.6",
        "5.0,1,7,1,1,1,,,",
        "5.04,1,,,,,,,",
        "5.08,0,,,,,,,",
        "5.12,1,7,nan,1,1,inf,2,2",
    )
    assert recording.rate_hz == 25.0
    assert [s.stamp_ns for s in recording.scenes] == [0, 40_000_000, 80_000_000, 120_000_000]
    assert [s.sees_room for s in recording.scenes] == [True, True, False, True]
    assert [[p.id for p in s.people] for s in recording.scenes] == [[3, 7], [], [], [7]]
    observed = [p.observed.tolist() for s in recording.scenes for p in s.people]
    assert observed == [[True, True], [True, False], [False, False]]
    joints, seen = recording.joint_map.map(
        recording.scenes[0].people[0].positions, recording.scenes[0].people[0].observed
    )
    assert [JOINTS[k] for k in np.flatnonzero(seen)] == ["waist", "head"]
    np.testing.assert_array_equal(joints[JOINTS.index("head")], [1, 2, 3.6])


@pytest.mark.parametrize(
    "lines",
    [
        ("t,Waist.X,Waist.Y,Waist.Z", "0,1.5,2,3", "0.1,1.5,2,3"),
        ("Time;Waist:x;Waist:y;Waist:z", "0;1,5;2,0;3", "0,1;1,5;2;3"),
        ("frame\tTIME\tWaist X\tWaist Y\tWaist Z", "1\t0\t1.5\t2\t3", "2\t0.1\t1.5\t2\t3"),
    ],
)
def test_other_programs_tables(read, lines):
    recording = read(*lines, any_joints=True, person=4)
    assert recording.rate_hz == 10.0
    assert recording.joint_map.source_joints == ("Waist",)
    assert recording.scenes[1].people[0].id == 4
    np.testing.assert_array_equal(recording.scenes[1].people[0].positions, [[1.5, 2, 3]])


def test_units_and_axes_of_the_user(read):
    head = "time_s,waist_x,waist_y,waist_z"
    recording = read(head, "0,10,20,30", "1,10,20,30", unit_m=0.01, axes=["z", "x", "y"])
    np.testing.assert_allclose(recording.scenes[0].people[0].positions, [[0.3, 0.1, 0.2]])


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("a,b,c", "1,2,3"), ": no column 'time_s'"),
        (("time_s,a_x,a_y", "0,1,2"), "its joints have no z ('a')"),
        (("time_s,b", "0,1"), "no joint's _x, _y and _z"),
        (("time_s,a_x,a_y,a_z,A", "0,1,2,3,4"), "has 1 times"),
        (("time_s,a_x,a_y,a_z,a_x", "0,1,2,3,4"), "column 'a_x' occurs twice"),
        (
            ("time_s,a_x,a_y,a_z", "0,1,2,3", "1,1,two,3"),
            "row 3: column 3 ('a_y') holds 'two', which is not a",
        ),
        (("time_s,a_x,a_y,a_z", "0,1,2,1_0"), "column 4 ('a_z') holds '1_0', which is not a"),
        (("time_s,a_x,a_y,a_z", "1,1,2,3", "0,1,2,3"), "row 3: its time is before"),
        (("time_s,a_x,a_y,a_z", "0,1,2,3", "nan,1,2,3"), "row 3: its time is 'nan'"),
        (("time_s,a_x,a_y,a_z", "0,1,2,3", "0,1,2,3"), "row 3: person 1 occurs twice"),
        (("time_s,person,a_x,a_y,a_z", "0,,1,2,3"), "row 2: has joints, but no person"),
        (
            ("time_s,a_x,a_y,a_z", "0,1,2,3", "1,1,2,3", "2,1,2,3", "9000,1,2,3"),
            "expected 0 to 3600 s",
        ),
        (("time_s,a_x,a_y,a_z", "0,1,2,3", "0.00001,1,2,3"), "must be 0.1 to 10000"),
    ],
)
def test_what_is_wrong_is_named(read, lines, message):
    with pytest.raises(RecordingError) as caught:
        read(*lines, any_joints=True)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unknown_joints_can_be_converted_but_not_replayed(read):
    lines = ("time_s,q_x,q_y,q_z", "0,1,2,3", "1,1,2,3")
    assert not read(*lines, any_joints=True).joint_map.mapped.any()
    with pytest.raises(RecordingError, match="the file has: q"):
        read(*lines)


def test_a_file_that_is_no_text(tmp_path: Path):
    (tmp_path / "a.csv").write_bytes(b"PK\x03\x04\0\0\0")
    with pytest.raises(RecordingError, match="a damaged zip archive"):
        open_recording(tmp_path / "a.csv")


@pytest.mark.parametrize("person", ["1", ""], ids=["somebody", "nobody"])
def test_more_rows_than_can_be_held_are_refused(tmp_path, monkeypatch, person):
    monkeypatch.setattr(bounded, "MAX_BYTES", 40_000)
    joint = "1,2,3" if person else ",,"
    rows = "".join(f"{k / 10},{person},{joint}\n" for k in range(2000))
    path = tmp_path / "a.csv"
    path.write_text(f"time_s,person,a_x,a_y,a_z\n{rows}")
    with pytest.raises(RecordingError, match="too many to hold"):
        open_recording(path, any_joints=True)
