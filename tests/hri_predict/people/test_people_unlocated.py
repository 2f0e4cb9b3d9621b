"""Somebody is in the scene, and no joint says where: that must never look like an empty room."""

import numpy as np

from hri_predict.contracts.joint_map import load_joint_map
from hri_predict.contracts.scene import Person
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import EXIT, body, nowhere

CMU = load_joint_map("cmu38")
UNUSED = np.flatnonzero(~np.any(CMU.weights > 0, axis=0))
STALE_TOO = (Reason.PERSON_NOT_LOCATED, Reason.INPUT_STALE)


def test_a_scene_of_somebody_unseen_is_no_good_capture(make_room):
    room = make_room()
    snapshot = room.see(nowhere(1))
    assert snapshot.reasons == STALE_TOO
    assert (snapshot.ids, snapshot.captures, snapshot.newest_capture_ns) == ((), 0, None)
    assert snapshot.counters["unlocated_people"] == 1
    snapshot = room.see(nowhere(1), times=100)
    assert snapshot.reasons == STALE_TOO
    assert snapshot.captures == 0
    assert snapshot.counters["unlocated_people"] == 101


def test_joints_that_the_map_does_not_use_locate_nobody(make_room):
    assert UNUSED.size, "every joint of cmu38 is used"
    room = make_room(joint_map="cmu38")
    count = len(CMU.source_joints)
    observed = np.zeros(count, bool)
    observed[UNUSED] = True
    person = Person(1, np.full((count, 3), 0.5), observed)
    snapshot = room.see(person, times=5)
    assert snapshot.reasons == STALE_TOO
    assert snapshot.counters["unlocated_people"] == 5
    used = observed.copy()
    used[CMU.source_joints.index("LeftFoot")] = True
    snapshot = room.see(Person(1, person.positions, used))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1,)


def test_it_ends_when_that_person_is_seen(make_room):
    room = make_room()
    room.see(body(1, 0.0), nowhere(2), times=5)
    assert room.snapshot().reasons == STALE_TOO  # the one who is seen makes it no better
    snapshot = room.see(body(1, 0.0), body(2, 2.0))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1, 2)


def test_who_is_followed_ages_and_then_is_lost_as_if_not_in_the_scene(make_room):
    unseen, absent = make_room(), make_room()
    for step in range(150):
        persons = [body(1, 0.0)] if step < 5 else []
        a = absent.see(body(3, 5.0), *persons)
        b = unseen.see(body(3, 5.0), *(persons or [nowhere(1)]))
        assert (a.reasons, a.ids, a.captures) == (b.reasons, b.ids, b.captures)
        assert [p.last_seen_ns for p in a.lost] == [p.last_seen_ns for p in b.lost]
    assert [p.id for p in b.lost] == [1]
    assert "unlocated_people" not in {k for k, v in b.counters.items() if v}


def test_a_lost_person_accounts_for_nobody_elses_absence(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    assert len(room.see(times=10).lost) == 1
    snapshot = room.see(nowhere(1))  # may be in the lost zone
    assert snapshot.reasons == ()
    snapshot = room.see(nowhere(2))  # may be anywhere
    assert snapshot.reasons == (Reason.PERSON_NOT_LOCATED,)
    assert len(snapshot.lost) == 1


def test_the_place_that_another_took_over_accounts_for_him_no_more(make_room):
    # two ids, one always seen; then they swap, and the body that is seen continues as id 2
    room = make_room()
    room.see(body(1, 0.0), times=5)
    snapshot = room.see(nowhere(1), body(2, 0.02))
    assert snapshot.ids == (2,)
    assert snapshot.counters["inherited"] == 1
    assert snapshot.reasons == (Reason.PERSON_NOT_LOCATED,)
    assert room.see(nowhere(1), body(2, 0.02), times=10).reasons == STALE_TOO


def test_an_acknowledgement_or_an_exit_does_not_do_away_with_who_is_still_in_the_scene(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    assert room.see(nowhere(1), times=100).reasons == ()
    room.people.acknowledge()
    assert room.see(nowhere(1)).reasons == (Reason.PERSON_NOT_LOCATED,)
    by_door = make_room(exits=[EXIT])
    for step in range(31):
        by_door.see(body(1, 0.1 * step))
    snapshot = by_door.see(nowhere(1), times=10)
    assert snapshot.counters["left_by_exit"] == 1
    assert snapshot.reasons == STALE_TOO
