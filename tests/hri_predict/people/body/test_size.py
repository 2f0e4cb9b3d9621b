"""A tracker in wrong units must not put people where they are not."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.size import MIDDLE_M, STRAY, are_human_sized, most_are_not_human_sized
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body

J = len(JOINTS)
ALL = np.ones(J, bool)
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))


def only(*names):
    return np.isin(JOINTS, names)


def is_human_sized(body, observed):
    return bool(are_human_sized(body[None], observed[None])[0])


@pytest.mark.parametrize("scale", [1000.0, 100.0, 39.37, 10.0, 1 / 39.37, 0.01, 0.001])
def test_a_body_in_wrong_units_is_refused_wherever_it_seems_to_be(make_room, scale):
    room = make_room()
    for step in range(30):  # it sways, no faster than a body can
        wrong = (BODY + 1e-5 * step) * scale
        snapshot = room.see(Person(1, wrong, ALL))
    assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    assert snapshot.captures == 0
    assert snapshot.ids == ()
    assert snapshot.counters["wrong_size_bodies"] == 30


def test_it_is_believed_again_once_the_units_are_right(make_room):
    room = make_room()
    room.see(Person(1, BODY * 1000.0, ALL), times=3)
    assert room.see(Person(1, BODY, ALL)).reasons == ()


@pytest.mark.parametrize("size", [0.4, 1.0, 1.2])
def test_children_and_giants_are_believed_arms_raised_too(size):
    raised = BODY.copy()
    for side in "lr":
        shoulder = BODY[JOINTS.index(f"{side}_shoulder")]
        for joint, up in (("elbow", 0.35), ("wrist", 0.65), ("hand", 0.85)):
            raised[JOINTS.index(f"{side}_{joint}")] = shoulder + np.array([0.0, 0.0, up])
    for body in (BODY, raised):
        assert is_human_sized(body * size + 500.0, ALL)


def test_what_tells_no_size_is_believed():
    one, hands = only("l_wrist"), only("l_wrist", "r_wrist")
    assert is_human_sized(BODY * 1000.0, one)
    assert is_human_sized(BODY, hands)
    assert not is_human_sized(BODY * 1000.0, hands)
    assert is_human_sized(np.zeros((J, 3)), hands)
    assert not is_human_sized(np.zeros((J, 3)), only("l_wrist", "l_elbow"))


def test_a_joint_that_flies_off_spoils_no_body():
    astray = BODY.copy()
    astray[8] += 900.0
    assert is_human_sized(astray, ALL)


@pytest.mark.parametrize("size", [0.3, 1.0, 1.15, 1.3, 2.0])
def test_as_many_joints_may_stray_from_the_median_as_documented(size):
    rng = np.random.default_rng(round(100 * size))
    for _ in range(200):
        joints = BODY * size + rng.normal(0.0, 0.3 * size, BODY.shape)
        joints[rng.random(J) < 0.2] += rng.normal(0.0, 1.5, 3)
        seen = rng.random(J) < 0.8
        far = np.linalg.norm(joints[seen] - np.median(joints[seen], axis=0), axis=1) > MIDDLE_M
        strays = np.count_nonzero(far) > STRAY * np.count_nonzero(seen)
        # bones are far longer than LONG_BONE_M
        assert is_human_sized(joints, seen) is not strays


def test_each_body_is_judged_alone():
    rng = np.random.default_rng(0)
    bodies = [BODY * size for size in (0.001, 0.3, 1.0, 2.0, 1000.0) for _ in range(8)]
    seen = [rng.random(J) < share for share in np.linspace(0.0, 1.0, len(bodies))]
    together = are_human_sized(np.array(bodies), np.array(seen))
    assert together.tolist() == [is_human_sized(*body) for body in zip(bodies, seen, strict=True)]


def test_most_bodies_decide():
    right, wrong = (BODY, ALL), (BODY * 1000.0, ALL)
    assert most_are_not_human_sized([right, wrong, wrong])
    assert not most_are_not_human_sized([right, wrong])
    assert not most_are_not_human_sized([])
