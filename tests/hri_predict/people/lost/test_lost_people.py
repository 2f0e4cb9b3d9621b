import json

import numpy as np
import pytest

from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.people.lost.lost_people import match_places
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import ALL, DOOR, SHAPE, J, body, lost_at

MS = 1_000_000
RATE = 25.0
PERIOD = 40 * MS
LONG_SCENES = 75  # 3 s
T = 10


def lost_ids(snapshot):
    return [person.id for person in snapshot.lost]


def test_a_dropout_shorter_than_the_gap_changes_nothing_but_the_age(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    for missing in (1, 2):
        snapshot = room.see()
        assert snapshot.ids == (1,)
        assert snapshot.lost == ()
        assert snapshot.reasons == ()
        assert snapshot.now_ns - snapshot.capture_ns[0] == missing * PERIOD
    snapshot = room.see(body(1, 0.1))
    assert snapshot.ids == (1,)
    assert snapshot.counters.get("vanished", 0) == 0


def test_who_vanishes_becomes_a_lost_person_where_last_seen(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), times=10)
    seen = room.now
    snapshot = room.see(body(2, 3.0), times=3)
    assert snapshot.ids == (2,)
    assert lost_ids(snapshot) == [1]
    assert snapshot.lost[0].positions == pytest.approx(SHAPE)
    assert snapshot.lost[0].last_seen_ns == seen
    assert snapshot.reasons == ()  # the growing zone is for the risk stage


@pytest.mark.parametrize(
    ("number", "absent", "x"),
    [
        (1, 4, 8.0),  # the same id, too far away
        (7, 10, 2.0),  # 0.44 s: the zone has grown by 0.7 m
        (7, 13, 0.0),  # 0.56 s: too long ago
    ],
)
def test_who_cannot_be_the_lost_person_inherits_nothing(make_room, number, absent, x):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=absent)
    snapshot = room.see(body(number, x))
    assert snapshot.ids == (number,)
    assert lost_ids(snapshot) == ([-2] if number == 1 else [1])
    assert snapshot.lost[0].positions == pytest.approx(SHAPE)
    assert snapshot.observed[0].all(axis=1).tolist() == [False] * 9 + [True]


def test_a_new_id_inside_the_grown_zone_inherits_place_and_history(make_room):
    room = make_room(latency=0)
    for i in range(10):
        room.see(body(1, 0.02 * i))
    room.see(times=4)
    snapshot = room.see(body(7, 0.3))  # at 0.5 m/s, 0.28
    assert snapshot.ids == (7,)
    assert snapshot.lost == ()
    assert snapshot.reasons == ()
    assert snapshot.counters["inherited"] == 1
    # the last step is the new capture, the four before are not bridged, the older are the old ones
    assert snapshot.observed[0].all(axis=1).tolist() == [True] * 5 + [False] * 4 + [True]
    assert snapshot.history[0, 4] == pytest.approx(SHAPE + np.array([0.18, 0.0, 0.0]))
    assert snapshot.history[0, 9] == pytest.approx(SHAPE + np.array([0.3, 0.0, 0.0]))


def test_a_new_id_during_a_dropout_inherits_at_once(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    snapshot = room.see(body(2, 0.05))
    assert snapshot.ids == (2,)
    assert snapshot.observed.all()
    assert room.see(body(2, 0.05), times=5).lost == ()


def test_a_source_that_renumbers_every_scene_keeps_one_history(make_room):
    room = make_room(latency=0)
    for i in range(40):
        snapshot = room.see(body(i, 0.02 * i), body(1000 + i, 4.0))
    assert snapshot.ids == (39, 1039)
    assert snapshot.observed.all()
    assert snapshot.lost == ()


def test_one_body_accounts_for_one_lost_person_only(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 1.0), times=10)
    room.see(times=5)
    snapshot = room.see(body(7, 0.9))
    assert snapshot.ids == (7,)
    assert lost_ids(snapshot) == [1]


