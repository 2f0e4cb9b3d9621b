"""An approach as a source: an empty room first, then everybody where they were put."""

import dataclasses
import math

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_sim.simulation.approach import ApproachSettings, ApproachSource, over_floor, together
from hri_sim.simulation.motion import load_motion


def source(**settings):
    return ApproachSource(ApproachSettings(kind="approach", **settings))


def scenes(approach):
    approach.open(1_000)
    found = []
    while (due := approach.next_ns()) is not None:
        assert approach.poll(due - 1) is None
        found.append(approach.poll(due))
    return found


def test_the_room_is_empty_for_the_lead_in_and_then_the_motion_plays_at_its_place():
    found = scenes(
        source(motions=["procedural:1"], places=[[1.0, 2.0, math.pi / 2]], lead_in_s=0.5)
    )
    motion = load_motion("procedural:1", 30.0)
    assert [len(scene.people) for scene in found[:16]] == [0] * 15 + [1]
    assert len(found) == 15 + len(motion.capture_ns)
    assert [scene.sequence for scene in found] == list(range(len(found)))
    assert found[15].stamp_ns == 1_000 + 500_000_000
    # a quarter turn takes (x, y) to (-y, x), and then it is moved by (1, 2)
    x, y, z = motion.positions[7].T
    expected = np.stack([1.0 - y, 2.0 + x, z], axis=-1)
    np.testing.assert_allclose(found[22].people[0].positions, expected, atol=1e-12)


def test_several_people_are_told_apart_and_end_with_the_shortest():
    found = scenes(
        source(
            motions=["procedural:1", "procedural:2"],
            places=[[0, 0, 0], [3, 0, 0]],
            lead_in_s=0.0,
        )
    )
    assert [p.id for p in found[0].people] == [1, 2]
    lengths = [len(load_motion(f"procedural:{s}", 30.0).capture_ns) for s in (1, 2)]
    assert len(found) == min(lengths)


def test_a_last_capture_that_comes_early_is_left_out(recording):
    """A recording of 120 Hz that is played at 30 Hz ends with its last frame, whenever that is."""
    whole = load_motion(str(recording), 30.0)
    early = whole.capture_ns[:40].copy()
    early[-1] -= 8_333_333
    short = dataclasses.replace(
        whole, capture_ns=early, positions=whole.positions[:40], observed=whole.observed[:40]
    )
    for motions in ([whole, short], [short, whole]):
        assert together(motions).tolist() == whole.capture_ns[:39].tolist()


def test_nobody_named_is_refused():
    with pytest.raises(ConfigError, match="hri-predict simulate"):
        source()


def test_people_of_two_rates_are_refused(recording, tmp_path):
    slow = tmp_path / "slow.npz"
    arrays = dict(np.load(recording)) | {"fps": np.float32(20)}
    np.savez(slow, **arrays)
    with pytest.raises(ConfigError, match="need the same rate"):
        source(motions=[str(recording), str(slow)], places=[[0, 0, 0]] * 2)


def test_over_floor_is_rigid_and_keeps_heights():
    matrix = over_floor([0.3, -1.0, 0.7])
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(matrix[2], [0, 0, 1, 0])


