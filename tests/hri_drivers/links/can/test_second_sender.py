"""Two nodes with the same ids on one CAN bus: each link tells the other's frames from its own."""

from dataclasses import replace
from queue import Queue
from typing import Any

import pytest
from can.interfaces.slcan import slcanBus

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.can import CanFrame, CanSender
from hri_predict.protocol.messages import NodeState, Status
from hri_predict.protocol.profile4 import Profile4Sender
from hri_predict.protocol.reasons import Reason
from tests.hri_drivers.links.can.test_isotp import segments, zone
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


def status(cycle):
    state, reason = NodeState.RUNNING, Reason.NONE
    return Status(node_state=state, reason=reason, people=0, predictor=0, cycle=cycle)


def frames_of(*messages, fd=False):
    sender = CanSender(fd)
    return [frame for message in messages for frame in sender.encode(message)]


def test_a_second_sender_is_found_in_its_first_cycle():
    link, wire = two_on_a_bus(VirtualClock())
    link.service(0)
    wire._transport.open()
    for frame in frames_of(status(1), advice(1)):
        wire._transport.write(frame)
    link.service(7)
    assert link.foreign_ns == 7


def test_a_classic_node_on_an_fd_bus_is_a_second_sender():
    link, wire = two_on_a_bus(VirtualClock(), fd=True)
    link.service(0)
    wire._transport.open()
    for frame in frames_of(status(1), status(2)):
        wire._transport.write(frame)
    link.service(7)
    assert link.foreign_ns == 7


@pytest.mark.parametrize("fd", [False, True])
def test_damaged_frames_with_the_nodes_ids_are_counted_and_prove_nothing(fd):
    link, wire = two_on_a_bus(VirtualClock(), fd=fd)
    link.service(0)
    wire._transport.open()
    for k, frame in enumerate(frames_of(*(status(k) for k in range(20)), fd=fd)):
        wire._transport.write(replace(frame, data=bytes([frame.data[0] ^ 1]) + frame.data[1:]))
        wire._transport.write(replace(frame, data=frame.data[:-1]))
        link.service(k)
    assert (link.counters.foreign, link.foreign_ns) == (0, None)
    assert link.counters.crc_errors + link.counters.malformed == 40


def test_a_lost_character_on_an_slcan_line_does_not_stop_the_robots():
    """Each character of each line of a RobotState is lost once, ten frames a second."""
    link, wire = two_on_a_bus(VirtualClock())
    link.service(0)
    wire._transport.open()
    now_ns = 0
    for k, frame in enumerate(frames_of(*(robot_state(k) for k in range(8)))):
        line = f"t{frame.arbitration_id:03X}{len(frame.data)}{frame.data.hex().upper()}"
        for lost in range(1, len(line)):
            damaged = _read(line[:lost] + line[lost + 1 :] + "\r")
            if damaged is not None:
                wire._transport.write(damaged)
            now_ns += 100_000_000
            link.service(now_ns)
            assert link.foreign_ns is None, (k, line, lost)


def _read(line):
    """The frame that python-can's slcan makes of a line; ``None`` if it makes none."""
    bus = slcanBus.__new__(slcanBus)
    bus._queue = Queue()  # type: ignore[assignment]
    bus._read = lambda timeout: line  # type: ignore[method-assign]
    try:
        message, _ = bus._recv_internal(0.0)
    except (ValueError, IndexError):
        return None
    if message is None:
        return None
    return CanFrame(message.arbitration_id, bytes(message.data))


@pytest.mark.parametrize("fd", [False, True])
def test_frames_of_others_are_not_judged(fd):
    link, wire = two_on_a_bus(VirtualClock(), fd=fd)
    link.service(0)
    wire._transport.open()
    (frame, *_) = frames_of(status(1), fd=fd)
    for k in range(3):
        wire._transport.write(replace(frame, extended=True))
        wire._transport.write(replace(frame, arbitration_id=0x67F))
        link.service(k)
    assert (link.counters.foreign, link.counters.ignored) == (0, 6)


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


def test_anothers_whole_isotp_messages_are_foreign_and_a_segment_alone_is_not():
    pytest.importorskip("isotp")
    link, wire = two_on_a_bus(VirtualClock(), isotp={"peer_id": 0x6C7})
    link.service(0)
    wire._transport.open()
    for k in range(5):
        wire._transport.write(CanFrame(0x6C6, b"\x10\x1d" + bytes(6)))
        link.service(k)
    assert (link.counters.foreign, link.foreign_ns) == (0, None)
    sender = Profile4Sender(255)
    for frame in segments(zone(), sender) + segments(zone(), sender):
        wire._transport.write(frame)
    link.service(9)
    assert (link.counters.foreign, link.foreign_ns) == (2, 9)
