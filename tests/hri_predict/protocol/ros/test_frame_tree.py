"""Frames by tf: chains, movement, what has no value."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.ros.frame_tree import MAX_FRAMES, FrameTree, UnknownFrame

pytest.importorskip("rosbags", reason="needs the extra bags")
from tests.hri_predict.protocol.ros.sent import UPRIGHT, Maker

MAKER = Maker()
S = 10**9
UNITS = st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1)
PLACES = st.tuples(*3 * [st.floats(-10, 10)])


def tree(*edges, static=True, at_ns=1):
    made = FrameTree()
    made.add(MAKER.transforms(*edges, at_ns=at_ns), static=static)
    return made


def test_a_camera_that_is_turned_and_raised():
    """The camera 2 m up, its x ahead turned to the room's y."""
    half = math.sqrt(0.5)
    frames = tree(("map", "camera", (1.0, 0.0, 2.0), (0.0, 0.0, half, half)))
    matrix = frames.matrix("map", "/camera", 0)
    # rotation entries are sums of two products near 1: 2 eps each
    np.testing.assert_allclose(matrix @ [3, 0, 0, 1], [1, 3, 2, 1], atol=1e-15)


@given(st.lists(st.tuples(PLACES, UNITS), min_size=2, max_size=5))
def test_there_and_back_is_nowhere(edges):
    unit = [(xyz, tuple(np.array(q) / np.linalg.norm(q))) for xyz, q in edges]
    half = len(unit) // 2
    left = [(f"l{k}" if k else "root", f"l{k + 1}", *e) for k, e in enumerate(unit[:half])]
    right = [(f"r{k}" if k else "root", f"r{k + 1}", *e) for k, e in enumerate(unit[half:])]
    frames = tree(*left, *right)
    a, b = f"l{half}", f"r{len(unit) - half}"
    both = frames.matrix(a, b, 0) @ frames.matrix(b, a, 0)
    # at most 10 products of matrices with entries up to 50, eps 2.2e-16
    np.testing.assert_allclose(both, np.eye(4), atol=1e-11)
    assert frames.root(a) == frames.root(b) == "root"


def test_a_frame_that_is_not_connected_is_named():
    frames = tree(("map", "camera", (0.0, 0.0, 0.0), UPRIGHT))
    with pytest.raises(UnknownFrame, match="no transform connects 'lidar' to 'map'"):
        frames.matrix("map", "lidar", 0)


def test_a_circle_of_frames_places_nothing():
    """A second publisher turns an edge round: which of the two holds cannot be known."""
    frames = tree(("map", "camera", (1.0, 0.0, 0.0), UPRIGHT))
    frames.add(MAKER.transforms(("camera", "map", (50.0, 0.0, 0.0), UPRIGHT)), static=True)
    for target, source in (("map", "camera"), ("camera", "map")):
        with pytest.raises(UnknownFrame, match="form a loop; stop one of their publishers"):
            frames.matrix(target, source, 0)


def test_a_circle_of_frames_ends():
    nothing = (0.0, 0.0, 0.0), UPRIGHT
    frames = tree(("a", "b", *nothing), ("b", "a", *nothing))
    with pytest.raises(UnknownFrame):
        frames.matrix("map", "a", 0)


def moving(*times_and_x):
    frames = FrameTree()
    for at_ns, x in times_and_x:
        edge = ("map", "camera", (x, 0.0, 0.0), UPRIGHT)
        frames.add(MAKER.transforms(edge, at_ns=at_ns), static=False)
    return frames


