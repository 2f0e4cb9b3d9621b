import numpy as np
import pytest

from hri_predict.people.lost import match_places
from hri_predict.protocol.reasons import Reason
from hri_predict.scene import Person
from hri_predict.settings import Region
from hri_predict.skeleton import JOINTS

MS = 1_000_000
RATE = 25.0
PERIOD = 40 * MS
GROWTH_SCENES = 75  # 3 s
J = len(JOINTS)
T = 10
SHAPE = np.random.default_rng(7).uniform([-0.2, -0.4, 0.0], [0.2, 0.4, 1.8], (J, 3))
ALL = np.ones(J, bool)
DOOR = Region(polygon=[[4.0, -1.0], [6.0, -1.0], [6.0, 1.0], [4.0, 1.0]])


def body(person_id, x, y=0.0, observed=ALL):
    return Person(person_id, SHAPE + np.array([x, y, 0.0]), observed)


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


def test_ageing_out_never_clears_while_the_room_is_not_seen_empty(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), times=10)
    snapshot = room.see(body(2, 3.0), times=GROWTH_SCENES)
    assert lost_ids(snapshot) == [1]
    assert snapshot.reasons == ()
    for _ in range(500):  # 20 s; somebody is always there, so the room is never seen empty
        snapshot = room.see(body(2, 3.0))
        assert snapshot.lost == ()
        assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


def test_a_blind_source_never_clears_either(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=3)
    room.see(times=2 * GROWTH_SCENES, sees_room=False)
    snapshot = room.see(times=9)
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    room.see(sees_room=False)
    assert room.see(times=9).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)  # ten in a row are needed
    assert room.see().reasons == ()


def test_an_empty_room_clears_only_after_the_growth(make_room):
    """Somebody hidden behind a machine gives empty scenes from the moment he vanishes."""
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    for _ in range(GROWTH_SCENES):
        snapshot = room.see()
        assert snapshot.ids == (1,) or lost_ids(snapshot) == [1]
    for _ in range(9):
        snapshot = room.see()
        assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    snapshot = room.see()
    assert snapshot.reasons == ()
    assert snapshot.lost == ()
    assert snapshot.counters["seen_empty"] == 1


def test_empty_scenes_must_follow_each_other(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=5)
    room.see(times=GROWTH_SCENES + 5)
    room.see(body(2, 9.0))
    assert room.see(body(2, 9.0)).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


def test_empty_scenes_with_a_long_silence_between_are_not_in_a_row(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=5)
    room.see(times=GROWTH_SCENES + 5)
    room.now += 10_000 * MS
    assert room.see(times=9).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    assert room.see().reasons == ()


def test_a_body_of_which_nothing_is_observed_is_not_seen_but_the_room_is_not_empty(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=5)
    snapshot = room.see(body(1, 0.0, observed=~ALL), times=GROWTH_SCENES)
    assert lost_ids(snapshot) == [1]
    snapshot = room.see(body(1, 0.0, observed=~ALL), times=100)
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    assert room.see(body(1, 0.5)).reasons == ()


def test_acknowledge_clears_only_those_whose_growth_is_over(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), body(3, 6.0), times=5)
    room.see(body(2, 3.0), body(3, 6.0), times=GROWTH_SCENES)
    room.people.acknowledge()
    assert lost_ids(room.people.snapshot(room.now)) == [1]
    snapshot = room.see(body(3, 6.0), times=10)
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    assert lost_ids(snapshot) == [2]
    room.people.acknowledge()
    snapshot = room.people.snapshot(room.now)
    assert snapshot.reasons == ()
    assert lost_ids(snapshot) == [2]
    assert snapshot.counters["acknowledged"] == 2


def test_who_leaves_by_an_exit_is_gone(make_room):
    room = make_room(latency=0, exits=[DOOR])
    for i in range(30):
        room.see(body(1, 0.15 * i), body(2, 0.0, 3.0))
    snapshot = room.see(body(2, 0.0, 3.0), times=2 * GROWTH_SCENES)
    assert snapshot.ids == (2,)
    assert snapshot.lost == ()
    assert snapshot.reasons == ()
    assert snapshot.counters["left_by_exit"] == 1
    assert lost_ids(room.see(times=3)) == [2]  # and no one else


