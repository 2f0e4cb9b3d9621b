"""Frames on their topics: protected, and refused on the wrong one."""

from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.ros2.codec import FramesReceiver, Publication, Ros2Codec
from hri_predict.library.conformance.messages import advice, state, status, zone
from hri_predict.protocol.messages import RobotState
from hri_predict.protocol.ros.plain import PlainMessages


def codec() -> Ros2Codec:
    return Ros2Codec(PlainMessages(1.0, "room"), 1e8)


def test_a_frame_goes_to_the_topic_of_its_sender_and_is_refused_on_the_other():
    (from_node,) = codec().encode(status(1))
    (from_controller,) = codec().encode(state(1))
    assert (from_node.topic, from_controller.topic) == ("frames", "controller_frames")
    assert from_controller.plain == ()
    receiver = FramesReceiver()
    assert receiver.feed(Publication(from_controller.data, "frames")) == []
    assert receiver.feed(Publication(from_node.data, "controller_frames")) == []
    assert receiver.counters.malformed == 2
    (from_controller,) = codec().encode(state(2))
    (heard,) = receiver.feed(from_controller)
    assert isinstance(heard, RobotState)


def test_zones_are_plain_alone():
    (publication,) = codec().encode(zone(1))
    assert publication.data == b""
    assert [sample.topic for sample in publication.plain] == ["zones"]
    assert codec().raw(publication) == publication.plain[0].data


@given(st.lists(st.binary(max_size=300)))
def test_any_bytes_are_counted_and_believed_never(pieces):
    receiver = FramesReceiver()
    for piece in pieces:
        assert receiver.feed(Publication(piece)) == []
    c = receiver.counters
    assert c.malformed + c.crc_errors + c.ignored == len(pieces)


def test_its_size_counts_frame_and_plain_messages():
    (publication,) = codec().encode(advice(0, 0.5))
    plain = sum(len(sample.data) for sample in publication.plain)
    assert codec().size(publication) == len(publication.data) + plain
    assert codec().unit_s(publication) * 1e8 > 8 * codec().size(publication)
