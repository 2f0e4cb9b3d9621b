"""Dumps of trackers and data sets, in the layouts in which these publish them."""

import pickle
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording
from hri_predict.recording.formats import pw3d
from hri_predict.recording.formats.amass import SMPL
from hri_predict.recording.opening import opened
from tests.hri_predict.recording.dumps import (
    FRAMES,
    KINECT2,
    OPTICAL,
    WALK,
    Y_UP,
    mediapipe,
    of_tracker,
    refused,
    stands,
    table,
)


# Azure Kinect: samples of recorders write k4abt_joint_id_t's names, mm, and a confidence level.
@pytest.mark.parametrize(("factor", "prefix"), [(1000.0, ""), (1.0, "K4ABT_JOINT_")])
def test_azure_kinect_in_millimetres_or_metres(tmp_path, factor, prefix):
    names, joints = of_tracker("azure_kinect32")
    head = ["timestamp_us", "body_id"]
    head += [f"{prefix}{name}_{c}" for name in names for c in ("x", "y", "z", "confidence")]
    sure = np.full((*joints.shape[:2], 1), 2.0)
    cells = np.concatenate([joints @ OPTICAL.T * factor, sure], axis=-1).reshape(FRAMES, -1)
    rows = [[k * 33_333, 1, *row] for k, row in enumerate(cells)]
    recording = opened(table(tmp_path / "a.csv", head, rows))
    stands(recording)
    assert "azure_kinect32" in recording.note
    assert f"is in {'mm' if factor > 1 else 'm'}, with z,-x,-y" in recording.note


# Kinect v2: names of JointType, metres, place in the picture and tracking state besides.
def test_kinect_2_with_places_in_the_picture(tmp_path):
    names, joints = of_tracker("kinect25")
    ends = ("X", "Y", "Z", "2D_X", "2D_Y", "State")
    head = ["CaptureTime", "TrackingID", *(f"{name}_{end}" for name in names for end in ends)]
    extra = np.tile([960.0, 540.0, 2.0], (*joints.shape[:2], 1))
    cells = np.concatenate([joints @ KINECT2.T, extra], axis=-1).reshape(FRAMES, -1)
    rows = [[1_700_000_000_000 + k * 33, 72057594037928017, *row] for k, row in enumerate(cells)]
    stands(opened(table(tmp_path / "a.csv", head, rows)))


def test_what_the_user_says_holds(tmp_path):
    names, joints = of_tracker("azure_kinect32")
    head = ["time_s", *(f"{name}_{c}" for name in names for c in "xyz")]
    rows = [[k / 30, *row] for k, row in enumerate((joints @ OPTICAL.T).reshape(FRAMES, -1))]
    path = table(tmp_path / "a.csv", head, rows)
    recording = open_recording(path, axes=["x", "y", "z"])
    np.testing.assert_array_equal(recording.joint_map.rotation, np.eye(3))


# MediaPipe: pose_world_landmarks are metres about the hips; pose_landmarks are those of a picture.
def test_mediapipes_landmarks_hold_no_place(tmp_path):
    _, joints = of_tracker("mediapipe33")
    camera = joints @ OPTICAL.T
    hips = camera[:, 23:25].mean(axis=1, keepdims=True)
    world = mediapipe(tmp_path / "world.csv", camera - hips)
    assert "MediaPipe's world landmarks" in refused(world, rate_hz=30.0)
    assert "--fps 30" in refused(world)
    picture = (camera - hips) / 2.5 + [0.4, 0.5, 0.0]
    assert "coordinates are those of a picture" in refused(
        mediapipe(tmp_path / "picture.csv", picture), rate_hz=30.0
    )
    pixels = mediapipe(tmp_path / "pixels.csv", picture * [1920.0, 1920.0, 1920.0])
    assert "coordinates are those of a picture" in refused(pixels, rate_hz=30.0, unit_m=0.001)


def test_mediapipe_placed_by_a_depth_camera(tmp_path):
    _, joints = of_tracker("mediapipe33")
    path = mediapipe(tmp_path / "a.csv", joints @ OPTICAL.T)
    recording = open_recording(path, rate_hz=25.0)
    stands(recording)
    assert recording.rate_hz == 25.0
    flat = table(tmp_path / "b.csv", ["time_s", "nose_x", "nose_y"], [[0, 1, 2], [1, 1, 2]])
    assert "do not give a position in the room" in refused(flat)


