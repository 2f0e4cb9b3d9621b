"""Recordings as NumPy archives: the data pack's two layouts, and what goes wrong with files."""

import io
import math
import zipfile
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import JOINTS
from hri_predict.recording import open_recording, placed
from hri_predict.recording.formats import npz
from hri_predict.recording.formats.npz import read_arrays
from hri_predict.recording.recording import action_of, start_of
from tests.shared import DATA, needs_data

WALKING = DATA / "cmu_mocap" / "test" / "walking_1.npz"
ASSEMBLY = DATA / "assembly" / "task1_human1_trial1.npz"


def _canonical(recording, k):
    person = recording.scenes[k].people[0]
    return recording.joint_map.map(person.positions, person.observed)


@pytest.mark.parametrize(
    ("more", "lacking"), [({}, "'parents' and 'fps';"), ({"fps": 30.0}, "'parents';")]
)
def test_missing_keys_of_any_body_are_named(tmp_path, more, lacking) -> None:
    np.savez(tmp_path / "a.npz", positions=np.zeros((3, 21, 3)), joint_names=list(JOINTS), **more)
    with pytest.raises(RecordingError, match=f"lacks {lacking}"):
        open_recording(tmp_path / "a.npz")


@needs_data
def test_cmu_is_120_hz_z_up_on_the_floor_without_its_rest_pose() -> None:
    recording = open_recording(WALKING)
    raw = np.load(WALKING)
    assert recording.rate_hz == 120.0
    assert len(recording.scenes) == len(raw["positions_world"]) - 1
    x, y, z = raw["positions_world"][1].astype(float).T  # y up; forward z, left x
    expected = np.stack([z, x, y - float(raw["floor_height"])], axis=1)
    np.testing.assert_allclose(recording.scenes[0].people[0].positions, expected, atol=1e-9)
    lowest = [s.people[0].positions[:, 2].min() for s in recording.scenes]
    assert abs(np.percentile(lowest, 2)) < 0.005  # feet on the floor
    assert recording.scenes[120].stamp_ns == 1_000_000_000
    joints, seen = _canonical(recording, 0)
    assert seen[JOINTS.index("waist")]
    assert 0.85 < joints[JOINTS.index("waist")][2] < 1.1


@needs_data
def test_frames_with_an_artefact_have_a_person_and_no_observed_joint() -> None:
    path = DATA / "cmu_mocap" / "train" / "walking_extra_50.npz"
    recording = open_recording(path)
    ok = np.load(path)["world_ok"][1:]
    assert 0 < np.count_nonzero(~ok) < len(ok)
    for good, scene in zip(ok, recording.scenes, strict=True):
        (person,) = scene.people
        assert scene.sees_room
        assert bool(person.observed.all()) == bool(good)
        assert bool(np.isnan(person.positions).any()) == (not good)


@needs_data
def test_assembly_is_two_arms_in_the_camera_frame_with_what_is_missing_unobserved() -> None:
    recording = open_recording(DATA / "assembly" / "task3_human2_trial2.npz")
    assert recording.rate_hz == 30.0
    names = recording.joint_map.source_joints
    person = recording.scenes[211].people[0]
    unseen = {n for n, seen in zip(names, person.observed, strict=True) if not seen}
    assert unseen == {"RightShoulder", "RightWrist", "RightElbow"}
    whole = open_recording(ASSEMBLY)
    joints, seen = _canonical(whole, 0)
    arms = {f"{side}_{part}" for side in "lr" for part in ("shoulder", "elbow", "wrist")}
    assert {JOINTS[i] for i in np.flatnonzero(seen)} == {*arms, "neck"}
    left, right = joints[JOINTS.index("l_shoulder")], joints[JOINTS.index("r_shoulder")]
    # The person faces the camera, which looks along the recording's x: their left is at -y.
    assert left[1] < right[1]
    assert 0.4 < left[0] < 1.2


