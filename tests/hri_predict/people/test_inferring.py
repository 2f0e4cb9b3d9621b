"""Inferred joints reach the predictor and the zones, and count nowhere as measured."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person
from hri_predict.people.body.body_model import body_model
from hri_predict.people.body.inferred import Inference
from hri_predict.people.inferring import HIDDEN_ARM, hidden_arms
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
    np.testing.assert_array_equal(inferred.joints[0], ~COCO.mapped)
    np.testing.assert_array_equal(snapshot.shown[0], COCO.mapped)
    np.testing.assert_array_equal(snapshot.fresh[0], COCO.mapped)
    assert snapshot.observed[0, -1].all()
    np.testing.assert_array_equal(snapshot.measured[0, -1], COCO.mapped)
    assert (snapshot.joint_age_s[0] == 0).all()
    assert (inferred.within_m[inferred.joints] > 0.01).all()
    assert (inferred.within_m[~inferred.joints] == 0).all()
    # the inferred hand hangs below the wrist
    assert snapshot.last_positions[0, HAND, 2] < snapshot.last_positions[0, WRIST, 2]


def test_where_all_joints_are_seen_none_is_inferred(make_room):
    snapshot = make_room().see(Person(1, BODY, np.ones(len(JOINTS), bool)), times=12)
    assert snapshot.inferred is None
    assert snapshot.shown.all()
    assert snapshot.fresh.all()
    assert snapshot.measured is snapshot.observed


def test_a_hidden_anchor_leaves_what_rests_on_it_to_the_posture(make_room):
    room = make_room(joint_map="coco17")
    before = room.see(sent(), times=10)
    after = room.see(sent(BODY + 0.01, hidden=("left_wrist",)), times=2)
    for joint in (HAND, WRIST):
        assert after.inferred.joints[0, joint]
        assert after.joint_age_s[0, joint] == 0
        assert not after.fresh[0, joint]
        # of the posture less is known than of the elbow and the wrist
        assert after.inferred.within_m[0, joint] > before.inferred.within_m[0, joint]


def test_what_was_never_seen_is_inferred_from_the_posture(make_room):
    hidden = ("left_wrist", "left_ear")
    snapshot = make_room(joint_map="coco17").see(sent(hidden=hidden), times=5)
    for joint in (HAND, WRIST, JOINTS.index("head_top")):
        assert snapshot.observed[0, :, joint].any()
        assert not snapshot.measured[0, :, joint].any()
        assert not snapshot.shown[0, joint]
        off = np.linalg.norm(snapshot.last_positions[0, joint] - BODY[joint])
        assert off <= snapshot.inferred.within_m[0, joint]


def test_of_a_hand_over_a_wall_nothing_is_inferred_and_the_rest_ages(make_room):
    room = make_room(joint_map="coco17")
    room.see(sent(), times=10)
    but_one_arm = [n for n in COCO.source_joints if n not in ("left_elbow", "left_wrist")]
    after = room.see(sent(hidden=but_one_arm), times=5)
    knee = JOINTS.index("r_knee")
    assert not after.inferred.joints[0, knee]
    assert not after.observed[0, -1, knee]
    assert after.joint_age_s[0, knee] == pytest.approx(0.2)
    assert after.inferred.within_m[0, knee] == 0
    np.testing.assert_allclose(after.last_positions[0, knee], BODY[knee])
    assert after.inferred.joints[0, HAND]  # on the forearm that is seen


def raised(step):
    """A body with a hand that is held up, where few postures have it, and that walks slowly."""
    body = BODY.copy()
    for part, up in (("elbow", 0.3), ("wrist", 0.6), ("hand", 0.7)):
        body[JOINTS.index(f"l_{part}")] = body[JOINTS.index("l_shoulder")] + [0.1, 0.1, up]
    body[:, 0] += 0.02 * step
    return body


def person(body, *hidden):
    return Person(1, body, ~np.isin(JOINTS, hidden))


LIMB = ("l_elbow", "l_wrist", "l_hand")


def largest_jump(snapshot, joint=HAND):
    """Metres that a joint moves beyond its body in one step, of the steps in which it is there."""
    path = snapshot.history[0, :, joint] - snapshot.history[0, :, JOINTS.index("neck")]
    there = snapshot.observed[0, :, joint]
    return max(
        (np.linalg.norm(b - a) for a, b in zip(path[there], path[there][1:], strict=False)),
        default=0.0,
    )


def test_a_hand_that_is_hidden_from_now_on_leaves_its_place_slowly(make_room):
    room, hidden = make_room(), []
    for step in range(12):
        room.see(person(raised(step)))
    for step in range(12, 40):
        after = room.see(person(raised(step), *LIMB))
        assert after.inferred.joints[0, HAND]
        # a twelfth of what it is off, at most: a step of 40 ms of a time constant of 0.5 s
        assert largest_jump(after) < 0.12
        hidden.append(after.last_positions[0, HAND] - after.last_positions[0, JOINTS.index("neck")])
    there = raised(0)[HAND] - raised(0)[JOINTS.index("neck")]
    assert np.linalg.norm(hidden[0] - there) < 0.12
    # after two time constants it is where the posture has it
    fresh = make_room().see(person(raised(0), *LIMB), times=12)
    usual = fresh.last_positions[0, HAND] - fresh.last_positions[0, JOINTS.index("neck")]
    assert np.linalg.norm(usual - there) > 0.5
    assert np.linalg.norm(hidden[-1] - usual) < 0.4 * np.linalg.norm(hidden[0] - usual)


ARM = [JOINTS.index(name) for name in LIMB]


def test_an_arm_that_is_hidden_for_a_capture_is_still_near(make_room):
    """A tracker that loses an arm for a moment does not make a zone of an arm's length."""
    room, within = make_room(), []
    for step in range(20):
        room.see(person(raised(step)))
    for step in range(20, 44):
        after = room.see(person(raised(step), *LIMB))
        off = np.linalg.norm(after.last_positions[0] - raised(step), axis=1)
        within.append(after.inferred.within_m[0, ARM])
        if step < 26:  # later it is where the posture has it, which a raised arm is not
            assert (off[ARM] <= within[-1] + 1e-9).all()
    by_posture = make_room().see(person(raised(0), *LIMB), times=12).inferred.within_m
    assert (within[0] < 0.15).all()
    assert (within[0] < by_posture[0, ARM] / 3).all()
    assert (np.diff(within[:4], axis=0) > 0.02).all()  # it may have moved on
    assert (within[-1] > 0.3).all()


