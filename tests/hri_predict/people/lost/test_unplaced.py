"""People who were in scenes and never tracked: when they vanish, somebody may be anywhere."""

import numpy as np
import pytest

from hri_predict.contracts.scene import Person, Scene
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import ALL, EXIT, SHAPE, J, body, nowhere

ANYWHERE = (Reason.ROOM_NOT_SEEN_EMPTY,)


CASES = {
    "no joint ever seen": ({}, [nowhere(2)], 5),
    "no coordinates": ({}, [Person(2, np.full((J, 3), np.inf), ALL)], 5),
    "one too many": ({"max_people": 1}, [body(2, 0.6)], 1),
    "the id of another": ({}, [body(1, 0.6)], 1),
}


@pytest.mark.parametrize(("limits", "person", "captures"), CASES.values(), ids=CASES)
def test_who_vanishes_untracked_may_be_anywhere_until_an_acknowledgement(
    make_room, limits, person, captures
):
    room = make_room(**limits)
    room.see(body(1, 6.0), times=5)
    snapshot = room.see(body(1, 6.0), *person, times=captures)
    assert snapshot.reasons not in ((), ANYWHERE)
    for _ in range(10):  # there is no moment without a reason
        assert room.see(body(1, 6.0)).reasons != ()
    assert room.see(body(1, 6.0), times=500).reasons == ANYWHERE
    room.people.acknowledge()
    assert room.see(body(1, 6.0)).reasons == ()


@pytest.mark.parametrize(("limits", "person", "captures"), CASES.values(), ids=CASES)
def test_an_acknowledgement_does_not_mean_who_is_still_there(make_room, limits, person, captures):
    room = make_room(**limits)
    room.see(body(1, 6.0), times=5)
    room.see(body(1, 6.0), *person, times=captures + 200)
    room.people.acknowledge()
    room.see(body(1, 6.0), *person)
    assert room.see(body(1, 6.0), times=10).reasons == ANYWHERE
    room.people.acknowledge()  # too soon: the operator may not have meant this one
    assert room.see(body(1, 6.0)).reasons == ANYWHERE


def test_a_phantom_of_a_few_captures_without_a_joint_leaves_nothing_behind(make_room):
    room = make_room()
    room.see(body(1, 6.0), nowhere(2), times=4)
    assert room.see(body(1, 6.0), times=10).reasons == ()


def test_it_ends_when_that_person_is_tracked(make_room):
    room = make_room(max_people=1)
    room.see(body(1, 6.0), times=5)
    room.see(body(1, 6.0), body(2, 0.6), times=5)
    room.see(body(2, 0.6), times=10)  # the other has gone, and there is room now
    snapshot = room.see(body(2, 0.6))
    assert (snapshot.ids, snapshot.reasons) == ((2,), ())
    assert [p.id for p in snapshot.lost] == [1]


def test_an_id_that_gets_anothers_track_is_not_found(make_room):
    for limits, person in (({"max_people": 1}, body(2, 0.6)), ({}, nowhere(2))):
        room = make_room(**limits)
        room.see(body(1, 6.0), times=5)
        room.see(body(1, 6.0), person, times=50)
        snapshot = room.see(body(2, 6.0), times=100)  # the ids were switched as one was hidden
        assert (snapshot.ids, snapshot.reasons) == ((2,), ANYWHERE)


def test_one_too_many_that_takes_over_the_track_beside_leaves_the_other_behind(make_room):
    room = make_room(max_people=1)
    room.see(body(1, 2.0), times=5)
    room.see(body(1, 2.0), body(2, 2.1), times=10)
    assert room.see(body(2, 2.1), times=21).reasons == ANYWHERE


