import numpy as np
import pytest

from hri_predict.contracts.scene import Person
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import SHAPE, J, body, lost_at

MS = 1_000_000
PERIOD = 40 * MS


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e300, 1001.0])
def test_joints_that_are_not_numbers_are_unobserved_and_counted(make_room, bad):
    room = make_room()
    room.see(body(1, 0.0), times=3)
    wrong = body(1, 0.0)
    wrong.positions[12, 1] = bad
    snapshot = room.see(wrong)
    assert snapshot.reasons == ()
    assert not snapshot.measured[0, -1, 12]
    assert snapshot.measured[0, -1].sum() == J - 1
    assert snapshot.counters["unusable_joints"] == 1
    assert np.isfinite(snapshot.history).all()
    wrong.positions[:] = bad
    snapshot = room.see(wrong)
    assert snapshot.reasons == (Reason.INPUT_IMPOSSIBLE,)
    assert snapshot.counters["unusable_bodies"] == 1
    assert snapshot.captures == 4
    assert np.isfinite(snapshot.history).all()
    assert room.see(body(1, 0.0)).reasons == ()


@pytest.mark.parametrize("near", [0, 1, 2, 10])
@pytest.mark.parametrize("factor", [1000.0, 1e6])
def test_a_body_in_another_unit_is_impossible_however_few_of_its_joints_are_near(
    make_room, near, factor
):
    room = make_room()
    wrong = body(1, 3.0)
    wrong.positions[:] = factor * wrong.positions
    wrong.positions[:near] = 100.0 + 400.0 * SHAPE[:near]  # within 1000 m, and not of one body
    assert Reason.INPUT_IMPOSSIBLE in room.see(wrong, times=3).reasons


def test_one_joint_that_flies_off_is_disbelieved_alone(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    wrong = body(1, 0.0)
    wrong.positions[8] += [3.0, 0.0, 0.0]
    snapshot = room.see(wrong)
    assert snapshot.reasons == ()
    assert snapshot.counters["impossible_joints"] == 1
    assert not snapshot.measured[0, -1, 8]
    # inferred where it was a moment ago: what the others do says more than one wild capture
    assert snapshot.last_positions[0, 8] == pytest.approx(SHAPE[8], abs=0.1)


def test_a_teleport_is_refused_and_undone(make_room):
    room = make_room(source={"keeps_ids": True})
    room.see(body(1, 0.0), times=5)
    captures = room.snapshot().captures
    snapshot = room.see(body(1, 3.0), times=4)
    assert snapshot.reasons == (Reason.INPUT_IMPOSSIBLE, Reason.INPUT_STALE)
    assert snapshot.counters["impossible_captures"] == 4
    assert snapshot.captures == captures
    assert snapshot.history[0, :, :, 0].max() < 1.0
    assert snapshot.capture_ns[0] == room.now - 5 * MS - 4 * PERIOD
    snapshot = room.see(body(1, 0.02))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1,)
    assert snapshot.lost == ()


@pytest.mark.parametrize("number", [1, 7], ids=["the same id", "a new id"])
@pytest.mark.parametrize(("captures", "lost"), [(1, 1), (2, 1), (4, 1)])
def test_who_stood_where_an_id_jumped_to_is_lost_when_its_body_comes_back(
    make_room, captures, lost, number
):
    """Unless the source keeps its ids, one capture may already be a hidden person."""
    room = make_room()
    room.see(body(1, 0.0), times=5)
    room.see(body(1, 3.0), times=captures)
    snapshot = room.see(body(number, 0.02))
    assert snapshot.ids == (number,)
    assert len(snapshot.lost) == lost
    assert all(p.positions[0, 0] == pytest.approx(3.0, abs=0.1) for p in snapshot.lost)


def test_nobody_is_lost_where_an_id_jumped_to_somebody_who_is_tracked(make_room):
    room = make_room()
    room.see(body(1, 0.0), body(2, 3.0), times=5)
    room.see(body(1, 3.1), times=3)  # the tracker's mistake: this is who is 2
    snapshot = room.see(body(1, 0.02), body(2, 3.0))
    assert snapshot.ids == (1, 2)
    assert snapshot.lost == ()


def test_a_teleport_that_stays_is_believed_and_leaves_a_lost_person_behind(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    room.see(body(1, 3.0), times=5)
    snapshot = room.see(body(1, 3.0))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1,)
    assert snapshot.last_positions[0] == pytest.approx(SHAPE + np.array([3.0, 0.0, 0.0]))
    # its history is that of the new place only: no line is drawn from the old one
    assert snapshot.history[0][snapshot.observed[0]][:, 0].min() > 2.0
    assert [person.id for person in snapshot.lost] == [-2]  # somebody else has the id now
    assert snapshot.lost[0].positions == pytest.approx(SHAPE)


@pytest.mark.parametrize("captures", [8, 20])
def test_a_teleport_and_back_leaves_nothing_behind(make_room, captures):
    room = make_room(source={"keeps_ids": True})
    room.see(body(1, 0.0), times=5)
    room.see(body(1, 3.0), times=captures)
    assert len(room.snapshot().lost) == 1
    room.see(body(1, 0.0), times=5)
    snapshot = room.see(body(1, 0.0))
    assert snapshot.reasons == ()
    assert snapshot.lost == ()
    assert snapshot.ids == (1,)
    assert snapshot.counters["glitches_undone"] == 1