def test_an_arm_that_is_hidden_in_fast_motion_may_be_farther_away(make_room):
    within = []
    for speed_m_s in (0.0, 1.5):
        room = make_room()
        for step in range(12):
            body = raised(0)
            body[ARM, 0] += 0.04 * speed_m_s * step
            room.see(person(body))
        after = room.see(person(body, *LIMB), times=4)
        within.append(after.inferred.within_m[0, HAND])
    assert within[1] > within[0] + 4 * 0.04 * 1.0


def test_an_inferred_hand_stays_on_an_arm_that_is_hidden_for_a_moment(make_room):
    """COCO has no hands: they follow the forearm, and when that is hidden, the last one seen."""
    room = make_room(joint_map="coco17")
    for step in range(12):
        before = room.see(sent(raised(step)))
    after = room.see(sent(raised(12), hidden=("left_elbow", "left_wrist")))
    moved = after.last_positions[0, HAND] - before.last_positions[0, HAND]
    assert np.linalg.norm(moved) < 0.1
    assert after.inferred.within_m[0, HAND] < before.inferred.within_m[0, HAND] + 0.2


def test_an_arm_of_which_little_was_seen_may_be_anywhere(make_room):
    room = make_room()
    for step in range(20):  # seen in three captures, four apart
        room.see(person(raised(0), *(() if step % 4 == 3 and step > 8 else LIMB)))
    after = room.see(person(raised(0), *LIMB))
    never = make_room().see(person(raised(0), *LIMB), times=12).inferred.within_m
    assert (after.inferred.within_m >= never / HIDDEN_ARM - 1e-6)[0, ARM].all()


