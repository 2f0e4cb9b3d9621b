"""Bodies of PoseArray and MarkerArray: numbers, order, what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from hri_predict.protocol.ros.bodies import (
    MAX_PEOPLE,
    MessageError,
    of_marker_array,
    of_pose_array,
)

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import Maker

MAKER = Maker()


def names(joints):
    return [f"joint_{k}" for k in range(joints)]


PEOPLE = st.tuples(st.integers(0, 4), st.integers(1, 40)).flatmap(
    lambda shape: arrays(np.float64, (*shape, 3))  # NaN and infinity among them
)


@given(PEOPLE, st.integers(0, 2**31 * 10**9 - 1))
def test_poses_are_joints_of_one_person_after_the_other(points, at_ns):
    count, joints = points.shape[:2]
    bodies = of_pose_array(MAKER.poses(points, "/room", at_ns), names(joints))
    assert (bodies.stamp_ns, bodies.frame) == (at_ns, "room")
    assert [p.id for p in bodies.people] == list(range(1, count + 1))
    for person, sent in zip(bodies.people, points, strict=True):
        seen = np.isfinite(sent).all(axis=1)
        np.testing.assert_array_equal(person.positions[seen], sent[seen])
        assert np.isnan(person.positions[~seen]).all()


@given(st.integers(2, 40), st.integers(1, 2 * MAX_PEOPLE))
def test_poses_of_another_number_of_joints_are_refused(joints, count):
    message = MAKER.poses(np.zeros((count, 3)))
    if count % joints:
        with pytest.raises(MessageError, match="correct 'joint_map'"):
            of_pose_array(message, names(joints))
    else:
        assert len(of_pose_array(message, names(joints)).people) == count // joints


def test_too_many_people_are_refused():
    with pytest.raises(MessageError, match="at most 64"):
        of_pose_array(MAKER.poses(np.zeros((MAX_PEOPLE + 1, 3))), ["a"])


def test_a_stamp_that_is_none_is_refused():
    message = MAKER.poses(np.zeros((1, 3)))
    message.header.stamp.nanosec = 10**9
    with pytest.raises(MessageError, match="nanoseconds"):
        of_pose_array(message, ["a"])


@given(st.dictionaries(st.integers(0, 400), st.integers(0, 5), max_size=5), st.randoms())
def test_markers_are_joints_by_their_number_in_any_order(bodies, random):
    rng = np.random.default_rng(1)
    sent = {body: rng.normal(size=(32, 3)) for body in bodies}
    message = MAKER.markers(sent, "depth_camera_link", 7)
    random.shuffle(message.markers)
    found = of_marker_array(message, names(32))
    assert {p.id for p in found.people} == set(sent)
    for person in found.people:
        np.testing.assert_array_equal(person.positions, sent[person.id])
    if sent:
        assert (found.stamp_ns, found.frame) == (7, "depth_camera_link")


def test_a_joint_without_marker_is_not_seen():
    message = MAKER.markers({3: np.ones((32, 3))})
    del message.markers[5]
    (person,) = of_marker_array(message, names(32)).people
    assert np.isnan(person.positions[5]).all()
    assert np.isfinite(np.delete(person.positions, 5, axis=0)).all()


def test_deleted_markers_lines_and_texts_are_not_joints():
    gone = MAKER.marker(105, np.zeros(3), action=2, kind=7)
    line = MAKER.marker(99_999, np.zeros(3), kind=5)
    text = MAKER.marker(99_998, np.zeros(3), kind=9)
    joint = MAKER.marker(103, np.ones(3))
    (person,) = of_marker_array(MAKER.marker_array([gone, line, text, joint]), names(32)).people
    assert (person.id, np.isfinite(person.positions).all(axis=1).sum()) == (1, 1)
    found = of_marker_array(MAKER.marker_array([gone]), names(32))
    assert (found.stamp_ns, found.people) == (None, ())


@pytest.mark.parametrize("kind", range(4, 12))
def test_people_drawn_without_a_marker_for_each_joint_are_not_an_empty_room(kind):
    with pytest.raises(MessageError, match=f"type {kind}.*a sphere .type 2. for each joint"):
        of_marker_array(MAKER.marker_array([MAKER.marker(7, np.zeros(3), kind=kind)]), names(32))


@pytest.mark.parametrize("kind", [6, 7, 8, 10, 11])
def test_nor_do_they_vanish_beside_others(kind):
    mixed = [MAKER.marker(1, np.zeros(3)), MAKER.marker(200, np.zeros(3), kind=kind)]
    with pytest.raises(MessageError, match=f"type {kind}"):
        of_marker_array(MAKER.marker_array(mixed), names(32))


@pytest.mark.parametrize("number", [132, 199, -5, 100 * 65_536])
def test_a_marker_that_is_no_joint_of_a_body_is_refused(number):
    with pytest.raises(MessageError, match=f"marker {number} is not joint 0 to 31"):
        of_marker_array(MAKER.marker_array([MAKER.marker(number, np.zeros(3))]), names(32))


def test_a_joint_that_comes_twice_is_refused():
    twice = [MAKER.marker(1, np.zeros(3)), MAKER.marker(1, np.ones(3))]
    with pytest.raises(MessageError, match="is repeated"):
        of_marker_array(MAKER.marker_array(twice), names(32))


@pytest.mark.parametrize("other", [{"frame": "other"}, {"at_ns": 2}])
def test_markers_of_two_captures_are_refused(other):
    mixed = [MAKER.marker(1, np.zeros(3)), MAKER.marker(2, np.zeros(3), **other)]
    with pytest.raises(MessageError, match="publish one capture"):
        of_marker_array(MAKER.marker_array(mixed), names(32))