def test_the_tracker_delivers_what_the_recordings_have(tmp_path):
    """What no recording has is inferred, as of any tracker that lacks it."""
    lacking = ("head_top", "l_hand")
    motion = load_motion("procedural:1", 30.0)
    joints = [i for i, name in enumerate(JOINTS) if name not in lacking]
    header = ",".join(["t", *(f"{JOINTS[i]}_{axis}" for i in joints for axis in "xyz")])
    rows = [
        ",".join(map(repr, [k / 30, *map(float, body[joints].ravel())]))
        for k, body in enumerate(motion.positions[:90])
    ]
    (tmp_path / "walk.csv").write_text("\n".join([header, *rows]) + "\n")
    one = source(motions=[str(tmp_path / "walk.csv")], places=[[0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(one.joint_map.mapped, ~np.isin(JOINTS, lacking))
    both = [str(tmp_path / "walk.csv"), "procedural:1"]
    assert source(motions=both, places=[[0.0, 0.0, 0.0]] * 2).joint_map.mapped.all()


def noisy(place, **settings):
    errors = {"noise_m": 0.02, "wander_m": 0.01, "lead_in_s": 0.5} | settings
    return source(motions=["procedural:1"], places=[place], **errors)


def test_noise_moves_with_the_motion_and_the_truth_has_none():
    here, there = (scenes(noisy(place)) for place in ([0, 0, 0], [1.0, 2.0, math.pi / 2]))
    approach = noisy([0, 0, 0])
    approach.open(1_000)
    motion = load_motion("procedural:1", 30.0)
    x, y, z = here[20].people[0].positions.T
    expected = np.stack([1.0 - y, 2.0 + x, z], axis=-1)
    np.testing.assert_allclose(there[20].people[0].positions, expected, atol=1e-12)
    off = []
    for k, scene in enumerate(here[15:]):
        positions, known = approach.truth(scene.stamp_ns)[1]
        np.testing.assert_allclose(positions[known], motion.positions[k][known], atol=1e-9)
        off.append(scene.people[0].positions - positions)
    deviation = np.std(off)
    assert 0.9 * math.hypot(0.02, 0.01) < deviation < 1.1 * math.hypot(0.02, 0.01)


def test_a_tracker_delivers_its_joints_and_the_truth_has_all():
    approach = source(motions=["procedural:1"], places=[[0, 0, 0]], tracker="coco17", lead_in_s=0.5)
    found = scenes(approach)
    approach.open(1_000)
    hand = JOINTS.index("l_hand")
    assert not approach.joint_map.mapped[hand]
    assert not found[20].people[0].observed[hand]
    assert found[20].people[0].observed[JOINTS.index("l_wrist")]
    _, known = approach.truth(found[20].stamp_ns)[1]
    assert known[hand]


def test_a_joint_between_two_that_were_not_recorded_is_not_delivered(monkeypatch):
    motion = load_motion("procedural:1", 30.0)
    lacking = motion.observed.copy()
    lacking[:, JOINTS.index("l_hip")] = False
    lacks = dataclasses.replace(motion, observed=lacking)
    monkeypatch.setattr("hri_sim.simulation.approach.load_motion", lambda *_: lacks)
    approach = source(motions=["procedural:1"], places=[[0, 0, 0]], tracker="coco17")
    assert load_joint_map("coco17").mapped[JOINTS.index("waist")]
    assert not approach.joint_map.mapped[[JOINTS.index("waist"), JOINTS.index("l_hip")]].any()
    assert approach.joint_map.mapped[JOINTS.index("r_hip")]


def test_a_tracker_loses_arms_and_legs_for_moments_and_nothing_else():
    given = {"motions": ["procedural:1"], "places": [[0, 0, 0]], "lead_in_s": 0.0}
    whole = scenes(source(**given))
    lossy = source(**given, lost_limbs=0.3, lost_s=0.2)
    seen = np.array([scene.people[0].observed for scene in scenes(lossy)])
    lost = np.array([scene.people[0].observed for scene in whole]) & ~seen
    arm = [JOINTS.index(f"l_{name}") for name in ("elbow", "wrist", "hand")]
    assert not lost[:, [JOINTS.index(name) for name in ("head", "l_shoulder", "r_hip")]].any()
    assert (lost[:, arm].all(1) | ~lost[:, arm].any(1)).all()
    assert 0.15 < lost[:, arm].mean() < 0.5
    runs = np.diff(np.flatnonzero(np.diff(lost[:, arm[0]].astype(int))))
    assert 2 < runs[::2].mean() < 20  # of about 6 captures
    lossy.open(1_000)
    assert lossy.truth(1_000)[1][1].all()