@pytest.mark.parametrize("person", [nowhere(2), body(2, 0.6)], ids=["no joint", "one too many"])
def test_after_a_blind_time_an_id_may_be_another_person(make_room, person):
    room = make_room(max_people=1 if person.observed.any() else 8)
    room.see(body(1, 6.0), times=5)
    room.see(body(1, 6.0), person, times=50)
    room.see(sees_room=False, times=500)
    assert Reason.ROOM_NOT_SEEN_EMPTY in room.see(body(2, 6.2), times=5).reasons


def test_who_gets_another_id_each_few_captures_was_there_all_the_same(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    for k in range(100):
        room.see(body(1, 6.0), nowhere(100 + k // 4))
    assert room.see(body(1, 6.0), times=10).reasons == ANYWHERE


def test_more_ids_than_people_may_be_anywhere_and_are_not_kept(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    for k in range(50):
        room.see(body(1, 6.0), *(nowhere(100 + 20 * k + n) for n in range(20)), sees_room=False)
    assert room.see(body(1, 6.0), times=10).reasons == ANYWHERE
    assert len(room.people._unplaced._present) == 0


@pytest.mark.parametrize("captures", [7, 25, 100])
def test_an_id_that_a_tracker_keeps_after_an_exit_leaves_nothing_behind(make_room, captures):
    room = make_room(exits=[EXIT])
    for step in range(31):
        room.see(body(1, 0.1 * step), body(2, -3.0))
    room.see(body(2, -3.0), nowhere(1), times=captures)
    snapshot = room.see(body(2, -3.0), times=10)
    assert snapshot.counters["left_by_exit"] == 1
    assert snapshot.reasons == ()


def test_an_old_id_that_a_tracker_keeps_beside_the_new_one_leaves_nothing_behind(make_room):
    room = make_room()
    room.see(body(1, 2.0), times=10)
    room.see(body(2, 2.0), nowhere(1), times=30)
    assert room.see(body(2, 2.0), times=10).reasons == ()


def test_at_the_limit_a_phantom_without_a_joint_is_not_one_too_many(make_room):
    room = make_room(max_people=1)
    room.see(body(1, 2.0), nowhere(2))
    assert room.see(body(1, 2.0), times=10).reasons == ()


def test_an_id_twice_once_without_a_joint_is_a_fault_but_nobody_else(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    assert room.see(body(1, 6.0), nowhere(1)).reasons == (Reason.INPUT_IMPOSSIBLE,)
    assert room.see(body(1, 6.0), times=10).reasons == ()


def test_the_same_body_twice_is_a_fault_but_nobody_else(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    assert room.see(body(1, 6.0), body(1, 6.1)).reasons == (Reason.INPUT_IMPOSSIBLE,)
    assert room.see(body(1, 6.0), times=10).reasons == ()


def test_they_are_remembered_across_a_restart(make_room):
    room, after = make_room(max_people=1), make_room(max_people=1)
    room.see(body(1, 6.0), times=5)
    room.see(body(1, 6.0), body(2, 0.6))
    after.people.recall(room.people.remember())
    assert after.see(body(1, 6.0), times=5).reasons == ANYWHERE


# -- an id of a lost person, and no joint ----------------------------------------------------------


@pytest.mark.parametrize(
    ("keeps_ids", "later", "reasons"),
    [
        (False, 10, ()),  # 0.4 s: may be in the lost zone
        (False, 20, (Reason.PERSON_NOT_LOCATED,)),  # the tracker may have given the id to another
        (True, 20, ()),
    ],
)
def test_an_old_id_that_comes_back_without_a_joint(make_room, keeps_ids, later, reasons):
    room = make_room(source={"keeps_ids": keeps_ids})
    room.see(body(1, 8.5), times=5)
    assert len(room.see(times=later).lost) == 1
    assert room.see(nowhere(1)).reasons == reasons


# -- scenes that do not advance --------------------------------------------------------------------


def resend(room, sequence, *persons, late_ns=0):
    """A scene that the node refuses."""
    scene = Scene(room.now - room.latency - late_ns, sequence, True, persons)
    room.people.receive(scene, room.now)
    return room.snapshot()


def beside(room, *persons, times=1, sequence=0):
    """Each good scene of a far person is followed by a refused one."""
    for _ in range(times):
        room.see(body(1, 6.0))
        snapshot = resend(room, room.sequence + sequence, *persons, late_ns=1 if sequence else 0)
    return snapshot


@pytest.mark.parametrize("sequence", [0, -50], ids=["same sequence", "another sender's"])
@pytest.mark.parametrize("number", [1, 2])
def test_somebody_in_refused_scenes_alone_is_a_fault_and_then_may_be_anywhere(
    make_room, sequence, number
):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    for _ in range(20):
        snapshot = beside(room, body(number, 0.6), sequence=sequence)
        assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    for _ in range(10):
        assert room.see(body(1, 6.0)).reasons != ()
    assert room.see(body(1, 6.0), times=100).reasons == ANYWHERE


def test_a_late_stamp_does_not_hide_somebody(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=5)
    for _ in range(5):
        room.see(body(1, 6.0))
        snapshot = resend(room, room.sequence + 1, body(2, 0.6), late_ns=50_000_000)
        room.sequence += 1
    assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons


def test_late_and_repeated_packets_of_the_same_people_change_nothing(make_room):
    room = make_room()
    room.see(body(1, 6.0), body(2, 3.0), times=5)
    for k in range(20):
        assert room.see(body(1, 6.0), body(2, 3.0 + 0.1 * k)).reasons == ()
        assert resend(room, room.sequence, body(2, 3.0 + 0.1 * k)).reasons == ()
        assert resend(room, room.sequence - 3, body(2, 2.9 + 0.1 * k)).reasons == ()


def test_a_source_that_restarts_gives_new_ids_to_the_same_people(make_room):
    room = make_room()
    room.see(body(1, 6.0), times=20)
    room.sequence = -1
    snapshot = room.see(body(7, 6.0), times=30)
    assert (snapshot.ids, snapshot.reasons) == ((7,), ())
    assert snapshot.counters["source_restarts"] == 1


@pytest.mark.parametrize("copies", [1, 2])
def test_late_packets_of_an_id_that_was_renamed_change_nothing(make_room, copies):
    room = make_room()
    room.see(body(1, 3.0), times=5)
    room.see(body(2, 3.0))
    for _ in range(copies):
        assert resend(room, room.sequence - 1, body(1, 3.0)).reasons == ()


def test_a_late_packet_of_somebody_just_lost_changes_nothing(make_room):
    room = make_room()
    room.see(body(1, 6.0), body(2, 3.0), times=5)
    assert len(room.see(body(1, 6.0), times=5).lost) == 1
    assert resend(room, room.sequence - 6, body(1, 6.0), body(2, 3.0)).reasons == ()


# -- an id in two places ---------------------------------------------------------------------------


def test_while_an_id_may_be_in_two_places_there_is_a_reason(make_room):
    room = make_room(max_gap_s=1.0)
    room.see(body(1, 6.0), times=10)
    room.see(body(1, 0.6), times=3)
    while not (snapshot := room.see()).lost:
        assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    assert len(snapshot.lost) == 2


# -- a frozen source -------------------------------------------------------------------------------


@pytest.mark.parametrize("pictures", [1, 2, 3, 8])
def test_a_source_that_repeats_a_few_pictures_is_frozen(make_room, pictures):
    room = make_room(declares_noise=True)
    rng = np.random.default_rng(0)
    noisy = [
        Person(1, SHAPE + np.array([6.0, 0.0, 0.0]) + rng.normal(0, 0.005, (J, 3)), ALL)
        for _ in range(pictures)
    ]
    for k in range(40):
        snapshot = room.see(noisy[k % pictures])
    assert Reason.INPUT_FROZEN in snapshot.reasons
    assert snapshot.counters["identical_captures"] == 40 - pictures
