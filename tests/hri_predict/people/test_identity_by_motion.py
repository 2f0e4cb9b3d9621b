"""A person is ended only by evidence about that person: the motion, not the number, says who."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from tests.hri_predict.people.figures import SHAPE, J, body, lost_at

ARMS = np.array([name[2:] in ("elbow", "wrist", "hand") for name in JOINTS])
LEGS = np.array([name[2:] in ("knee", "ankle", "foot") for name in JOINTS])


# -- (a) one capture under a colleague's id, (d) an id that alternates ----------------------------


def test_one_capture_under_a_colleagues_id_leaves_that_person_lost(make_room):
    room = make_room()
    room.see(body(2, 4.0), times=10)
    room.see(body(2, 0.0))
    snapshot = room.see(body(2, 4.0), times=50)
    assert snapshot.ids == (2,)
    assert lost_at(snapshot) == [0.0]


@pytest.mark.parametrize("apart", [0.3, 0.45, 0.7, 3.0])
@pytest.mark.parametrize("times", [1, 2, 3])
def test_an_id_that_alternates_between_two_people_loses_the_one_it_leaves(make_room, apart, times):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    for _ in range(6):
        room.see(body(1, apart), times=times)
        room.see(body(1, 0.0), times=times)
    snapshot = room.see(body(1, 0.0), times=10)
    assert snapshot.ids == (1,)
    places = [p.positions[0, 0] - SHAPE[0, 0] for p in snapshot.lost]
    assert max(places) == pytest.approx(apart, abs=0.02)


def test_one_capture_that_is_off_by_little_is_noise_the_next_one_soon_is_somebody(make_room):
    room = make_room()
    room.see(body(1, 0.0), times=10)
    room.see(body(1, 0.35))
    assert room.see(body(1, 0.0), times=10).lost == ()
    room.see(body(1, 0.35))
    assert len(room.see(body(1, 0.0), times=10).lost) == 1


def test_an_id_shown_on_somebody_who_is_tracked_leaves_nobody_lost(make_room):
    room = make_room()
    room.see(body(1, 0.0), body(2, 3.0), times=10)
    room.see(body(1, 3.0))
    assert room.see(body(1, 0.0), body(2, 3.0), times=10).lost == ()


# -- (b) an id that slides ------------------------------------------------------------------------


@pytest.mark.parametrize("apart", [0.3, 0.43, 0.7, 1.5])
@pytest.mark.parametrize("captures", [1, 2, 3])
@pytest.mark.parametrize("speed", [0.0, 1.4])
def test_an_id_that_slides_to_somebody_else_leaves_the_first_one_lost(
    make_room, apart, captures, speed
):
    """He goes on at ``speed``, and the id then stays on a colleague beside, at the same speed."""
    room = make_room()
    for k in range(15):
        room.see(body(1, speed * 0.04 * k))
    for k in range(15, 30):
        aside = apart * min((k - 14) / captures, 1.0)
        snapshot = room.see(body(1, speed * 0.04 * k, y=aside))
    assert snapshot.ids == (1,)
    # the last capture before the slide, or one within it
    places = [p.positions[0, 1] - SHAPE[0, 1] for p in snapshot.lost]
    assert min(places) <= 0.5 * apart


def test_an_id_that_slides_from_arms_to_somebodys_legs_leaves_the_first_one_lost(make_room):
    room = make_room()
    room.see(body(1, 0.0, observed=ARMS), times=20)
    snapshot = room.see(body(1, 0.7, observed=LEGS), times=15)
    assert snapshot.ids == (1,)
    assert len(snapshot.lost) == 1


# -- (c) a new id near a loss ---------------------------------------------------------------------


@pytest.mark.parametrize("apart", [0.22, 0.25, 0.45, 0.7])
@pytest.mark.parametrize("absent", [2, 5, 9])
@pytest.mark.parametrize("speed", [0.0, 1.3])
def test_a_colleague_who_appears_beside_does_not_end_the_lost_person(
    make_room, apart, absent, speed
):
    room = make_room()
    room.see(body(1, 0.0), times=15)
    room.see(times=absent)
    for k in range(20):  # the colleague stands there, or walks away
        snapshot = room.see(body(2, 0.0, y=apart + speed * 0.04 * k))
    assert snapshot.ids == (2,)
    assert lost_at(snapshot) == [0.0]


def test_a_colleague_whom_a_walker_hid_does_not_end_the_walker(make_room):
    """The walker led the way of the colleague, half a metre behind, at the same speed."""
    room = make_room()
    for k in range(15):
        room.see(body(1, 1.4 * 0.04 * k))
    room.see(times=8)
    for k in range(23, 40):
        snapshot = room.see(body(2, 1.4 * 0.04 * k - 0.5))
    assert len(snapshot.lost) == 1


@pytest.mark.parametrize("speed", [0.0, 0.7, 1.4, 3.0])
@pytest.mark.parametrize("absent", [0, 1, 5, 9])
@pytest.mark.parametrize("number", [1, 2])
def test_who_moves_on_as_before_is_found(make_room, speed, absent, number):
    room = make_room()
    rng = np.random.default_rng(5)

    def see(i, k):
        person = body(i, speed * 0.04 * k)
        person.positions[:] += rng.normal(0.0, 0.01, (J, 3))
        return room.see(person)

    for k in range(15):
        see(1, k)
    room.see(times=absent)
    for k in range(15 + absent, 35 + absent):
        snapshot = see(number, k)
    assert snapshot.ids == (number,)
    assert snapshot.lost == ()


def test_who_stops_or_starts_to_walk_out_of_view_is_found(make_room):
    for before, after in ((1.4, 0.0), (0.0, 1.4)):
        room = make_room()
        x = 0.0
        for k in range(50):
            speed = before + (after - before) * min(max((k - 12) / 25, 0.0), 1.0)  # in a second
            x += 0.04 * speed
            snapshot = room.see() if 18 <= k < 27 else room.see(body(1 if k < 18 else 2, x))
        assert snapshot.ids == (2,)
        assert snapshot.lost == ()


@pytest.mark.parametrize("taller", [0.88, 1.12])
@pytest.mark.parametrize("absent", [0, 3, 8])
def test_a_body_with_other_bones_on_the_same_way_does_not_end_the_lost_person(
    make_room, absent, taller
):
    room = make_room()
    for k in range(15):
        room.see(body(1, 1.2 * 0.04 * k))
    room.see(times=absent)
    for k in range(15 + absent, 35 + absent):
        other = body(2, 0.0)
        other.positions[:] = SHAPE * taller + [1.2 * 0.04 * k, 0.0, 0.0]
        snapshot = room.see(other)
    assert snapshot.ids == (2,)
    assert [person.id for person in snapshot.lost] == [1]