def test_an_arm_that_stays_hidden_may_be_farther_from_its_place(make_room):
    """It may be hidden because it reaches into something."""
    room = make_room()
    for step in range(12):
        room.see(person(raised(step)))
    joints = [JOINTS.index(name) for name in LIMB]
    for step in range(12, 10 + room.steps):
        moment = room.see(person(raised(step), *LIMB))
    stays = room.see(person(raised(step), *LIMB), times=40)
    never = make_room().see(person(raised(step), *LIMB), times=12)
    for snapshot in (moment, stays, never):
        assert snapshot.inferred.joints[0, joints].all()
    plain = Inference(body_model()).fill(stays.history[0, -1], stays.measured[0, -1]).within_m
    np.testing.assert_allclose(stays.inferred.within_m[0, joints], 1.5 * plain[joints], rtol=0.02)
    np.testing.assert_allclose(never.inferred.within_m[0, joints], 1.5 * plain[joints], rtol=0.02)
    knee = make_room().see(person(raised(step), "l_knee"), times=12).inferred.within_m
    assert knee[0, JOINTS.index("l_knee")] < plain[joints].min()


def test_one_capture_of_an_arm_does_not_make_it_a_seen_one(make_room):
    """It is as often the other arm, or a part of the machine that the arm is in."""
    joints, room = [JOINTS.index(name) for name in LIMB], make_room()
    before = room.see(person(raised(0), *LIMB), times=30).inferred.within_m[0, joints]
    room.see(person(raised(0)))
    for _ in range(12):
        after = room.see(person(raised(0), *LIMB)).inferred.within_m[0, joints]
        assert (after >= before - 1e-6).all()


def test_a_lost_person_s_hidden_arm_is_as_uncertain_as_it_was(make_room):
    joints, room = [JOINTS.index(name) for name in LIMB], make_room()
    before = room.see(person(raised(0), *LIMB), times=30).inferred.within_m[0, joints]
    (lost,) = room.see(times=30).lost
    np.testing.assert_allclose(lost.inferred_m[joints], before, rtol=0.02)


@pytest.mark.parametrize("every", [2, 3, 5])
@pytest.mark.parametrize("is_seen_last", [True, False])
def test_a_hand_that_flickers_does_not_jump(make_room, every, is_seen_last):
    room = make_room()
    for step in range(24 if is_seen_last else 25):
        sees = (step + 1) % every == (0 if is_seen_last else 1) % every
        snapshot = room.see(person(raised(step), *(() if sees else LIMB)))
    assert largest_jump(snapshot) < 0.12


def test_a_hand_that_was_hidden_for_long_did_not_jump_when_it_is_seen_again(make_room):
    """A gap that is too long to be interpolated: 0.3 s within the history."""
    room = make_room()
    for step in range(12):
        sees = not 3 <= step < 10
        snapshot = room.see(person(raised(step), *(() if sees else LIMB)))
        assert largest_jump(snapshot) < 0.15


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


@pytest.mark.parametrize("seen_before", [True, False])
def test_one_wrong_capture_of_a_hidden_arm_does_not_take_the_zone_away(make_room, seen_before):
    """The arm of a person who stands upright, seen once where it is not."""
    upright = BODY.copy()
    room = make_room()
    for _ in range(11):
        room.see(person(upright, *(() if seen_before else LIMB)))
    room.see(person(raised(0)))
    for _ in range(8):
        after = room.see(person(upright, *LIMB))
        off = np.linalg.norm(after.last_positions[0, HAND] - upright[HAND])
        assert off <= after.inferred.within_m[0, HAND]


@pytest.mark.parametrize(
    ("elbow", "wrist", "hidden"),
    [
        ([], [], [True, True, True]),
        ([17], [], [True, True, True]),  # may be the other arm, or a part of the bench
        ([3, 17], [], [False, True, True]),  # glimpses of an elbow do not show the hand
        ([3, 17], [3, 17], [False, False, False]),
        ([3, 24], [], [False, False, False]),  # it is seen now
        (range(15), [], [False, False, False]),
    ],
)
def test_wrist_and_hand_are_hidden_while_only_glimpses_of_the_elbow_are_seen(elbow, wrist, hidden):
    arm = [JOINTS.index(f"r_{joint}") for joint in ("elbow", "wrist", "hand")]
    measured = np.ones((1, 25, len(JOINTS)), bool)
    measured[:, :, arm] = False
    measured[:, list(elbow), arm[0]] = True
    measured[:, list(wrist), arm[1]] = True
    found = hidden_arms(measured)
    assert found[0, arm].tolist() == hidden
    assert found.sum() == sum(hidden)  # the other arm is seen
