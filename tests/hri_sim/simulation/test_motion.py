"""Motions: recordings and scripts, each in its own frame with the floor at z = 0."""

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError, UnusableRecordingError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_sim.simulation.motion import load_motion


def test_a_script_is_the_same_for_the_same_seed_and_reaches_out():
    one, again, other = (load_motion(f"procedural:{s}", 30.0) for s in (5, 5, 6))
    np.testing.assert_array_equal(one.positions, again.positions)
    assert one.positions.shape != other.positions.shape or (one.positions != other.positions).any()
    assert one.duration_s > 3.0
    assert one.observed.all()
    lowest = one.positions[..., 2].min(axis=1)
    assert ((lowest > -0.05) & (lowest < 0.25)).all()  # feet on the floor


def test_arms_in_a_cameras_frame_are_lifted_to_where_one_sits(recording):
    motion = load_motion(str(recording), 30.0)
    shoulders = [JOINTS.index("l_shoulder"), JOINTS.index("r_shoulder")]
    assert np.nanmean(motion.positions[:, shoulders, 2]) == pytest.approx(1.05)
    assert not motion.observed[:, JOINTS.index("l_foot") if "l_foot" in JOINTS else 0].any()


def test_clusters_without_a_floor_are_lifted_to_where_one_stands(tmp_path):
    names = load_joint_map("marker_clusters9").source_joints
    positions = np.random.default_rng(0).normal(size=(60, len(names), 3), scale=0.02)
    for name, place in {
        "head": [0.0, 0.0, 0.3],
        "left_shoulder": [0.0, 0.12, 0.0],
        "right_shoulder": [0.0, -0.12, 0.0],
        "left_elbow": [-0.1, 0.2, -0.2],
        "right_elbow": [-0.1, -0.2, -0.2],
        "left_hand": [0.1, 0.2, -0.2],
        "right_hand": [0.1, -0.2, -0.2],
        "hip": [0.0, 0.0, -0.3],
    }.items():
        positions[:, names.index(name)] += place
    path = tmp_path / "stack_1.npz"
    np.savez(
        path,
        positions=positions.astype(np.float32),
        joint_names=np.array(names),
        parents=np.full(9, -1),
        fps=np.float32(30),
    )
    crown = load_motion(str(path), 30.0).positions[:, JOINTS.index("head_top"), 2]
    assert np.mean(crown) == pytest.approx(1.71)


def test_a_recording_plays_at_the_rate_asked_for_or_its_own(recording):
    assert load_motion(str(recording), 15.0).rate_hz == 15.0
    assert load_motion(str(recording), 60.0).rate_hz == 30.0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("procedural:x", "procedural:SEED"),
        ("monday.mcap", "motion files"),
    ],
)
def test_what_cannot_be_placed_is_refused_in_one_line(name, message):
    with pytest.raises(ConfigError, match=message) as error:
        load_motion(name, 30.0)
    assert "\n" not in str(error.value)


def test_a_recording_shorter_than_a_second_is_refused(tmp_path):
    path = tmp_path / "short.npz"
    np.savez(path, positions=np.ones((20, 6, 3), np.float32), fps=np.float32(30))
    with pytest.raises(UnusableRecordingError, match=r"too short: it ends 0.63 s after a person"):
        load_motion(str(path), 30.0)


def test_a_motion_begins_where_somebody_comes_into_view(tmp_path):
    positions = np.random.default_rng(0).normal(size=(90, 6, 3)).astype(np.float32)
    for name, seen_from in (("late", 20), ("never", 90)):
        later = positions.copy()
        later[:seen_from] = np.nan
        np.savez(tmp_path / f"{name}.npz", positions=later, fps=np.float32(30))
    motion = load_motion(str(tmp_path / "late.npz"), 30.0)
    assert motion.observed[0].any()
    assert (motion.capture_ns[0], len(motion.capture_ns)) == (0, 70)
    with pytest.raises(UnusableRecordingError, match="shows no person"):
        load_motion(str(tmp_path / "never.npz"), 30.0)


@pytest.mark.parametrize("first", [0, 1])
def test_a_recording_with_every_second_frame_empty_is_used_at_a_lower_rate(tmp_path, first):
    positions = np.random.default_rng(0).normal(size=(180, 6, 3)).astype(np.float32)
    positions[first::2] = np.nan
    np.savez(tmp_path / "half.npz", positions=positions, fps=np.float32(60))
    motion = load_motion(str(tmp_path / "half.npz"), 30.0)
    assert motion.observed.any(axis=1).all()
    assert motion.duration_s > 2.9
