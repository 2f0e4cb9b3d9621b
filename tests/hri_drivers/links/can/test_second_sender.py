"""Two nodes with the same ids on one CAN bus: each link tells the other's frames from its own."""

from typing import Any

import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.wires.transport import pipe
from hri_predict.clock import VirtualClock
from hri_predict.protocol.can import CanFrame
from tests.hri_drivers.links.pairs import advice, robot_state


def two_on_a_bus(clock, **settings):
    """Two links with the same ids, each reading what the other writes."""
    near, far = pipe()  # type: ignore[var-annotated]
    data: dict[str, Any] = {"name": "cell", "interface": "virtual", "channel": "none"} | settings
    return [CanLink(CanLinkSettings(**data), clock, wire) for wire in (near, far)]


@pytest.mark.parametrize("fd", [False, True])
def test_two_nodes_on_one_bus_tell_each_other(fd):
    one, other = two_on_a_bus(VirtualClock(), fd=fd)
    for k in range(5):
        for link in (one, other):
            link.post(advice(k))
            link.post(robot_state(k))
            link.service(k)
    assert one.foreign_ns is not None
    assert other.foreign_ns is not None
    assert {type(r.message).__name__ for r in one.take()} == {"RobotState"}


def test_on_can_the_id_alone_tells_whatever_the_frame_holds():
    link, wire = two_on_a_bus(VirtualClock())
    link.service(0)
    wire._transport.open()
    for k, (number, foreign) in enumerate(((0x03, 0), (0x41, 0), (0x00, 1), (0x40, 2), (0x12, 3))):
        wire._transport.write(CanFrame(0x680 + number, bytes(range(k + 1))))
        link.service(k)
        assert link.counters.foreign == foreign, hex(number)
    wire._transport.write(CanFrame(0x680, bytes(8), extended=True))
    wire._transport.write(CanFrame(0x67F, bytes(8)))
    link.service(9)
    assert link.counters.foreign == 3, "of a controller, or of somebody else"


def test_a_link_that_only_listens_hears_the_productive_node_and_no_second_sender():
    near, far = pipe()  # type: ignore[var-annotated]
    settings: dict[str, Any] = {"name": "cell", "interface": "virtual", "channel": "none"}
    ears = CanLink(CanLinkSettings(**settings, listen_only=True), VirtualClock(), near)
    node = CanLink(CanLinkSettings(**settings), VirtualClock(), far)
    ears.service(0)
    node.post(advice(1))
    node.service(0)
    ears.service(1)
    assert (ears.counters.foreign, ears.counters.unexpected) == (0, 1)
    assert ears.foreign_ns is None


def test_anothers_isotp_segments_are_foreign():
    pytest.importorskip("isotp")
    link, wire = two_on_a_bus(VirtualClock(), isotp={"peer_id": 0x6C7})
    link.service(0)
    wire._transport.open()
    wire._transport.write(CanFrame(0x6C6, b"\x10\x1d" + bytes(6)))
    link.service(3)
    assert (link.counters.foreign, link.foreign_ns) == (1, 3)
