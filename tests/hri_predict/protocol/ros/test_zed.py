"""ZED's bodies: formats, what was not seen, what is refused, both definitions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.ros.bodies import MAX_PEOPLE, MessageError
from hri_predict.protocol.ros.messages import of_cdr
from hri_predict.protocol.ros.zed import OBJECTS, OBJECTS_BEFORE, keypoints_of, of_objects

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import Maker

MAKER = Maker()
POINTS = np.arange(1.0, 1.0 + 34 * 3).reshape(34, 3) / 64  # exact in 32 bits


def names(count=34):
    return [f"k{k}" for k in range(count)]


@pytest.mark.parametrize("count", [18, 34, 38, 70])
def test_keypoints_are_the_joints_in_the_wrappers_order(count):
    points = np.arange(1.0, 1.0 + count * 3).reshape(count, 3) / 64
    message = MAKER.objects({7: points, 300: points + 1}, "zed_left", 5)
    found = of_objects(message, names(count))
    assert (found.stamp_ns, found.frame) == (5, "zed_left")
    assert [p.id for p in found.people] == [7, 300]
    np.testing.assert_array_equal(found.people[1].positions, points + 1)
    assert keypoints_of(message) == count


def test_zeros_and_no_numbers_were_not_seen():
    points = POINTS.copy()
    points[3] = 0
    points[4, 1] = np.nan
    (person,) = of_objects(MAKER.objects({1: points}), names()).people
    unseen = np.isnan(person.positions).all(axis=1)
    assert list(np.flatnonzero(unseen)) == [3, 4]


@pytest.mark.parametrize("state", [0, 2, 3])
def test_a_body_whose_way_is_estimated_is_there_without_a_place(state):
    (person,) = of_objects(MAKER.objects({1: POINTS}, tracking_state=state), names()).people
    assert np.isnan(person.positions).all()


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"skeleton_available": False}, "subscribe to body_trk/skeletons"),
        ({"tracking_available": False}, "set body_tracking.enable_tracking"),
        ({"body_format": 2}, "body_format 2 has 38 keypoints, and the joint map 34 joints"),
        ({"body_format": 9}, "body_format 9 has an unknown number of keypoints"),
        ({"label_id": 4}, "an id is repeated"),
    ],
)
def test_what_places_no_one_is_refused_with_the_remedy(fields, words):
    with pytest.raises(MessageError, match=words):
        of_objects(MAKER.objects({1: POINTS, 2: POINTS}, **fields), names())


def test_too_many_bodies_are_refused():
    with pytest.raises(MessageError, match="at most 64"):
        of_objects(MAKER.objects(dict.fromkeys(range(MAX_PEOPLE + 1), POINTS)), names())


@given(st.integers(0, 3), st.sampled_from([OBJECTS, OBJECTS_BEFORE]), st.text("aé", max_size=9))
def test_both_definitions_are_told_apart_by_their_length(count, kind, frame):
    sent = {k: POINTS + k for k in range(count)}
    message = MAKER.objects(sent, frame, 5, kind=kind)
    read = of_cdr(MAKER.store, MAKER.cdr(message, kind), OBJECTS)
    found = of_objects(read, names())
    assert found.frame == frame
    assert [p.id for p in found.people] == list(range(count))
    for person in found.people:
        np.testing.assert_array_equal(person.positions, sent[person.id])
