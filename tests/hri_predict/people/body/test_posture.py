"""A body's own down and its handedness follow the body, wherever it is and wherever it faces."""

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.settings import Pose
from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.people.body.posture import Posture, posture_of, postures_of, shows_down
from hri_sim.people.body import Body

J = len(JOINTS)
ALL = np.ones(J, bool)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.4))
SWAPPED = np.arange(J)
for left, right in CANONICAL.left_right_pairs:
    SWAPPED[left], SWAPPED[right] = right, left

rotations = (
    st.lists(st.floats(-1, 1), min_size=4, max_size=4)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: Pose(quaternion_xyzw=list(np.array(q) / np.linalg.norm(q))).matrix()[:3, :3])
)
moves = st.lists(st.floats(-5, 5), min_size=3, max_size=3).map(np.array)


def posture(body, observed=ALL) -> Posture:
    return posture_of(body, observed)


def handed(body, observed=ALL) -> float:
    found = posture(body, observed).handed_m
    assert found is not None
    return found


def unseen(*words):
    return np.array([not any(word in name for word in words) for name in JOINTS])


@given(turn=rotations, move=moves)
def test_down_turns_with_the_body_and_handedness_never_changes(turn, move):
    before, after = posture(BODY), posture(BODY @ turn.T + move)
    assert after.down == pytest.approx(turn @ before.down, abs=1e-9)
    assert after.bones_m == pytest.approx(before.bones_m)
    assert handed(BODY @ turn.T + move) == pytest.approx(handed(BODY), abs=1e-9)


@given(yaw=st.floats(-4, 4), x=st.floats(-9, 9), y=st.floats(-9, 9))
def test_turns_and_moves_over_the_floor_change_no_height_and_no_tilt(yaw, x, y):
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before, after = posture(BODY), posture(BODY @ turn.T + [x, y, 0])
    assert after.down[2] == pytest.approx(before.down[2])
    assert (after.feet_m, *after.heights) == pytest.approx((before.feet_m, *before.heights))


@given(turn=rotations)
def test_a_mirror_and_swapped_names_invert_the_handedness(turn):
    natural = handed(BODY)
    assert natural > 0.1
    assert handed((BODY * [1, -1, 1]) @ turn.T) == pytest.approx(-natural)
    assert handed(BODY[SWAPPED] @ turn.T) == pytest.approx(-natural)


def test_who_stands_agrees_on_down_in_all_bones():
    found = posture(BODY)
    assert -found.down[2] > 0.95 * found.bones_m
    assert found.has_leg


def only(*words):
    return ~unseen(*words)


def test_arms_alone_show_no_direction_and_still_have_heights():
    arms = only("shoulder", "elbow", "wrist")
    found = posture(BODY, arms)
    assert found.bones == 0
    assert not shows_down(arms)
    assert found.lowest_m == sorted(BODY[arms, 2])[1]
    assert posture(BODY + np.array([0.0, 0.0, 2.0]), arms).above_m == pytest.approx(
        found.above_m + 2
    )


@pytest.mark.parametrize(
    "words", [("shoulder", "hip"), ("head", "shoulder"), ("head", "neck"), ("neck", "waist")]
)
def test_shoulders_against_hips_and_a_head_against_either_show_down(words):
    seen = only(*words) & (np.array(JOINTS) != "head_top")
    assert shows_down(seen)
    found = posture(BODY, seen)
    assert -found.down[2] > 0.8 * found.bones_m


def test_raised_arms_do_not_outvote_a_head():
    raised = BODY.copy()
    arms = only("elbow", "wrist", "hand")
    raised[arms, 2] = 2.8 - raised[arms, 2]
    upper = only("head", "neck", "shoulder", "elbow", "wrist")
    assert posture(raised, upper).down[2] < 0
    assert posture(raised, upper).bones == 1


def test_one_joint_astray_changes_no_height():
    astray = BODY.copy()
    astray[JOINTS.index("l_wrist")] = [0.0, 0.0, 9.0]
    assert posture(astray).above_m < 0.0


def test_a_thigh_without_its_shank_does_not_count_as_a_leg():
    found = posture(BODY, unseen("ankle", "foot"))
    assert not found.has_leg
    assert found.down == pytest.approx(posture(BODY, unseen("knee", "ankle", "foot")).down)
    assert found.feet_m is None


def test_a_raised_arm_says_nothing_of_left_and_right():
    raised = BODY.copy()
    for side in "lr":
        for joint, up in (("elbow", 0.3), ("wrist", 0.6), ("hand", 0.8)):
            shoulder = raised[JOINTS.index(f"{side}_shoulder")]
            raised[JOINTS.index(f"{side}_{joint}")] = shoulder + np.array([0.05, 0.0, up])
    assert posture(raised, unseen("hip", "knee", "ankle", "foot")).handed_m is None


@given(seed=st.integers(0, 2**32 - 1), people=st.integers(1, 6))
def test_many_bodies_have_the_postures_of_each_alone(seed, people):
    rng = np.random.default_rng(seed)
    bodies = BODY + rng.normal(0.0, 0.2, (people, J, 3))
    seen = rng.random((people, J)) < rng.uniform(0.2, 1.0, (people, 1))
    seen[:, rng.integers(J)] = True
    garbage = np.where(seen[..., None], bodies, rng.choice([np.nan, 1e9]))
    for body, observed, found in zip(bodies, seen, postures_of(garbage, seen), strict=True):
        mine, alone = astuple(found), astuple(posture_of(body, observed))
        for value, expected in zip(mine, alone, strict=True):
            # sums of at most 17 coordinates below 3 m, in any order
            assert value == (None if expected is None else pytest.approx(expected, abs=1e-13))