def test_the_same_id_is_found_again(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=20)
    snapshot = room.see(body(1, 1.0))
    assert snapshot.ids == (1,)
    assert snapshot.lost == ()
    assert snapshot.counters["found"] == 1
    # even after the growth: it is the source that vouches for the id
    room.see(times=GROWTH_SCENES + 5)
    snapshot = room.see(body(1, 2.0))
    assert snapshot.ids == (1,)
    assert snapshot.reasons == ()


def test_the_same_id_too_far_away_is_somebody_else(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=4)
    snapshot = room.see(body(1, 8.0))
    assert snapshot.ids == (1,)
    assert lost_ids(snapshot) == [1]
    assert snapshot.lost[0].positions == pytest.approx(SHAPE)


def test_a_new_id_inside_the_grown_zone_inherits_place_and_history(make_room):
    room = make_room(latency=0)
    for i in range(10):
        room.see(body(1, 0.02 * i))
    room.see(times=4)
    snapshot = room.see(body(7, 0.5))
    assert snapshot.ids == (7,)
    assert snapshot.lost == ()
    assert snapshot.reasons == ()
    assert snapshot.counters["inherited"] == 1
    # the last step is the new capture, the four before are not bridged, the older are the old ones
    assert snapshot.observed[0].all(axis=1).tolist() == [True] * 5 + [False] * 4 + [True]
    assert snapshot.history[0, 4] == pytest.approx(SHAPE + np.array([0.18, 0.0, 0.0]))
    assert snapshot.history[0, 9] == pytest.approx(SHAPE + np.array([0.5, 0.0, 0.0]))


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


def test_a_new_id_outside_the_grown_zone_inherits_nothing(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=10)  # 0.44 s: the zone has grown by 0.7 m
    snapshot = room.see(body(7, 2.0))
    assert snapshot.ids == (7,)
    assert lost_ids(snapshot) == [1]
    assert snapshot.observed[0].all(axis=1).tolist() == [False] * 9 + [True]


def test_after_the_growth_a_new_id_inherits_nothing(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    room.see(times=GROWTH_SCENES + 2)
    snapshot = room.see(body(7, 0.0))
    assert snapshot.ids == (7,)
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


def test_one_body_accounts_for_one_lost_person_only(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 1.0), times=10)
    room.see(times=5)
    snapshot = room.see(body(7, 0.9))
    assert snapshot.ids == (7,)
    assert lost_ids(snapshot) == [1]


def test_more_lost_people_than_are_kept_need_an_empty_room(make_room):
    room = make_room(latency=0, max_people=2, lost_growth_s=1.0)
    for i in range(4):
        room.see(body(i, 20.0 * i), times=3)
        room.see(times=4)
    snapshot = room.people.snapshot(room.now)
    assert len(snapshot.lost) == 2
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)
    assert room.see(times=40).reasons == ()


def test_a_source_that_falls_silent_does_not_make_people_vanish(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=10)
    snapshot = room.people.snapshot(room.now + 60_000 * MS)
    assert snapshot.ids == (1,)
    assert snapshot.reasons == (Reason.INPUT_STALE,)
    room.now += 60_000 * MS
    snapshot = room.see()  # and when it comes back, whoever is missing vanished long ago
    assert snapshot.ids == ()
    assert snapshot.reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


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
    starts = [np.array([0.0, 0, 0]), np.array([1.0, 0, 0])]
    places = [np.array([0.9, 0, 0]), np.array([5.0, 0, 0])]
    assert match_places(starts, places, np.full((2, 2), 1.5)) == {1: 0}
    assert match_places(starts, places, np.full((2, 2), 9.0)) == {1: 0, 0: 1}
    assert match_places(starts, places, np.full((2, 2), -1.0)) == {}
    assert match_places([], places, np.zeros((0, 2))) == {}
