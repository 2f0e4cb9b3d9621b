"""Joints that a tracker lost and sent all the same are not observed, and no others."""

import itertools

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map, map_names
from hri_predict.contracts.scene import Person
from hri_predict.people.body.unseen import at_origin, collapsed, out_of_reach
from hri_sim.people.body import Body

_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([2.0, 1.0]), 0.3))
ALL = np.ones(len(JOINTS), bool)
ARM = [JOINTS.index(name) for name in ("l_elbow", "l_wrist", "l_hand")]


def test_only_a_joint_at_exactly_the_origin_is_there():
    origin = np.array([-3.2, 1.2, 1.1])
    body = BODY.copy()
    body[ARM[1]] = origin
    body[ARM[2]] = origin + np.array([1e-9, 0.0, 0.0])
    assert np.flatnonzero(at_origin(body, origin)).tolist() == [ARM[1]]


@pytest.mark.parametrize("lost", [ARM[:1], ARM[1:], ARM, [*ARM, 10, 11, 12]])
def test_joints_too_far_from_the_rest_are_disbelieved_alone(lost):
    body = BODY.copy()
    body[lost] = [0.05, -0.05, 0.0]
    far, misnamed = out_of_reach(body, ALL)
    assert np.flatnonzero(far).tolist() == sorted(lost)
    assert not misnamed


def test_of_two_joints_that_contradict_each_other_neither_is_believed():
    only = np.isin(np.arange(len(JOINTS)), ARM[:2])
    body = BODY.copy()
    body[ARM[1]] += [0.0, 0.0, -1.0]
    assert out_of_reach(body, only)[0].tolist() == only.tolist()


@pytest.mark.parametrize("height", [1.0, 1.5, 2.0])
def test_true_bodies_are_believed(height):
    who = Body(height)
    joints = who.joints(who.standing(np.array([2.0, 1.0]), 0.3))
    noise = np.random.default_rng(0).normal(0, 0.02, joints.shape)
    assert not out_of_reach(joints + noise, ALL)[0].any()
    assert not collapsed((joints + noise)[None], ALL[None]).any()


LIMBS = [
    [JOINTS.index(f"{side}_{name}") for name in names]
    for side in "lr"
    for names in (("shoulder", "elbow", "wrist", "hand"), ("hip", "knee", "ankle", "foot"))
]


@pytest.mark.parametrize("limb", LIMBS, ids=lambda limb: JOINTS[limb[1]])
@pytest.mark.parametrize("bone", [0, 1])
def test_of_a_bone_without_length_neither_end_is_believed_nor_what_lies_beyond(limb, bone):
    """Wherever on it the two ends are: a hand seen in front of an elbow looks the same."""
    for end in (limb[bone], limb[bone + 1]):
        bodies = np.stack([BODY, BODY])
        bodies[1, limb[bone : bone + 2]] = BODY[end] + [[0.0, 0.0, 0.0], [0.02, -0.02, 0.02]]
        found = collapsed(bodies, np.stack([ALL, ALL]))
        assert not found[0].any()
        assert np.flatnonzero(found[1]).tolist() == limb[bone:]
        unseen = ALL.copy()
        unseen[limb[bone]] = False
        assert not collapsed(bodies[1:], unseen[None]).any()


@pytest.mark.parametrize("name", sorted({*map_names()} - {"bvh"}))
def test_no_joint_map_puts_both_ends_of_a_bone_in_one_place(name):
    """A true body, read from what such a tracker would send, has bones."""
    weights = load_joint_map(name).weights
    for limb in LIMBS:
        for start, end in itertools.pairwise(limb[:3]):
            mapped = weights[start].any() and weights[end].any()
            assert not mapped or (weights[start] != weights[end]).any()


def test_a_collapsed_arm_is_taken_as_one_that_is_not_seen(make_room):
    body = BODY.copy()
    body[ARM] = body[JOINTS.index("l_shoulder")]
    snapshot = make_room().see(Person(1, body, ALL), times=2)
    limb = LIMBS[0]
    assert np.flatnonzero(~snapshot.measured[0, -1]).tolist() == limb
    assert snapshot.counters["unseen_joints"] == 2 * len(limb)
    only = np.isin(np.arange(len(JOINTS)), limb)  # nothing is left, but a person is there
    snapshot = make_room().see(Person(1, body, only), times=2)
    assert snapshot.ids == ()
    assert snapshot.reasons


def test_a_body_with_wrong_names_is_believed_and_counted(make_room):
    """Nobody knows which of its joints is right, but somebody is there."""
    shuffled = BODY[np.random.default_rng(0).permutation(len(JOINTS))]
    snapshot = make_room().see(Person(1, shuffled, ALL), times=30)
    assert snapshot.ids == (1,)
    assert snapshot.counters["misnamed_bodies"] == 30
    assert snapshot.counters["unseen_joints"] == 0
    snapshot = make_room().see(Person(1, BODY, ALL), times=30)
    assert snapshot.counters["misnamed_bodies"] == 0


def test_a_lost_joint_counts_from_the_first_capture_on(make_room):
    """As a joint that was not sent, wherever the sensor stands."""
    body = BODY.copy()
    body[ARM[1:]] = 0.0  # make_room's source is at the room's origin
    snapshot = make_room().see(Person(1, body, ALL), times=2)
    assert np.flatnonzero(~snapshot.measured[0, -1]).tolist() == ARM[1:]
    assert snapshot.counters["unseen_joints"] == 4
    body[ARM[1:]] = 0.01
    snapshot = make_room().see(Person(1, body, ALL), times=2)
    assert np.flatnonzero(~snapshot.measured[0, -1]).tolist() == ARM[1:]