def test_a_source_that_falls_silent_does_not_make_people_vanish(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    snapshot = room.people.snapshot(room.now + 60_000 * MS)
    assert snapshot.ids == (1,)
    assert snapshot.reasons == (Reason.INPUT_STALE,)
    room.now += 60_000 * MS
    snapshot = room.see()  # and when it comes back, whoever is missing vanished long ago
    assert snapshot.ids == ()
    assert lost_ids(snapshot) == [1]


def test_a_person_who_vanishes_where_it_had_jumped_to_is_lost_at_both_places(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(body(1, 5.0), times=3)
    snapshot = room.see(times=3)
    assert snapshot.ids == ()
    places = sorted(float(person.positions[:, 0].mean()) for person in snapshot.lost)
    assert places == pytest.approx(
        [float(SHAPE[:, 0].mean()), 5.0 + float(SHAPE[:, 0].mean())], abs=1e-9
    )


@pytest.mark.parametrize("others", [(), (2,)])
def test_scenes_without_a_lost_person_never_end_it(make_room, others):
    """A tracker that returns no skeleton has not seen an empty place."""
    room = make_room(latency=0)
    here = [body(number, 30.0) for number in others]
    room.see(body(1, 0.0), *here, times=10)
    for _ in range(1000):  # 40 s
        snapshot = room.see(*here)
    assert lost_ids(snapshot) == [1]
    assert snapshot.reasons == ()


def test_a_blind_source_never_ends_it_either(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=3)
    room.see(times=100, sees_room=False)
    assert lost_ids(room.see(times=100)) == [1]


def test_a_body_of_which_nothing_is_observed_is_not_seen(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=5)
    snapshot = room.see(body(1, 0.0, observed=~ALL), times=100)
    assert lost_ids(snapshot) == [1]
    assert snapshot.reasons == ()


def test_acknowledge_forgets_only_those_not_seen_for_long(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), body(3, 6.0), times=5)
    room.see(body(2, 3.0), body(3, 6.0), times=LONG_SCENES)
    room.people.acknowledge()
    assert lost_ids(room.people.snapshot(room.now)) == [1]
    snapshot = room.see(body(3, 6.0), times=10)
    assert lost_ids(snapshot) == [1, 2]
    room.people.acknowledge()
    snapshot = room.people.snapshot(room.now)
    assert lost_ids(snapshot) == [2]
    assert snapshot.counters["acknowledged"] == 2
    assert snapshot.counters["forgotten"] == 1


@pytest.mark.parametrize("captures", [2, 3, 4])
def test_acknowledge_forgets_no_one_who_was_just_seen_near_a_lost_person(make_room, captures):
    """Under another's id for a moment: it may be the lost person, or one who hides beside."""
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), times=20)
    room.see(body(1, 0.0), times=LONG_SCENES)
    for _ in range(5):
        room.see(body(1, 3.1), times=captures)
        snapshot = room.see(body(1, 0.0), times=2)
        assert lost_at(snapshot) == [3.0, 3.1]  # no more than the first and the newest
    room.people.acknowledge()
    assert lost_at(room.snapshot()) == [3.1]
    room.see(body(1, 0.0), times=LONG_SCENES)
    room.people.acknowledge()
    assert room.snapshot().lost == ()


def test_a_body_near_two_lost_people_is_one_of_them_at_most(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), body(3, 3.1), times=20)
    room.see(body(1, 0.0), times=4)
    room.see(body(1, 3.05), times=2)
    assert len(room.see(body(1, 0.0), times=2).lost) == 2


@pytest.mark.parametrize("keeps_ids", [True, False])
def test_an_id_that_comes_back_is_that_person_if_the_source_keeps_its_ids(make_room, keeps_ids):
    room = make_room(latency=0, source={"keeps_ids": keeps_ids})
    room.see(body(1, 0.0), times=10)
    room.see(times=LONG_SCENES)
    snapshot = room.see(body(1, 1.0))
    assert snapshot.ids == (1,)
    assert lost_ids(snapshot) == ([] if keeps_ids else [-2])
    assert snapshot.counters.get("found", 0) == keeps_ids