@pytest.mark.parametrize("rate_hz", [0.0, float("nan"), -30.0, 1e9])
def test_an_absurd_rate_is_refused(tmp_path, rate_hz):
    path = table(tmp_path / "a.csv", ["a_x", "a_y", "a_z"], [[1, 2, 3], [1, 2, 3]])
    assert "--fps gives" in refused(path, rate_hz=rate_hz)


@pytest.mark.parametrize("time", ["0.5", "0,5", "12:00:01", "2024-01-01T12:00:01Z", "0"])
@pytest.mark.parametrize("name", ["time_s", "Timestamp", "capture time (ms)"])
def test_a_rate_never_contradicts_the_times_of_a_table(tmp_path, name, time):
    head = ["frame", name, "a_x", "a_y", "a_z"]
    empty = [[k, cell, 1, 2, 3] for k, cell in enumerate(["", "nan", " ", "n/a"])]
    path = table(tmp_path / "a.csv", head, empty)
    assert open_recording(path, any_joints=True, rate_hz=30.0).rate_hz == 30.0
    table(path, head, [*empty, [9, time, 1, 2, 3]])
    assert f"has times of its own ('{name}' is '{time}'); leave --fps" in refused(path, rate_hz=30)
    table(path, head, [*empty, [9, time, 1, "left", 3]])
    assert "row 6: column 4" in refused(path, rate_hz=30.0)