def test_a_frame_that_moves_is_interpolated_and_never_extrapolated():
    frames = moving((S, 0.0), (S + S // 10, 0.1))
    x = frames.matrix("map", "camera", S + S // 20)[0, 3]
    assert x == pytest.approx(0.05, abs=1e-15)  # one product and one sum below 1
    assert frames.matrix("map", "camera", S + S // 10)[0, 3] == 0.1  # its newest message
    for at_ns in (S - 1, S + S // 10 + 1):
        with pytest.raises(UnknownFrame, match="has no value at the message's stamp"):
            frames.matrix("map", "camera", at_ns)


def test_a_gap_between_transforms_has_no_value():
    frames = moving((S, 0.0), (3 * S, 0.1))
    with pytest.raises(UnknownFrame):
        frames.matrix("map", "camera", 2 * S)


def test_a_frame_that_stands_still_holds_for_half_a_second():
    frames = moving((S, 1.0), (2 * S, 1.0))
    assert frames.matrix("map", "camera", 2 * S + S // 2)[0, 3] == 1.0
    with pytest.raises(UnknownFrame):
        frames.matrix("map", "camera", 2 * S + S // 2 + 1)
    with pytest.raises(UnknownFrame):  # one message says nothing of movement
        moving((S, 1.0)).matrix("map", "camera", S + 1)


def test_a_clock_that_begins_again_forgets_what_was_before():
    frames = moving((100 * S, 1.0), (101 * S, 1.0), (S, 2.0), (2 * S, 2.0))
    assert frames.matrix("map", "camera", 2 * S)[0, 3] == 2.0


@given(st.floats(), st.floats(), st.floats(allow_nan=True))
def test_a_transform_that_is_no_pose_is_counted(x, q, w):
    frames = tree(("map", "camera", (x, 0.0, 0.0), (q, 0.0, 0.0, w)))
    norm = math.hypot(q, w)
    sound = math.isfinite(x) and math.isfinite(norm) and abs(norm - 1) <= 0.01
    assert frames.refused == (not sound)
    if sound:
        assert np.isfinite(frames.matrix("map", "camera", 0)).all()


ONE, OTHER = b"a" * 16, b"b" * 16


def rivals(static, other=OTHER, x=2.0, parent="map"):
    frames = FrameTree()
    for publisher, root, place in ((ONE, "map", 1.0), (other, parent, x)):
        edge = (root, "camera", (place, 0.0, 0.0), UPRIGHT)
        frames.add(MAKER.transforms(edge, at_ns=S), static=static, publisher=publisher)
    return frames


@pytest.mark.parametrize("static", [True, False])
@pytest.mark.parametrize("parent", ["map", "odom"])
def test_two_publishers_of_a_frame_are_both_not_believed(static, parent):
    frames = rivals(static, parent=parent)
    with pytest.raises(UnknownFrame, match="two publishers give the transform of 'camera'"):
        frames.matrix(parent, "camera", S)


def test_two_publishers_of_a_static_frame_who_agree_are_believed():
    assert rivals(True, x=1.0).matrix("map", "camera", S)[0, 3] == 1.0
    assert rivals(True, other=bytes(16)).matrix("map", "camera", S)[0, 3] == 2.0  # not known


def test_a_publisher_that_is_alone_for_a_second_is_believed():
    frames = rivals(False)
    for k in (6, 11, 20):
        edge = ("map", "camera", (3.0, 0.0, 0.0), UPRIGHT)
        moved = MAKER.transforms(edge, at_ns=S + k * S // 10)
        frames.add(moved, static=False, publisher=OTHER)
    with pytest.raises(UnknownFrame):
        frames.matrix("map", "camera", S + 6 * S // 10)
    assert frames.matrix("map", "camera", 3 * S)[0, 3] == 3.0


def test_a_frame_that_moves_by_its_name_does_not_hold():
    frames = moving((S, 1.0), (S + 1, 1.0))
    assert frames.at("map", 2 * S - S // 2).matrix("camera")[0, 3] == 1.0
    with pytest.raises(UnknownFrame) as caught:
        frames.at("map", S + 2, moving="era").matrix("camera")
    assert caught.value.later


@pytest.mark.parametrize(("at_ns", "later"), [(S - 1, False), (S + 1, True), (2 * S, False)])
def test_only_a_value_that_may_still_come_is_said_to_come(at_ns, later):
    with pytest.raises(UnknownFrame) as caught:
        moving((S, 1.0)).matrix("map", "camera", at_ns)
    assert caught.value.later == later


def test_frames_of_people_who_left_make_room_for_others():
    nothing = (0.0, 0.0, 0.0), UPRIGHT
    frames = tree(("map", "camera", *nothing))
    for k in range(2 * MAX_FRAMES):
        frames.add(MAKER.transforms(("camera", f"body_{k}", *nothing), at_ns=k + 1), static=False)
        frames.add(MAKER.transforms((f"body_{k}", f"head_{k}", *nothing)), static=True)
    assert frames.refused == 0
    assert len(frames._edges) <= MAX_FRAMES
    last = 2 * MAX_FRAMES - 1
    np.testing.assert_array_equal(frames.matrix("map", f"head_{last}", last + 1), np.eye(4))
    with pytest.raises(UnknownFrame):
        frames.matrix("map", "head_0", 1)


def test_frames_without_end_are_counted():
    nothing = (0.0, 0.0, 0.0), UPRIGHT
    frames = tree(*(("map", f"f{k}", *nothing) for k in range(MAX_FRAMES + 7)))
    assert frames.refused == 7