def test_an_id_that_comes_back_soon_is_that_person(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=9)  # 0.4 s
    snapshot = room.see(body(1, 0.2))
    assert snapshot.lost == ()
    assert snapshot.counters["found"] == 1


def test_who_appears_where_people_enter_is_somebody_else(make_room):
    room = make_room(latency=0, entrances=[DOOR])
    room.see(body(1, 3.9), times=10)
    room.see(times=5)
    snapshot = room.see(body(7, 4.6))
    assert snapshot.ids == (7,)
    assert lost_ids(snapshot) == [1]


def test_an_id_that_changes_in_the_door_while_its_body_is_in_place_is_that_body(make_room):
    room = make_room(latency=0, entrances=[DOOR])
    for i in range(20):
        snapshot = room.see(body(i, 4.5 + 0.03 * i))
    assert snapshot.ids == (19,)
    assert snapshot.lost == ()
    room.see(body(19, 5.07))
    assert lost_ids(room.see(body(50, 5.07, 0.6), times=4)) == [19]  # another one beside him


def test_a_runner_is_found_as_far_away_as_he_ran(make_room):
    room = make_room(latency=0)
    for i in range(10):
        room.see(body(1, 0.2 * i))  # 5 m/s
    room.see(times=9)
    assert room.see(body(7, 1.8 + 2.0)).lost == ()


def test_a_lost_person_goes_on_at_the_speed_last_measured(make_room):
    for speed, least, most in ((5.0, 5.0, 7.0), (0.0, 1.6, 1.6)):
        room = make_room(latency=0)
        for i in range(15):
            room.see(body(1, speed * i / RATE))
        (lost,) = room.see(times=4).lost
        assert least <= lost.speed_m_s <= most
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=2)  # no speed could be measured
    assert room.see(times=4).lost[0].speed_m_s == 10.0


def test_a_limb_that_was_faster_than_its_body_is_known(make_room):
    room = make_room(latency=0)
    hand = JOINTS.index("r_hand")
    for i in range(15):
        person = body(1, 0.0)
        person.positions[hand, 0] += 4.0 * i / RATE
        room.see(person)
    (lost,) = room.see(times=4).lost
    assert lost.limbs_m_s[hand] == pytest.approx(4.0, abs=0.5)
    assert lost.limbs_m_s.argmax() == hand


def test_joints_that_were_hidden_at_the_loss_are_inferred(make_room):
    room = make_room(latency=0)
    foot = JOINTS.index("l_foot")
    room.see(body(1, 0.0), times=5)
    without = ALL.copy()
    without[foot] = False
    room.see(body(1, 0.0, observed=without), times=10)
    (lost,) = room.see(times=4).lost
    assert lost.joint_age_s == pytest.approx(0.0)
    assert lost.inferred_m[foot] > 0.05
    assert (np.delete(lost.inferred_m, foot) == 0).all()


def test_of_a_body_of_which_little_was_seen_hidden_joints_are_older(make_room):
    room = make_room(latency=0)
    foot = JOINTS.index("l_foot")
    room.see(body(1, 0.0), times=5)
    few = np.isin(JOINTS, ("l_elbow", "l_wrist", "l_hand"))
    room.see(body(1, 0.0, observed=few), times=10)
    (lost,) = room.see(times=4).lost
    assert lost.joint_age_s[foot] == pytest.approx(0.4)
    assert lost.joint_age_s[JOINTS.index("l_elbow")] == pytest.approx(0.0)


def test_more_lost_people_than_are_kept_may_be_anywhere_until_acknowledged(make_room):
    room = make_room(latency=0, max_people=2, acknowledge_after_s=1.0)
    for i in range(4):
        room.see(body(i, 20.0 * i), times=3)
        room.see(times=4)
    snapshot = room.see(times=200)
    assert len(snapshot.lost) == 2
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    room.people.acknowledge()
    snapshot = room.people.snapshot(room.now)
    assert snapshot.lost == ()
    assert snapshot.reasons == ()