@needs_data
@pytest.mark.parametrize("path", [WALKING, ASSEMBLY], ids=["walking", "assembly"])
def test_place_puts_the_start_where_it_is_asked_and_moves_nothing_else(path: Path) -> None:
    recording = open_recording(path)
    moved = placed(recording, Pose(xyz=[0.3, 0.1, 0.7]), [2.0, -1.0, math.radians(120)])
    anchor, heading = start_of(moved)
    np.testing.assert_allclose(anchor, [2.0, -1.0], atol=1e-9)
    assert heading == pytest.approx(math.radians(120))
    for k in (0, 100, len(recording.scenes) - 1):
        before = recording.scenes[k].people[0].positions
        after = moved.scenes[k].people[0].positions
        np.testing.assert_allclose(after[:, 2], before[:, 2] + 0.7, atol=1e-9)
        np.testing.assert_allclose(
            np.linalg.norm(after - after[0], axis=1),
            np.linalg.norm(before - before[0], axis=1),
            atol=1e-9,
        )


@needs_data
def test_a_walk_placed_with_a_heading_goes_that_way() -> None:
    moved = placed(open_recording(WALKING), Pose(), [1.0, 2.0, math.pi / 2])
    joints, _ = _canonical(moved, 240)
    travel = joints[JOINTS.index("waist")][:2] - [1.0, 2.0]
    assert travel[1] > 1.5
    assert abs(travel[0]) < 0.4


def test_room_from_source_is_applied(tmp_path: Path) -> None:
    path = _whole_body(tmp_path / "a.npz", frames=3)
    half_turn = Pose(xyz=[1.0, 2.0, 3.0], quaternion_xyzw=[0.0, 0.0, 1.0, 0.0])
    before = open_recording(path).scenes[0].people[0].positions
    after = placed(open_recording(path), half_turn, None).scenes[0].people[0].positions
    np.testing.assert_allclose(after, before * [-1, -1, 1] + [1, 2, 3], atol=1e-9)


def test_the_person_gets_the_id_asked_for(tmp_path: Path) -> None:
    recording = open_recording(_whole_body(tmp_path / "a.npz", frames=2), person=7)
    assert [p.id for s in recording.scenes for p in s.people] == [7, 7]


SETS = {
    "cmu_tools/62_03": (60.0, "daz23"),
    "cmu_dance/salsa_01": (60.0, "daz23"),
    "cmu_subjects/07_03": (120.0, "cmu38"),
    "cmu_misc/16_01": (120.0, "cmu38_asf"),
    "beside_robot/RobotHandball_0": (100.0, "marker_clusters9"),
}


@needs_data
@pytest.mark.parametrize("name", SETS)
def test_motion_is_z_up_on_its_floor_with_its_own_map_and_its_set_as_action(name: str) -> None:
    recording = open_recording(DATA / "motion" / f"{name}.npz")
    assert (recording.rate_hz, recording.joint_map.name) == SETS[name]
    assert (recording.kind, recording.action) == ("motion", name.split("/")[0])
    joints, seen = _canonical(recording, 0)  # standing
    if "beside_robot" in name:  # no joint centre but these; its floor is unknown
        arms = {f"{side}_{part}" for side in "lr" for part in ("shoulder", "elbow", "wrist")}
        assert {JOINTS[i] for i in np.flatnonzero(seen)} <= {"head_top", *arms}
        return
    feet = joints[[JOINTS.index("l_foot"), JOINTS.index("r_foot")], 2]
    assert -0.05 < feet.min() < 0.15
    assert 0.7 < joints[JOINTS.index("waist"), 2] < 1.1
    assert joints[JOINTS.index("head"), 2] > joints[JOINTS.index("waist"), 2] + 0.3


@needs_data
def test_walking_people_of_motion_face_where_they_go() -> None:
    """The left hip is at the left of the line of travel."""
    for path in sorted((DATA / "motion").glob("cmu_subjects/0[78]*.npz")):
        recording = open_recording(path)
        first, last = (_canonical(recording, k)[0] for k in (0, -1))
        ahead = (last - first)[JOINTS.index("waist"), :2]
        across = (first[JOINTS.index("l_hip")] - first[JOINTS.index("r_hip")])[:2]
        assert ahead[0] * across[1] - ahead[1] * across[0] > 0, path.name


