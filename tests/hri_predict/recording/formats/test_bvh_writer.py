"""Written BVH files: rigid bones near the joints, as bvhio, which we did not write, reads them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS, PARENTS
from hri_predict.contracts.scene import Person, Scene
from hri_predict.recording import Recording, open_recording
from hri_predict.recording.converting import write_recording
from hri_predict.recording.formats.bvh_writer import follow, zxy_degrees
from hri_predict.recording.naming import map_of_names
from tests.hri_predict.recording.made import of_scenes
from tests.shared import DATA, needs_data

bvhio = pytest.importorskip("bvhio", reason="compares with bvhio, which is not installed")


def rigid_body(frames=6, seed=0) -> np.ndarray:
    """(F, 21, 3): a body of constant bones, in which the waist and the neck are midpoints."""
    rng = np.random.default_rng(seed)
    lengths = rng.uniform(0.1, 0.5, len(JOINTS))
    way = rng.normal(size=(frames, len(JOINTS), 3))
    for j in (JOINTS.index("r_shoulder"), JOINTS.index("r_hip")):
        way[:, j] = -way[:, j - 4]
        lengths[j] = lengths[j - 4]
    way /= np.linalg.norm(way, axis=-1, keepdims=True)
    joints = np.zeros_like(way)
    joints[:, 0] = rng.uniform(-2, 2, (frames, 3))
    for j, parent in enumerate(PARENTS[1:], start=1):
        joints[:, j] = joints[:, parent] + way[:, j] * lengths[j]
    return joints


def recording_of(joints: np.ndarray, seen=None, names=JOINTS) -> Recording:
    seen = np.ones(joints.shape[:2], bool) if seen is None else seen
    scenes = [
        Scene(round(k * 1e9 / 50), k, True, (Person(1, row, s),))
        for k, (row, s) in enumerate(zip(joints, seen, strict=True))
    ]
    return of_scenes(scenes, map_of_names(names), 50.0)


def canonical(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    people = [scene.people[0] for scene in recording.scenes]
    pairs = [recording.joint_map.map(p.positions, p.observed) for p in people]
    return np.array([p[0] for p in pairs]), np.array([p[1] for p in pairs])


def test_a_body_of_rigid_bones_comes_out_where_it_was(tmp_path):
    joints = rigid_body()
    written = write_recording(recording_of(joints), tmp_path / "a.bvh", "bvh")
    assert not +written.dropped
    assert written.notes == [
        "rigid bones and rotations: the joints are 0.0 mm off on average, 0.0 mm at most"
    ]
    found, seen = canonical(open_recording(tmp_path / "a.bvh"))
    assert seen.all()
    np.testing.assert_allclose(found, joints, atol=2e-6)


def test_bvhio_sees_the_same_body(tmp_path):
    joints = rigid_body(frames=4)
    write_recording(recording_of(joints), tmp_path / "a.bvh", "bvh")
    hierarchy = bvhio.readAsHierarchy(str(tmp_path / "a.bvh"))
    for frame in range(4):
        hierarchy.loadPose(frame)
        at = {j.Name: np.array(j.PositionWorld.to_list()) for j, _, _ in hierarchy.layout()}
        for name, joint in (("Hips", "waist"), ("LeftHand", "l_wrist"), ("RightToeBase", "r_foot")):
            x, y, z = joints[frame, JOINTS.index(joint)] * 100
            np.testing.assert_allclose(at[name], [y, z, x], atol=2e-3)  # left, up, forward


@needs_data
def test_a_real_walk_is_off_by_as_much_as_it_says(tmp_path):
    walk = open_recording(DATA / "cmu_mocap" / "test" / "walking_1.npz")
    written = write_recording(walk, tmp_path / "a.bvh", "bvh")
    expected, known = canonical(walk)
    found, seen = canonical(open_recording(tmp_path / "a.bvh"))
    np.testing.assert_array_equal(seen, known)
    off = np.linalg.norm(found - expected, axis=-1)[known] * 1000
    assert f"{off.max():.1f} mm at most" in written.notes[-1]
    assert off.mean() < 1
    assert off.max() < 30  # the toes, whose bone ends at the ball of the foot and at their tip


def test_what_is_not_observed_stays_and_is_counted(tmp_path):
    joints = rigid_body()
    seen = np.ones(joints.shape[:2], bool)
    elbow, top = JOINTS.index("l_elbow"), JOINTS.index("head_top")
    seen[2:4, elbow] = False
    seen[:, top] = False  # never: it is no part of the hierarchy then
    written = write_recording(recording_of(joints, seen), tmp_path / "a.bvh", "bvh")
    assert written.dropped["joint positions that were not observed"] == 2
    assert "HeadTop" not in (tmp_path / "a.bvh").read_text()
    assert any("stay where they were last seen" in note for note in written.notes)


def test_arms_alone_hang_on_the_neck(tmp_path):
    arms = [j for j in JOINTS if j.split("_")[-1] in ("shoulder", "elbow", "wrist", "neck")]
    joints = rigid_body()[:, [JOINTS.index(j) for j in arms]]
    write_recording(recording_of(joints, names=arms), tmp_path / "a.bvh", "bvh")
    back = open_recording(tmp_path / "a.bvh", any_joints=True)
    assert back.joint_map.source_joints[0] == "Neck"
    wrist = back.joint_map.source_joints.index("LeftHand")
    found = np.array([scene.people[0].positions[wrist] for scene in back.scenes])
    np.testing.assert_allclose(found, joints[:, arms.index("l_wrist")], atol=2e-6)


def test_unknown_joints_have_no_hierarchy(tmp_path):
    recording = recording_of(np.zeros((2, 2, 3)), names=["q", "w"])
    with pytest.raises(ConfigError, match="no joint matches"):
        write_recording(recording, tmp_path / "a.bvh", "bvh")


@given(seed=st.integers(0, 10_000), scale=st.sampled_from([0.0, 1e-9, 1.0, 1e3]))
def test_rotations_are_rotations_whatever_the_joints_do(seed, scale):
    rng = np.random.default_rng(seed)
    targets = rng.normal(size=(3, 6, 3)) * scale
    if seed % 3 == 0:
        targets[1] = -targets[0]  # bones turned right round
    rest = rng.normal(size=(6, 3))
    rest /= np.linalg.norm(rest, axis=-1, keepdims=True)
    turns = follow(targets, [-1, 0, 0, 1, 2, 4], rest).rotations
    eye = np.swapaxes(turns, -1, -2) @ turns
    np.testing.assert_allclose(eye, np.broadcast_to(np.eye(3), eye.shape), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(turns), 1, atol=1e-9)


@pytest.mark.parametrize("x", [0.0, 0.5, np.pi / 2, -np.pi / 2])
def test_angles_give_the_rotation_back_even_where_two_axes_coincide(x):
    z, y = 0.7, -1.2
    c, s = np.cos, np.sin
    rz = np.array([[c(z), -s(z), 0], [s(z), c(z), 0], [0, 0, 1]])
    rx = np.array([[1, 0, 0], [0, c(x), -s(x)], [0, s(x), c(x)]])
    ry = np.array([[c(y), 0, s(y)], [0, 1, 0], [-s(y), 0, c(y)]])
    z, x, y = np.radians(zxy_degrees(rz @ rx @ ry))
    rz2 = np.array([[c(z), -s(z), 0], [s(z), c(z), 0], [0, 0, 1]])
    rx2 = np.array([[1, 0, 0], [0, c(x), -s(x)], [0, s(x), c(x)]])
    ry2 = np.array([[c(y), 0, s(y)], [0, 1, 0], [-s(y), 0, c(y)]])
    np.testing.assert_allclose(rz2 @ rx2 @ ry2, rz @ rx @ ry, atol=1e-9)
