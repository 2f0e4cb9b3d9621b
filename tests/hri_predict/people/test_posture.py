"""A body's own down and its handedness follow the body, wherever it is and wherever it faces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.people.posture import posture_of
from hri_predict.settings import Pose
from hri_predict.skeleton import CANONICAL, JOINTS
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


def unseen(*words):
    return np.array([not any(word in name for word in words) for name in JOINTS])


@given(turn=rotations, move=moves)
def test_down_turns_with_the_body_and_handedness_never_changes(turn, move):
    before, after = posture_of(BODY, ALL), posture_of(BODY @ turn.T + move, ALL)
    assert after.down == pytest.approx(turn @ before.down, abs=1e-9)
    assert after.bones_m == pytest.approx(before.bones_m)
    assert after.handed_m == pytest.approx(before.handed_m, abs=1e-9)


@given(yaw=st.floats(-4, 4), x=st.floats(-9, 9), y=st.floats(-9, 9))
def test_turns_and_moves_over_the_floor_change_no_height_and_no_tilt(yaw, x, y):
    c, s = np.cos(yaw), np.sin(yaw)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    before, after = posture_of(BODY, ALL), posture_of(BODY @ turn.T + [x, y, 0], ALL)
    assert after.down[2] == pytest.approx(before.down[2])
    assert (after.feet_m, *after.heights) == pytest.approx((before.feet_m, *before.heights))


@given(turn=rotations)
def test_a_mirror_and_swapped_names_invert_the_handedness(turn):
    natural = posture_of(BODY, ALL).handed_m
    assert natural > 0.1
    assert posture_of((BODY * [1, -1, 1]) @ turn.T, ALL).handed_m == pytest.approx(-natural)
    assert posture_of(BODY[SWAPPED] @ turn.T, ALL).handed_m == pytest.approx(-natural)


def test_who_stands_agrees_on_down_in_all_bones():
    posture = posture_of(BODY, ALL)
    assert -posture.down[2] > 0.95 * posture.bones_m
    assert posture.has_leg


def test_without_a_trunk_nothing_is_said():
    arms = np.array([name[2:] in ("shoulder", "elbow", "wrist") for name in JOINTS])
    arms[JOINTS.index("neck")] = True
    assert posture_of(BODY, arms) is None


def test_a_thigh_without_its_shank_does_not_count_as_a_leg():
    posture = posture_of(BODY, unseen("ankle", "foot"))
    assert not posture.has_leg
    assert posture.down == pytest.approx(posture_of(BODY, unseen("knee", "ankle", "foot")).down)
    assert posture.feet_m is None


def test_a_raised_arm_says_nothing_of_left_and_right():
    raised = BODY.copy()
    for side in "lr":
        for joint, up in (("elbow", 0.3), ("wrist", 0.6), ("hand", 0.8)):
            shoulder = raised[JOINTS.index(f"{side}_shoulder")]
            raised[JOINTS.index(f"{side}_{joint}")] = shoulder + np.array([0.05, 0.0, up])
    assert posture_of(raised, unseen("hip", "knee", "ankle", "foot")).handed_m is None
