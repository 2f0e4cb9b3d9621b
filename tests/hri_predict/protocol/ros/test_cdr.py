"""The serialised messages are those of ROS 2, byte for byte, whatever they hold."""

import math

from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.ros import cdr
from tests.hri_predict.protocol.ros.decoding import decoded

texts = st.text(max_size=40)
stamps = st.integers(-(2**63), 2**63)
floats = st.floats(allow_nan=False)
points = st.lists(st.tuples(floats, floats, floats), max_size=5)


@given(floats, st.integers(-(2**63), 2**63 - 1), st.binary(max_size=99))
def test_numbers_and_bytes(value, whole, content):
    assert decoded(cdr.float64(value), "std_msgs/msg/Float64").data == value
    assert decoded(cdr.int64(whole), "std_msgs/msg/Int64").data == whole
    array = decoded(cdr.byte_array(content), "std_msgs/msg/UInt8MultiArray")
    assert (bytes(array.data), array.layout.dim) == (content, [])


@given(st.text(st.characters(exclude_categories=[]), max_size=40))
def test_text_with_any_character_is_one_string(text):
    got = decoded(cdr.string(text), "std_msgs/msg/String").data
    assert len(got) == len(text)
    assert "\0" not in got


@given(stamps, texts.filter(lambda text: "\0" not in text), points)
def test_pose_arrays(stamp_ns, frame, places):
    got = decoded(cdr.pose_array(stamp_ns, frame, places), "geometry_msgs/msg/PoseArray")
    assert got.header.frame_id == frame
    assert [(p.position.x, p.position.y, p.position.z) for p in got.poses] == places
    assert all(p.orientation.w == 1.0 for p in got.poses)
    assert 0 <= got.header.stamp.nanosec < 10**9
    if 0 <= stamp_ns < 2**31 * 10**9 - 10**9:
        assert got.header.stamp.sec * 10**9 + got.header.stamp.nanosec == stamp_ns


@given(st.integers(0, 3), texts, texts, st.dictionaries(texts, texts, max_size=4))
def test_diagnostics(level, name, message, values):
    data = cdr.diagnostic_array(5, name=name, level=level, message=message, values=values)
    (status,) = decoded(data, "diagnostic_msgs/msg/DiagnosticArray").status
    assert status.level == level
    assert len(status.values) == len(values)
    assert status.name == name.replace("\0", " ")


def test_positions_that_are_not_known_are_not_numbers():
    (pose,) = decoded(
        cdr.pose_array(0, "room", [(math.nan,) * 3]), "geometry_msgs/msg/PoseArray"
    ).poses
    assert math.isnan(pose.position.x)