@needs_data
def test_what_motion_marks_as_invalid_or_as_a_jump_is_unobserved() -> None:
    for name, key in (("cmu_tools/62_01", "valid"), ("beside_robot/PickPlaceCloseHuman_3", "jump")):
        path = DATA / "motion" / f"{name}.npz"
        raw = np.load(path)
        wrong = (~raw["valid"] | raw["jump"]) | np.isnan(raw["positions"]).any(axis=-1)
        assert raw[key].any()
        assert not raw[key].all()
        seen = np.stack([scene.people[0].observed for scene in open_recording(path).scenes])
        np.testing.assert_array_equal(seen, ~wrong)


def _any_body(path: Path, **more: object) -> Path:
    arrays: dict[str, object] = {
        "positions": np.ones((4, 6, 3), dtype=np.float32),
        "joint_names": np.array(["l_shoulder", "l_elbow", "l_wrist", "r_hip", "r_knee", "waist"]),
        "parents": np.array([-1, 0, 1, 5, 3, -1]),
        "fps": np.float32(50),
    }
    np.savez(path, **arrays | more)  # type: ignore[arg-type]
    return path


def test_a_body_of_the_users_own_in_the_layout_of_motion_is_read(tmp_path: Path) -> None:
    (tmp_path / "night").mkdir()
    path = _any_body(tmp_path / "night" / "a_1.npz", floor_height=np.float32(0.25))
    recording = open_recording(path)
    assert (recording.joint_map.name, recording.action) == ("canonical", "night")
    assert recording.scenes[0].people[0].positions[0].tolist() == [1.0, 1.0, 0.75]
    assert recording.scenes[0].people[0].observed.all()
    assert recording.floor_m == 0.25


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"valid": np.ones((4, 5), dtype=bool)}, "'valid' is bool of shape (4, 5); expected"),
        ({"jump": np.zeros((4, 6))}, "'jump' is float64 of shape (4, 6)"),
        ({"joint_names": np.array(["a"] * 6)}, "'joint_names' has 1 different names for 6 joints"),
        ({"joint_names": np.array(list("abcdef"))}, "no joint matches l_shoulder"),
        ({"joint_names": np.array(["a", "b"])}, "expected numbers of shape (frames, 2, 3)"),
        ({"floor_height": np.nan}, "'floor_height' is not one finite number"),
    ],
)
def test_mistakes_in_the_layout_of_motion_are_one_line(tmp_path, change, says) -> None:
    assert says in _error(_any_body(tmp_path / "a.npz", **change))


@pytest.mark.parametrize(
    ("file", "action"),
    [
        ("walking_extra_12.csv", "walking_extra"),
        ("task1_human2_trial1.csv", "task1_human2_trial1"),
        ("12.csv", "12"),
        ("_3.csv", "_3"),
    ],
)
def test_action_is_the_name_without_its_number(file: str, action: str) -> None:
    assert action_of(Path(file)) == action


def _whole_body(path: Path, frames: int, **more: object) -> Path:
    positions = np.random.default_rng(1).normal(size=(frames, 38, 3)).astype(np.float32)
    arrays = {"positions_world": positions, "fps": np.float32(120)} | more
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


def _error(path: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        open_recording(path)
    text = str(caught.value)
    assert "\n" not in text
    assert path.name in text
    return text


def test_missing_and_unknown_kinds_say_what_is_accepted(tmp_path: Path) -> None:
    assert "no such file" in _error(tmp_path / "gone.npz")
    assert ".bvh" in _error(tmp_path)
    (tmp_path / "a.fbx").write_bytes(b"x")
    assert ".mcap" in _error(tmp_path / "a.fbx")
    (tmp_path / "a.npz").write_bytes(b"")
    assert "empty" in _error(tmp_path / "a.npz")


@pytest.mark.parametrize("keep", [1, 3, 10, 100, 0.3, 0.6, 0.9, -1, -30])
def test_a_truncated_archive_is_one_clear_error(tmp_path: Path, keep: float) -> None:
    path = _whole_body(tmp_path / "a.npz", frames=20)
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * keep) if 0 < keep < 1 else int(keep)])
    assert "truncated" in _error(path)