def test_a_damaged_file_is_said_before_an_option_that_it_does_not_need(tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(b"PK\x03\x04")
    assert "truncated" in refused(path, rate_hz=30.0)
    np.savez(path, positions=np.ones((3, 1, 3)), parents=[-1], joint_names=["a"], fps=30)
    assert "leave --fps out" in refused(path, rate_hz=30.0)


def test_a_table_of_our_own_is_never_turned(tmp_path):
    """Its units and axes are known: a person who lies there is not one who stands."""
    names, joints = of_tracker("azure_kinect32")
    rows = [[k / 30, 1, 1, *row] for k, row in enumerate((joints @ OPTICAL.T).reshape(FRAMES, -1))]
    coordinates = [f"{name}_{c}" for name in names for c in "xyz"]
    own = table(tmp_path / "own.csv", ["time_s", "sees_room", "person", *coordinates], rows)
    recording = open_recording(own)
    np.testing.assert_array_equal(recording.joint_map.rotation, np.eye(3))
    other = table(tmp_path / "other.csv", ["time", "sees_room", "person", *coordinates], rows)
    stands(open_recording(other))


def test_several_people_without_times_need_frames(tmp_path):
    head = ["person", "neck_x", "neck_y", "neck_z"]
    rows = [[k % 2, 1, 2, 1.5] for k in range(6)]
    assert "column 'frame'" in refused(table(tmp_path / "a.csv", head, rows), rate_hz=30.0)
    rows = [[k // 2, *row] for k, row in enumerate(rows)]
    recording = open_recording(
        table(tmp_path / "b.csv", ["frame", *head], rows), rate_hz=30.0, any_joints=True
    )
    assert [len(scene.people) for scene in recording.scenes] == [2, 2, 2]


# FreeMoCap, split_and_save.py and data_saver.py: mm, z up; no times in the wide table.
@pytest.mark.parametrize("prefix", ["body_", ""])
def test_freemocaps_tables(tmp_path, prefix):
    names, joints = of_tracker("mediapipe33")
    head = [f"{prefix}{name}_{c}" for name in names for c in "xyz"]
    rows = (joints * 1000).reshape(FRAMES, -1).tolist()
    if not prefix:  # *_by_trajectory.csv: its times are empty for a recording without timestamps
        head = ["timestamp", "timestamp_by_camera", *head, "right_hand_0000_x"]
        head += ["right_hand_0000_y", "right_hand_0000_z"]
        rows = [["", "{}", *row, 1.0, 2.0, 3.0] for row in rows]
    path = table(tmp_path / "a.csv", head, rows)
    stands(open_recording(path, rate_hz=30.0))
    tidy = table(tmp_path / "b.csv", ["frame", "keypoint", "x", "y", "z"], [[0, "nose", 1, 2, 3]])
    assert "by_trajectory.csv" in refused(tidy, rate_hz=30.0)


@pytest.mark.parametrize("points", [33, 553])
def test_freemocaps_arrays(tmp_path, points):
    _, joints = of_tracker("mediapipe33")
    array = np.zeros((FRAMES, points, 3))
    array[:, :33] = joints * 1000
    np.save(tmp_path / "a.npy", array)
    recording = open_recording(tmp_path / "a.npy", rate_hz=30.0)
    stands(recording)
    assert ("hands and face are not used" in recording.note) == (points > 33)
    assert "--fps 30" in refused(tmp_path / "a.npy")
    np.save(tmp_path / "b.npy", array[:, :17])
    assert "FreeMoCap's (frames, 33 or" in refused(tmp_path / "b.npy", rate_hz=30.0)
    np.save(tmp_path / "c.npy", np.array([{}], object), allow_pickle=True)
    assert "not an array of numbers" in refused(tmp_path / "c.npy", rate_hz=30.0)


def test_an_archive_or_a_pickle_named_as_an_array_is_refused(tmp_path):
    path = tmp_path / "a.npy"
    with path.open("wb") as file:
        np.savez(file, a=np.zeros((FRAMES, 33, 3)))
    assert "not an array of numbers" in refused(path, rate_hz=30.0)
    path.write_bytes(pickle.dumps(np.zeros((FRAMES, 33, 3))))
    assert "not an array of numbers" in refused(path, rate_hz=30.0)
    np.save(path, np.zeros((FRAMES, 33, 3)))
    path.write_bytes(path.read_bytes()[:-1])
    assert "truncated" in refused(path, rate_hz=30.0)


# 3DPW: dictionaries of Python 2 with NumPy's arrays; protocol 2 is the most that Python 2 writes.
@pytest.mark.parametrize("protocol", [0, 2, 4])
@pytest.mark.parametrize("axes", [Y_UP, np.eye(3), OPTICAL])
def test_two_people_of_3dpw(tmp_path, protocol, axes):
    names, joints = of_tracker("smpl22")
    body = np.concatenate([joints, joints[:, -2:]], axis=1) @ axes.T  # two hands after the wrists
    assert (*names, "left_hand", "right_hand") == SMPL
    other = body + [1.0, 0.0, 0.0] @ axes.T
    placed = np.ones(FRAMES, bool)
    placed[3] = False
    sequence = {
        "sequence": "downtown_walking_00",
        "jointPositions": [each.reshape(FRAMES, 72) for each in (body, other)],
        "campose_valid": [placed, np.ones(FRAMES, bool)],
        "genders": ["m", "f"],
        "betas": [np.zeros(10), np.zeros(10)],
        "texture_maps": [None, None],
        "cam_intrinsics": np.eye(3),
        "img_frame_ids": np.arange(FRAMES),
    }
    path = tmp_path / "downtown_walking_00.pkl"
    path.write_bytes(pickle.dumps(sequence, protocol=protocol))
    recording = opened(path)
    assert (recording.rate_hz, recording.kind) == (30.0, "3dpw")
    assert [person.id for person in recording.scenes[0].people] == [1, 2]
    assert not recording.scenes[3].people[0].observed.any()
    assert "not placed in 1 frames" in recording.note
    first, second = (p.positions[0] for p in recording.scenes[0].people)
    assert np.linalg.norm(second - first) == pytest.approx(1.0)
    head, foot = SMPL.index("head"), SMPL.index("left_ankle")
    for person in recording.scenes[0].people:
        assert person.positions[head, 2] - person.positions[foot, 2] > 1.3


def test_another_pickle_is_refused(tmp_path):
    path = tmp_path / "a.pkl"
    for content in ({"joints": [1]}, {"jointPositions": [[1.0, 2.0]]}, [1, 2], Path("/tmp")):
        path.write_bytes(pickle.dumps(content))
        assert "3DPW" in refused(path)
    path.write_bytes(pickle.dumps({"jointPositions": [np.zeros((3, 72)), np.zeros((4, 72))]}))
    assert "3, 4 frames" in refused(path)


def test_one_array_of_3dpw_is_not_unpacked_for_each_person(tmp_path, monkeypatch):
    """A pickle names one array any number of times; a byte of it becomes eight."""
    path = tmp_path / "a.pkl"
    frames = 100
    monkeypatch.setattr(pw3d, "MAX_JOINT_BYTES", 8 * 72 * 10 * frames)
    body = np.zeros((frames, 72), np.int8)
    path.write_bytes(pickle.dumps({"jointPositions": [body] * 10}))
    open_recording(path, any_joints=True)
    path.write_bytes(pickle.dumps({"jointPositions": [body] * 11}))
    assert "cut it into parts" in refused(path)
    for flags in ([np.ones(frames)] * 100_000, [np.ones(frames + 1)], np.ones(frames), "1", 1):
        path.write_bytes(pickle.dumps({"jointPositions": [body], "campose_valid": flags}))
        assert "'campose_valid'" in refused(path)


# AMASS as distributed (amass.is.tue.mpg.de): SMPL+H's *_poses.npz, and SMPL-X's *_stageii.npz.
@pytest.mark.parametrize(
    "keys",
    [
        ("trans", "gender", "mocap_framerate", "betas", "dmpls", "poses"),
        ("gender", "mocap_frame_rate", "trans", "poses", "root_orient", "pose_body"),
        ("gender", "betas"),
    ],
)
def test_parameters_of_amass_say_what_they_need(tmp_path, keys):
    arrays = dict.fromkeys(keys, np.zeros((3, 156))) | {"gender": np.array("female")}
    np.savez(tmp_path / "a.npz", **arrays)
    assert "compute the joints with the model, and add them as 'joints'" in refused(
        tmp_path / "a.npz"
    )


HALPE = (
    "RHip RKnee RAnkle RBigToe RSmallToe RHeel LHip LKnee LAnkle LBigToe LSmallToe LHeel Neck Head "
    "Nose RShoulder RElbow RWrist LShoulder LElbow LWrist"
)
OPENCAP = (
    "Neck RShoulder RElbow RWrist LShoulder LElbow LWrist midHip RHip RKnee RAnkle LHip LKnee "
    "LAnkle LBigToe LSmallToe LHeel RBigToe RSmallToe RHeel r.ASIS_study C7_study RHJC_study"
)


# Pose2Sim, triangulation.py, make_trc; OpenCap, utils.py, numpy2TRC. Both metres, y up; older
# OpenCap sessions have mm.
@pytest.mark.parametrize(
    ("names", "begin", "unit", "blank"),
    [
        (HALPE, "PathFileType\t4\t(X/Y/Z)\tS00_P00_T01_0-100.trc", "m", ""),
        (OPENCAP, "PathFileType  4\t(X/Y/Z) /code", "m", "\n"),
        (OPENCAP, "PathFileType  4\t(X/Y/Z) /code", "mm", "\n"),
    ],
)
def test_trc_of_pose2sim_and_opencap(tmp_path, names, begin, unit, blank):
    side = {"L": "l_", "R": "r_"}
    parts = {"BigToe": "foot", "SmallToe": "foot", "Heel": "ankle"}
    markers = names.split()
    joints = np.repeat(WALK[:, [JOINTS.index("neck")]], len(markers), axis=1)
    for k, name in enumerate(markers):
        bare = parts.get(name[1:], name[1:].lower())
        own = {"Head": "head", "midHip": "waist"}.get(name, f"{side.get(name[0], '')}{bare}")
        if own in JOINTS:
            joints[:, k] = WALK[:, JOINTS.index(own)]
    cells = joints @ Y_UP.T * (1000 if unit == "mm" else 1)
    tail = "\t" if blank else ""
    lines = [
        begin,
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t"
        "OrigNumFrames",
        f"60.0\t60.0\t{FRAMES}\t{len(markers)}\t{unit}\t60.0\t1\t{FRAMES}",
        "Frame#\tTime\t" + "\t\t\t".join(markers) + "\t\t" + tail,
        "\t\t"
        + "\t".join(f"{c}{k + 1}" for k in range(len(markers)) for c in "XYZ")
        + tail
        + blank,
    ]
    lines += [
        f"{k + 1}\t{k / 60}\t" + "\t".join(map(str, row.ravel())) + tail
        for k, row in enumerate(cells)
    ]
    path = tmp_path / "a.trc"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    stands(opened(path))
