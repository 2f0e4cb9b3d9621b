"""Inferred joints reach the predictor and the zones, and count nowhere as measured."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person
from hri_predict.people.body.inferred import Inference
from hri_sim.people.body import Body

COCO = load_joint_map("coco17")
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([0.8, 0.3]), 0.0))
HAND, WRIST, FOOT = (JOINTS.index(name) for name in ("l_hand", "l_wrist", "l_foot"))


def sent(body=BODY, hidden=()):
    """A COCO tracker's person: the joints that it has, where the body's are."""
    names = COCO.source_joints
    positions = np.zeros((len(names), 3))
    for joint, weights in enumerate(COCO.weights):
        positions[weights > 0] = body[joint]
    for side in ("left", "right"):  # midpoints were written over their ends
        for part in ("shoulder", "hip"):
            at = JOINTS.index(f"{side[0]}_{part}")
            positions[names.index(f"{side}_{part}")] = body[at]
    return Person(1, positions, np.array([name not in hidden for name in names]))


def test_inferred_joints_are_in_the_history_but_not_measured(make_room):
    snapshot = make_room(joint_map="coco17").see(sent(), times=10)
    inferred = snapshot.inferred
    np.testing.assert_array_equal(inferred.joints, Inference(COCO.mapped).joints)
    assert snapshot.observed[0, -1].all()
    np.testing.assert_array_equal(snapshot.measured[0, -1], COCO.mapped)
    assert (snapshot.joint_age_s[0] == 0).all()
    assert (inferred.within_m[0, inferred.joints] > 0.01).all()
    assert (inferred.within_m[0, ~inferred.joints] == 0).all()
    # the inferred hand hangs below the wrist
    assert snapshot.last_positions[0, HAND, 2] < snapshot.last_positions[0, WRIST, 2]


def test_a_source_with_all_joints_has_none_inferred(make_room):
    snapshot = make_room().see(Person(1, BODY, np.ones(len(JOINTS), bool)), times=3)
    assert snapshot.inferred is None
    assert snapshot.delivered.all()
    assert snapshot.measured is snapshot.observed


def test_a_hidden_anchor_hides_what_rests_on_it_and_the_age_goes_on(make_room):
    room = make_room(joint_map="coco17")
    before = room.see(sent(), times=10)
    after = room.see(sent(BODY + 0.01, hidden=("left_wrist",)), times=2)
    assert not after.observed[0, -1, HAND]
    assert after.observed[0, -1, FOOT]
    assert after.joint_age_s[0, HAND] == pytest.approx(after.joint_age_s[0, WRIST])
    assert after.joint_age_s[0, HAND] > 0
    np.testing.assert_allclose(after.last_positions[0, HAND], before.last_positions[0, HAND])
    np.testing.assert_allclose(after.history[0, -1, HAND], before.last_positions[0, HAND])
    assert after.inferred.within_m[0, HAND] == pytest.approx(before.inferred.within_m[0, HAND])


def test_what_was_never_seen_stays_unobserved(make_room):
    hidden = ("left_wrist", "left_ear")
    snapshot = make_room(joint_map="coco17").see(sent(hidden=hidden), times=5)
    for joint in (HAND, JOINTS.index("head_top")):
        assert not snapshot.observed[0, :, joint].any()
        assert snapshot.joint_age_s[0, joint] == np.inf
        assert np.isnan(snapshot.last_positions[0, joint]).all()


def test_lost_people_have_inferred_joints_too(make_room):
    room = make_room(joint_map="coco17")
    here = room.see(sent(), times=10)
    (lost,) = room.see(times=20).lost
    assert np.isfinite(lost.positions).all()
    np.testing.assert_allclose(lost.positions[HAND], here.last_positions[0, HAND])
    assert lost.inferred_m[HAND] == pytest.approx(here.inferred.within_m[0, HAND])
    assert (lost.joint_age_s == 0).all()


def test_a_lost_person_s_inferred_joint_is_not_slower_than_what_it_rests_on(make_room):
    room = make_room(joint_map="coco17")
    for step in range(15):
        body = BODY.copy()
        body[WRIST] += [0.025 * step, 0, 0]  # a forearm cannot be much longer
        room.see(sent(body))
    (lost,) = room.see(times=20).lost
    assert lost.limbs_m_s[WRIST] > 0.5
    assert lost.limbs_m_s[HAND] >= lost.limbs_m_s[WRIST]


def test_identity_and_size_rest_on_delivered_joints(make_room):
    """A body of one forearm: with the inferred hand it would be longer, and no other."""
    room = make_room(joint_map="coco17")
    only_arm = [n for n in COCO.source_joints if n not in ("left_elbow", "left_wrist")]
    room.see(sent(hidden=only_arm), times=5)
    (track,) = room.people._tracks.values()
    seen = np.isfinite(track.positions).all(-1)
    np.testing.assert_array_equal(seen, np.isin(JOINTS, ("l_elbow", "l_wrist")))