def test_lost_people_outlive_a_restart(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0, observed=np.arange(J) != 3), times=10)
    room.see(times=50)
    data = json.loads(json.dumps(room.people.remember()))
    again = make_room(latency=0)
    again.people.recall(data)
    (lost,) = again.see().lost
    assert (lost.id, lost.speed_m_s) == (-2, 1.6)
    assert np.isnan(lost.positions[3]).all()
    assert np.delete(lost.positions, 3, 0) == pytest.approx(np.delete(SHAPE, 3, 0), abs=1e-3)
    assert again.now - lost.last_seen_ns == pytest.approx(2.0e9, abs=2 * PERIOD)
    assert lost_ids(again.see(body(7, 0.0), times=5)) == [-2]


def test_a_start_that_takes_long_makes_them_older(make_room):
    """Compiling and waiting for links takes seconds, in which the lost person walks on."""
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=50)
    again = make_room(latency=0)
    again.people.recall(room.people.remember(), lambda: 5.0)
    (lost,) = again.see().lost
    assert again.now - lost.last_seen_ns == pytest.approx(7.0e9, abs=2 * PERIOD)


@pytest.mark.parametrize(
    "data", [{}, {"lost": [{}], "forgotten": False}, {"lost": 3, "forgotten": 1}]
)
def test_what_is_no_memory_is_refused(make_room, data):
    with pytest.raises((ValueError, TypeError, KeyError)):
        make_room().people.recall(data)


@pytest.mark.parametrize(
    ("point", "inside"),
    [
        ((5.0, 0.0, 1.0), True),
        ((3.9, 0.0, 1.0), False),
        ((6.1, 0.0, 1.0), False),
        ((5.0, 1.1, 1.0), False),
        ((5.0, 0.0, 3.1), False),
        ((5.0, 0.0, -0.1), False),
    ],
)
def test_points_in_a_prism(point, inside):
    assert DOOR.contains(np.array(point)) is inside


def test_points_in_a_polygon_that_is_not_convex():
    horseshoe = Region(polygon=[[0, 0], [3, 0], [3, 3], [2, 3], [2, 1], [1, 1], [1, 3], [0, 3]])
    assert horseshoe.contains(np.array([0.5, 2.0, 1.0]))
    assert horseshoe.contains(np.array([2.5, 2.0, 1.0]))
    assert not horseshoe.contains(np.array([1.5, 2.0, 1.0]))


def test_places_are_matched_nearest_first_and_once():
    apart = np.array([[0.9, 5.0], [0.1, 4.0]])
    assert match_places(apart, np.full((2, 2), 1.5)) == {1: 0}
    assert match_places(apart, np.full((2, 2), 9.0)) == {1: 0, 0: 1}
    assert match_places(apart, np.full((2, 2), -1.0)) == {}
    assert match_places(np.zeros((2, 0)), np.zeros((2, 0))) == {}


def test_who_was_seen_for_a_moment_is_not_found_at_the_other_end_of_the_room(make_room):
    room = make_room()
    room.see(times=10)
    room.see(body(1, 0.0), times=4)  # too short to measure a speed
    room.see(times=8)
    snapshot = room.see(body(2, 4.0), times=5)
    assert snapshot.ids == (2,)
    assert lost_ids(snapshot) == [1]


def test_an_acknowledge_too_early_leaves_those_dropped_from_too_many(make_room):
    room = make_room(max_people=1)
    room.see(body(1, 0.0), times=10)
    room.see(times=4)
    room.see(body(2, 5.0), times=10)
    assert room.see(times=4).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    room.people.acknowledge()  # the first was last seen 0.7 s ago
    assert room.snapshot().reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    room.see(times=LONG_SCENES)
    room.people.acknowledge()
    assert room.snapshot().reasons == ()
    assert room.snapshot().lost == ()