def _stored(path: Path, npy: bytes, compression: int = zipfile.ZIP_STORED) -> Path:
    """An archive whose ``positions_world`` is these bytes."""
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr("positions_world.npy", npy)
    return path


def test_a_damaged_header_or_archive_is_one_clear_error(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    cut = b"{'descr': '<f8', 'fortran_order': False, 'shape': (((((3, )"
    assert "copy it again" in _error(_stored(path, b"\x93NUMPY\x01\x00v\x00" + cut.ljust(182)))
    with pytest.raises(RecordingError, match="copy it again"):
        read_arrays(_stored(path, b"no header"), ("positions_world",))
    huge = io.BytesIO()
    shape = {"descr": "<f8", "fortran_order": False, "shape": (10**12, 38, 3)}
    np.lib.format.write_array_header_1_0(huge, shape)
    assert "copy it again" in _error(_stored(path, huge.getvalue()))
    data = bytearray(_stored(path, bytes(range(256)) * 9, zipfile.ZIP_LZMA).read_bytes())
    data[80:400] = b"\xff" * 320
    path.write_bytes(data)
    assert "copy it again" in _error(path)
    data = bytearray(_stored(path, b"1" * 99).read_bytes())
    for record, flags in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(record) + flags] |= 1  # says that it is encrypted
    path.write_bytes(data)
    assert "copy it again" in _error(path)


def test_an_archive_larger_than_the_memory_is_not_unpacked(tmp_path: Path, monkeypatch) -> None:
    path = _whole_body(tmp_path / "a.npz", frames=20)
    assert len(read_arrays(path, ("positions_world",))) == 1
    monkeypatch.setattr(npz, "MAX_BYTES", 5000)
    assert "when unpacked" in _error(path)
    assert list(read_arrays(path, ("fps",))) == ["fps"]  # what is not read does not count
    with pytest.raises(RecordingError, match="when unpacked"):
        read_arrays(path, ("positions_world",))


def test_damaged_bytes_never_end_in_anything_but_a_recording_error(tmp_path: Path) -> None:
    path = _whole_body(tmp_path / "a.npz", frames=4)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(2)
    for _ in range(300):
        damaged = bytearray(data)
        for where in rng.integers(0, len(data), 3):
            damaged[where] = rng.integers(0, 256)
        path.write_bytes(damaged)
        try:
            recording = open_recording(path)
        except RecordingError:
            continue
        assert len(recording.scenes) > 0


def test_what_is_wrong_inside_an_archive_is_named(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    assert "no frames" in _error(_whole_body(path, frames=0))
    assert "fps" in _error(_whole_body(path, frames=2, fps=np.float32(0)))
    assert "world_ok" in _error(_whole_body(path, frames=2, world_ok=np.ones(5, bool)))
    np.savez(path, something=np.zeros(3))
    assert "positions_world" in _error(path)
    np.savez(path, positions_world=np.zeros((5, 21, 3)), fps=120)
    assert "38" in _error(path)
    names = ["LeftWrist", "RightWrist", "LeftElbow", "RightElbow", "LeftShoulder", "Nose"]
    np.savez(path, positions=np.zeros((5, 6, 3)), joint_names=names, fps=30)
    assert "Nose" in _error(path)
    np.savez(path, positions_world=np.array([{"a": 1}], dtype=object), fps=120)
    assert "NumPy archive" in _error(path)  # a pickle is never opened


def test_arms_are_found_by_name_whatever_their_order(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    names = ["RightWrist", "LeftWrist", "LeftElbow", "RightElbow", "LeftShoulder", "RightShoulder"]
    positions = np.random.default_rng(3).normal(size=(4, 6, 3))
    np.savez(path, positions=positions, joint_names=names, fps=30)
    recording = open_recording(path)
    wrist = recording.joint_map.source_joints.index("RightWrist")
    expected = recording.joint_map.to_metres_z_up(positions[2, 0])
    np.testing.assert_allclose(recording.scenes[2].people[0].positions[wrist], expected)
