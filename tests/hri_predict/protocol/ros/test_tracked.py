"""ROS4HRI: bodies that are tracked, placed by their frames."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.ros.bodies import MAX_PEOPLE, MessageError
from hri_predict.protocol.ros.frame_tree import GAP_NS, FrameTree
from hri_predict.protocol.ros.placing import NotYet, PeopleReader
from hri_predict.protocol.ros.tracked import IDS_LIST, Numbers, of_ids_list

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

MAKER = Maker()
S = 10**9
NAMES = ("body", "head")
PLACES = {"body": (1.0, 2.0, 1.0), "head": (1.0, 2.0, 1.7)}


class Room:
    """A camera 2 m above the map's origin."""

    def __init__(self):
        self.tree = FrameTree()
        edge = ("map", "camera", (0.0, 0.0, 2.0), UPRIGHT)
        self.tree.add(MAKER.transforms(edge), static=True)
        self.reader = PeopleReader(NAMES, "map", self.tree)

    def show(self, name, at_ns, places=PLACES, **options):
        self.tree.add(MAKER.body(name, places, at_ns), static=False, **options)

    def tracked(self, *ids, at_ns, waits=False):
        bodies = self.reader.parse(IDS_LIST, MAKER.tracked(*ids, at_ns=at_ns))
        return self.reader.place(bodies, waits=waits)


def test_joints_are_at_the_origins_of_the_bodys_frames():
    room = Room()
    room.show("abc", S)
    found = room.tracked("abc", at_ns=S)
    np.testing.assert_array_equal(found.people[0].positions, [[1, 2, 3], [1, 2, 3.7]])
    assert (found.stamp_ns, found.frame) == (S, "map")


def test_no_one_tracked_is_no_one_wherever_the_message_comes_from():
    assert Room().tracked(at_ns=S).people == ()


def test_a_frame_that_is_missing_is_a_joint_that_was_not_seen():
    room = Room()
    room.show("abc", S, {"head": PLACES["head"]})
    (person,) = room.tracked("abc", at_ns=S).people
    np.testing.assert_array_equal(np.isfinite(person.positions).all(axis=1), [False, True])


def test_a_body_without_any_frame_refuses_the_capture():
    """Its advice must not be that of the others alone."""
    room = Room()
    room.show("abc", S)
    with pytest.raises(MessageError) as caught:
        room.tracked("abc", "xyz", at_ns=S)
    assert str(caught.value) == (
        "body 'xyz' has no place: no transform connects 'body_xyz' to 'map'"
    )


def test_a_body_at_its_sensor_was_not_measured():
    room = Room()
    room.show("abc", S, PLACES | {"body": (0.0, 0.0, 0.0)})
    with pytest.raises(MessageError, match="'body_abc' is at its sensor; give the tracker depth"):
        room.tracked("abc", at_ns=S)


def test_frames_that_are_on_their_way_are_waited_for():
    room = Room()
    room.show("abc", S)
    with pytest.raises(NotYet):
        room.tracked("abc", at_ns=S + S // 20, waits=True)
    room.show("abc", S + S // 20)
    assert np.isfinite(room.tracked("abc", at_ns=S + S // 20, waits=True).people[0].positions).all()


def test_a_body_whose_frames_stop_has_no_place_even_if_it_stood_still():
    """The list goes on: the tracker believes that the body is there, and measures nothing."""
    room = Room()
    for k in range(3):
        room.show("abc", S + k)
    for late_ns in (1, GAP_NS, GAP_NS + 1, 10 * S):
        with pytest.raises(MessageError, match="has no value at the message's stamp"):
            room.tracked("abc", at_ns=S + 2 + late_ns)


def test_a_body_that_was_last_seen_long_ago_is_not_waited_for():
    room = Room()
    room.show("abc", S)
    with pytest.raises(MessageError) as caught:
        room.tracked("abc", at_ns=2 * S, waits=True)
    assert not isinstance(caught.value, NotYet)


def test_a_number_stays_with_its_name():
    room = Room()
    for name in "abc":
        room.show(name, S)
    numbers = [[p.id for p in room.tracked(*ids, at_ns=S).people]
               for ids in (("a", "b"), ("b",), ("c", "b", "a"))]  # fmt: skip
    assert numbers == [[1, 2], [2], [3, 2, 1]]


@given(st.lists(st.text(min_size=1, max_size=3), max_size=60), st.integers(0, 65_535))
def test_numbers_of_names_differ(names, first):
    numbers = Numbers()
    numbers._next = first
    found = {name: numbers.of(name) for name in names}
    assert len(set(found.values())) == len(found)
    assert all(0 <= number <= 65_535 for number in found.values())
    assert {name: numbers.of(name) for name in names} == found


def test_names_without_end_keep_memory_bounded():
    numbers = Numbers()
    assert len({numbers.of(str(k)) for k in range(3000)}) == 3000
    assert len(numbers._numbers) == 1024


@pytest.mark.parametrize("ids", [("a", "a"), ("",)])
def test_ids_that_are_empty_or_come_twice_are_refused(ids):
    with pytest.raises(MessageError, match="an id is empty or repeated"):
        of_ids_list(MAKER.tracked(*ids), NAMES)


def test_too_many_bodies_are_refused():
    with pytest.raises(MessageError, match="at most 64"):
        of_ids_list(MAKER.tracked(*map(str, range(MAX_PEOPLE + 1))), NAMES)