def test_an_id_that_was_on_a_hidden_person_for_a_moment_does_not_forget_that_person(make_room):
    room = make_room()
    room.see(body(1, 0.0), body(2, 3.0), times=20)
    room.see(body(1, 0.0), times=4)
    room.see(body(1, 3.0), times=6)  # the tracker's mistake: this is who was 2
    room.see(body(1, 0.0), times=6)
    (lost,) = room.snapshot().lost
    assert lost.positions == pytest.approx(SHAPE + np.array([3.0, 0.0, 0.0]), abs=0.01)


@pytest.mark.parametrize(("captures", "lost"), [(8, 1), (20, 2)])
def test_an_id_that_was_elsewhere_for_a_while_may_be_two_people(make_room, captures, lost):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    room.see(body(1, 3.0), times=captures)
    room.see(body(1, 0.0), times=6)
    assert len(room.snapshot().lost) == lost


def test_captures_that_never_agree_are_never_believed(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=5)
    rng = np.random.default_rng(3)
    for _ in range(30):
        snapshot = room.see(body(1, float(rng.choice([5.0, 10.0, 15.0, 20.0])) + rng.uniform()))
        assert Reason.INPUT_IMPOSSIBLE in snapshot.reasons
    assert snapshot.history[0, :, :, 0].max() < 1.0
    room.see(body(1, 0.0))
    assert room.see(body(1, 0.0)).reasons == ()


def test_two_ids_that_swap_bodies_get_each_others_history(make_room):
    room = make_room()
    for i in range(20):
        room.see(body(1, 0.0, 0.02 * i), body(2, 3.0, -0.02 * i))
    snapshot = room.see(body(2, 0.0, 0.4), body(1, 3.0, -0.4))
    assert snapshot.reasons == (Reason.INPUT_IMPOSSIBLE,)
    for i in range(21, 26):
        snapshot = room.see(body(2, 0.0, 0.02 * i), body(1, 3.0, -0.02 * i))
    assert snapshot.reasons == ()
    assert snapshot.ids == (1, 2)
    assert snapshot.lost == ()
    assert snapshot.last_positions[0] == pytest.approx(SHAPE + np.array([3.0, -0.5, 0.0]))
    assert snapshot.last_positions[1] == pytest.approx(SHAPE + np.array([0.0, 0.5, 0.0]))
    # each history lies at one place throughout, older steps included
    assert snapshot.observed[:, 0].all()
    assert snapshot.history[0, :, :, 0].min() > 2.0
    assert snapshot.history[1, :, :, 0].max() < 1.0


def test_malformed_bodies_and_double_ids_are_refused(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=3)
    snapshot = room.see(Person(1, np.zeros((5, 3)), np.ones(5, bool)))
    assert snapshot.reasons == (Reason.INPUT_IMPOSSIBLE,)
    assert snapshot.counters["malformed_bodies"] == 1
    snapshot = room.see(body(1, 0.0), body(1, 2.0))
    assert snapshot.reasons == (Reason.INPUT_IMPOSSIBLE,)
    assert snapshot.counters["duplicate_ids"] == 1
    assert room.see(body(1, 0.0), times=10).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


def test_more_people_than_can_be_followed_is_a_reason(make_room):
    room = make_room(max_people=3)
    people = [body(i, 2.0 * i) for i in range(5)]
    assert room.see(*people[:3], times=3).reasons == ()
    snapshot = room.see(*people)
    assert snapshot.reasons == (Reason.TOO_MANY_PEOPLE,)
    assert snapshot.ids == (0, 1, 2)
    assert snapshot.counters["excess_people"] == 2
    assert snapshot.captures == 3
    assert room.see(*people[:3], times=10).reasons == (Reason.ROOM_NOT_SEEN_EMPTY,)


def test_who_is_found_beyond_the_limit_is_one_too_many_and_stays_lost(make_room):
    room = make_room(max_people=2)
    room.see(body(1, 0.0), body(2, 3.0), times=20)
    room.see(body(1, 0.0), times=4)
    room.see(body(1, 0.0), body(3, -3.0))
    for _ in range(50):
        snapshot = room.see(body(1, 0.0), body(3, -3.0), body(4, 3.0))
        assert snapshot.ids == (1, 3)
        assert Reason.TOO_MANY_PEOPLE in snapshot.reasons
    assert lost_at(snapshot) == [3.0]


def test_who_is_tracked_keeps_the_last_place_when_another_appears(make_room):
    room = make_room(max_people=2)
    room.see(body(1, 0.0), body(2, 6.0), times=20)
    room.see(body(1, 3.0), body(2, 6.0), times=4)
    snapshot = room.see(body(3, -3.0), body(1, 3.0), body(2, 6.0))  # the jump is accepted now
    assert snapshot.ids == (1, 2)
    assert Reason.TOO_MANY_PEOPLE in snapshot.reasons
    assert lost_at(snapshot) == [0.0]


def test_a_person_lost_under_two_ids_is_found_once_when_both_places_show_somebody(make_room):
    """Id 1 jumps to a colleague, both vanish, and both are back in one scene."""
    room = make_room(source={"keeps_ids": True})
    room.see(body(1, 0.0), body(2, 6.0), times=60)
    room.see(body(1, 3.0), body(2, 6.0), times=2)
    snapshot = room.see(body(2, 6.0), times=8)
    assert [p.id for p in snapshot.lost] == [1, -2]
    snapshot = room.see(body(1, 0.0), body(7, 3.0), body(2, 6.0))
    assert snapshot.ids == (1, 2, 7)
    assert snapshot.lost == ()
    snapshot = room.see(body(1, 0.0), body(2, 6.0), times=10)
    assert [p.id for p in snapshot.lost] == [7]  # nobody is forgotten
