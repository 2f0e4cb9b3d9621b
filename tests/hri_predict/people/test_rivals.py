"""Bodies to which an id jumped for a moment: who is lost there, and who is not."""

import pytest

from hri_predict.protocol.reasons import Reason
from tests.hri_predict.people.figures import body, lost_at


@pytest.mark.parametrize(
    "scene", [[(7, 0.0), (2, 3.0)], [(7, 0.0), (8, 3.0)], [(2, 3.0), (7, 0.0)]]
)
def test_a_lost_person_who_returns_with_the_end_of_a_jump_is_found_once(make_room, scene):
    room = make_room()
    room.see(body(1, 0.0), body(2, 3.0), times=20)
    assert lost_at(room.see(body(1, 0.0), times=4)) == [3.0]
    room.see(body(1, 3.0))  # the id jumps to the lost person's body for one capture
    shown = room.see(*(body(number, x) for number, x in scene))
    assert sorted(shown.ids) == sorted(number for number, _ in scene)
    assert (lost_at(shown), shown.reasons) == ([], ())


@pytest.mark.parametrize("scene", [[(7, 0.0), (8, 3.0)], [(8, 3.0), (7, 0.0)]])
def test_a_person_of_the_same_scene_is_not_lost_in_whatever_order_it_names_them(make_room, scene):
    room = make_room()
    room.see(body(1, 0.0), times=20)
    room.see(body(1, 3.0))
    for _ in range(2):
        shown = room.see(*(body(number, x) for number, x in scene))
        assert (sorted(shown.ids), lost_at(shown)) == ([7, 8], [])


def test_an_id_that_jumps_between_two_places_does_not_fill_the_list_of_the_lost(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), times=20)
    for turn in range(40):
        room.see(body(1, 3.0 if turn % 2 else -3.0), times=2)
        shown = room.see(body(1, 0.0), times=25)
        assert len(shown.lost) <= 4
        assert Reason.ROOM_NOT_SEEN_EMPTY not in shown.reasons


def test_a_glimpse_does_not_end_a_person_who_was_lost_there_on_their_own(make_room):
    room = make_room(latency=0)
    room.see(body(1, 0.0), body(2, 3.0), times=20)
    room.see(body(1, 0.0), times=60)
    room.see(body(1, 3.1), times=3)  # another person, under a wrong id
    assert lost_at(room.see(body(1, 0.0), times=30)) == [3.0, 3.1]
    room.people.acknowledge()
    assert lost_at(room.see(body(1, 0.0), times=250)) == [3.1]
    room.see(body(1, 3.2))
    shown = room.see(body(1, 0.0), times=2)
    assert sorted(lost_at(shown)) == [3.1, 3.2]
    oldest_ns = min(person.last_seen_ns for person in shown.lost)
    assert room.now - oldest_ns > 10_000_000_000
