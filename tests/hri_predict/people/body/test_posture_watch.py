"""Bodies that cannot be right are refused over time; bodies as people are never."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_predict.people.body.posture_watch import PostureWatch, Verdict
from hri_predict.people.settings import PeopleSettings
from hri_predict.people.track import Body as Seen
from hri_predict.protocol.reasons import Reason
from hri_sim.people.body import Body

J = len(JOINTS)
ALL = np.ones(J, bool)
COCO = ~np.isin(JOINTS, ("torso", "head_top", "l_hand", "r_hand", "l_foot", "r_foot"))
UPPER = np.array([n[2:] not in ("knee", "ankle", "foot", "hip") for n in JOINTS])
_WHO = Body(1.75)
BODY = _WHO.joints(_WHO.standing(np.array([2.0, 0.3]), 0.4))
TURNS = []
for order in itertools.permutations(range(3)):
    for signs in itertools.product((1.0, -1.0), repeat=3):
        turn = np.zeros((3, 3))
        turn[range(3), order] = signs
        if np.linalg.det(turn) > 0:
            TURNS.append(turn)
TILTS = [turn for turn in TURNS if turn[2, 2] < 0.5]
LYING = (BODY - BODY[0]) @ np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]).T + [2.0, 0.3, 0.2]


def moved(body, *shift):
    return body + np.array(shift)


class Watched:
    """A watch at 30 Hz."""

    def __init__(self, field_of_view=None, **people):
        self.watch = PostureWatch(PeopleSettings(**people), field_of_view)
        self.now = 10**9

    def see(self, positions, seconds=1.0, observed=ALL, person=1, noise=0.0):
        """The verdict after so many seconds of this body."""
        rng, verdict = np.random.default_rng(1), None
        for _ in range(round(seconds * 30)):
            self.now += 33_333_333
            shaken = positions + rng.normal(0.0, noise, positions.shape) if noise else positions
            verdict = self.watch.judge(Seen(person, shaken, observed), self.now)
        return verdict


@pytest.mark.parametrize("observed", [ALL, COCO], ids=["all joints", "coco"])
@pytest.mark.parametrize("turn", TILTS, ids=lambda t: str(t.astype(int).tolist()))
def test_each_wrong_rotation_of_a_standing_body_is_found_within_a_second(turn, observed):
    camera = np.array([0.0, 0.0, 1.5])
    watched = Watched()
    verdict = watched.see((BODY - camera) @ turn.T + camera, 1.0, observed, noise=0.03)
    assert verdict in (Verdict.TILTED, Verdict.UPSIDE_DOWN)
    assert not watched.watch.upright_seen


def test_until_somebody_stood_upright_a_turned_body_is_refused_at_once():
    assert Watched().see(moved(LYING, 0, 0, 0.9), 0.04) is Verdict.TILTED


@pytest.mark.parametrize("observed", [ALL, COCO], ids=["all joints", "coco"])
def test_a_mirrored_body_is_found_within_a_second(observed):
    mirrored = BODY * [1.0, -1.0, 1.0]
    assert Watched().see(mirrored, 1.0, observed, noise=0.03) is Verdict.MIRRORED


@settings(max_examples=20)
@given(yaw=st.floats(-4, 4), place=st.tuples(st.floats(-9, 9), st.floats(-9, 9)))
def test_who_stands_is_never_refused(yaw, place):
    body = _WHO.joints(_WHO.standing(np.array(place), yaw))
    watched = Watched()
    assert watched.see(body, 1.0, noise=0.03) is None
    assert watched.watch.upright_seen


def test_who_has_fallen_is_believed_on_the_floor_and_not_in_the_air():
    watched = Watched()
    assert watched.see(BODY, 1.5) is None
    assert watched.see(LYING, 5.0) is None
    assert watched.see(moved(LYING, 0, 0, 1.0), 2.0) is Verdict.TILTED


def test_who_lies_before_anybody_stood_is_refused_until_somebody_stands():
    watched = Watched()
    assert watched.see(LYING, 0.5) is Verdict.TILTED
    assert watched.see(moved(BODY, 2, 0, 0), 1.5, person=2) is None
    assert watched.see(LYING, 1.5) is None


def test_who_glides_over_the_floor_lying_does_not_lie():
    watched = Watched()
    watched.see(BODY, 1.5)
    for step in range(90):
        verdict = watched.see(moved(LYING, 1.2 * step / 30, 0, 0), 0.04)
    assert verdict is Verdict.TILTED


def test_a_cartwheel_of_a_second_is_no_reason():
    watched = Watched()
    watched.see(BODY, 1.5)
    for step in range(30):
        angle = 2 * np.pi * step / 30
        c, s = np.cos(angle), np.sin(angle)
        turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
        assert watched.see((BODY - BODY[0]) @ turn.T + BODY[0], 0.04) is None


@pytest.mark.parametrize(
    ("shift", "refused"), [(-0.5, True), (-0.2, False), (0.9, False), (2, True)]
)
def test_feet_are_on_the_floor_or_on_a_platform(shift, refused):
    verdict = Watched().see(moved(BODY, 0, 0, shift), 1.5)
    assert verdict is (Verdict.OFF_FLOOR if refused else None)


def test_the_floor_is_where_the_configuration_says():
    assert Watched(floor_m=-0.8).see(BODY - [0, 0, 0.8], 1.5) is None
    assert Watched(platform_m=3.0).see(moved(BODY, 0, 0, 2.5), 1.5) is None


VIEW = Region(polygon=[[1, -2], [5, -2], [5, 2], [1, 2]])


def test_who_is_only_seen_outside_the_field_of_view_is_refused():
    watched = Watched(VIEW)
    assert watched.see(BODY * [-1.0, -1.0, 1.0], 1.5) is Verdict.OUT_OF_VIEW
    assert watched.see(BODY, 2.5) is None
    assert watched.see(BODY * [-1.0, -1.0, 1.0], 2.5) is None  # the heading was right


HEAD_AND_ARMS = UPPER & ~np.isin(JOINTS, ("waist", "torso"))
ARMS = HEAD_AND_ARMS & ~np.isin(JOINTS, ("neck", "head", "head_top"))


@pytest.mark.parametrize("seen", [UPPER, HEAD_AND_ARMS], ids=["trunk", "head and arms"])
def test_an_upper_body_needs_more_evidence(seen):
    watched = Watched()
    assert watched.see(moved(LYING, 0, 0, 1), 1.5, seen) is None
    assert watched.see(moved(LYING, 0, 0, 1), 1.5, seen) is Verdict.TILTED
    assert watched.watch.unjudged == 0


def test_arms_alone_are_judged_by_their_heights_only():
    watched = Watched()
    assert watched.see(moved(LYING, 0, 0, 1), 3.0, ARMS) is None
    assert watched.watch.unjudged == 90
    assert Watched().see(moved(LYING, 0, 0, 4), 0.04, ARMS) is Verdict.OFF_FLOOR
    assert Watched().see(moved(LYING, 0, 0, -1), 0.04, ARMS) is Verdict.OFF_FLOOR


@pytest.mark.parametrize("seen", [HEAD_AND_ARMS, ARMS], ids=["head and arms", "arms"])
@pytest.mark.parametrize(
    ("shift", "refused"), [(-1.5, True), (0.0, False), (1.0, False), (4, True)]
)
def test_no_joint_is_below_the_floor_or_above_a_tall_person_on_a_platform(seen, shift, refused):
    verdict = Watched().see(moved(BODY, 0, 0, shift), 1.0, seen, noise=0.03)
    assert verdict is (Verdict.OFF_FLOOR if refused else None)


def test_a_hand_raised_on_the_highest_platform_is_believed():
    raised = moved(BODY, 0, 0, 1.0)
    for joint, up in (("r_elbow", 0.3), ("r_wrist", 0.6), ("r_hand", 0.8)):
        raised[JOINTS.index(joint)] = raised[JOINTS.index("r_shoulder")] + [0, 0, up]
    for seen in (ALL, HEAD_AND_ARMS, ARMS):
        assert Watched().see(raised, 5.0, seen) is None


def test_who_looks_down_at_the_work_for_some_seconds_is_believed():
    head = np.isin(JOINTS, ("neck", "head", "l_shoulder", "r_shoulder"))
    bent = BODY.copy()
    bent[JOINTS.index("head")] = bent[JOINTS.index("neck")] + [0.2, 0.0, 0.0]
    watched = Watched()
    assert watched.see(bent, 3.5, head) is None
    assert watched.see(bent, 1.0, head) is Verdict.TILTED


def test_a_refused_body_of_which_only_arms_remain_stays_refused():
    watched = Watched()
    assert watched.see(moved(LYING, 0, 0, 1), 0.5) is Verdict.TILTED
    assert watched.see(moved(LYING, 0, 0, 1), 3.0, ARMS) is Verdict.TILTED


def test_a_new_id_at_the_same_place_takes_the_verdict_over():
    watched = Watched()
    watched.see(BODY, 1.5)
    for number in range(20, 50):  # a tracker that names everybody anew
        verdict = watched.see(BODY * [1, -1, 1], 0.04, person=number)
    assert verdict is Verdict.MIRRORED


@pytest.mark.parametrize(("absent_s", "is_new"), [(2, False), (6, True), (3600, True)])
def test_an_id_that_was_away_for_long_is_judged_anew(absent_s, is_new):
    watched = Watched()
    watched.see(BODY, 1.5)
    assert watched.see(BODY * [1, -1, 1], 1.5) is Verdict.MIRRORED
    watched.now += absent_s * 10**9
    verdict = watched.see(moved(BODY, 3, 0, 0), 0.04)
    assert verdict is (None if is_new else Verdict.MIRRORED)
    verdict = watched.see(moved(BODY * [1, -1, 1], 3, 0, 0), 1.5)
    assert verdict is Verdict.MIRRORED


def test_it_is_believed_again_after_a_second():
    watched = Watched()
    assert watched.see(BODY * [1, -1, 1], 1.5) is Verdict.MIRRORED
    assert watched.see(BODY, 0.5) is Verdict.MIRRORED
    assert watched.see(BODY, 2.0) is None


def test_the_check_can_be_left_out_with_a_reason():
    assert Watched(posture_unchecked="acrobats train here").see(moved(LYING, 0, 0, 1), 2.0) is None


def test_in_a_scene_it_is_a_reason_and_a_counter_and_the_person_stays_there(make_room):
    room = make_room(posture_unchecked=None)
    snapshot = room.see(Person(1, moved(LYING, 0, 0, 1), ALL), times=5)
    assert snapshot.reasons[0] is Reason.BODY_NOT_UPRIGHT
    assert snapshot.ids == (1,)
    assert snapshot.captures == 0
    assert snapshot.counters["lying_bodies"] == 5
    room = make_room(posture_unchecked=None)
    assert room.see(Person(1, BODY, ALL), times=50).reasons == ()
