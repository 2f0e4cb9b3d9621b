"""How every link behaves when its device is absent, busy, unplugged or mad."""

import itertools
import threading
from typing import Any

import pytest

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.transport import PipeEnd, TransportBusy, pipe
from hri_predict.base.clock import MonotonicClock, VirtualClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import (
    Advice,
    Level,
    NodeState,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from tests.messages import make_state
from tests.waiting import eventually

STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=7)


def advice(latch_id: int) -> Advice:
    return Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR, latch_id=latch_id)


def zone() -> Zone:
    return Zone(person=0, step=0, horizon_s=0.0, capsules=())


def byte_pipe() -> tuple[PipeEnd[bytes], PipeEnd[bytes]]:
    return pipe()


class Unreliable:
    """A transport that fails as told; deterministic."""

    def __init__(self) -> None:
        self.absent = self.busy = self.broken = False
        self.opens = 0
        self.written: list[bytes] = []
        self.closed = threading.Event()

    def open(self) -> None:
        self.opens += 1
        if self.absent:
            raise LinkError("port is not there")
        self.closed.clear()

    def write(self, unit: bytes) -> None:
        if self.busy:
            raise TransportBusy("queue is full")
        if self.broken:
            raise LinkError("unplugged")
        self.written.append(unit)

    def read(self, timeout_s: float) -> list[bytes]:
        if self.broken:
            raise LinkError("unplugged")
        self.closed.wait(timeout_s)
        return []

    def close(self) -> None:
        self.closed.set()


def heard(transport: Unreliable) -> list[Any]:
    receiver = SerialReceiver()
    return [m for unit in transport.written for m in receiver.feed(unit)]


def on(transport: Unreliable, clock: Any, **more: Any) -> SerialLink:
    settings = SerialLinkSettings(name="cell", port="x", baudrate=921_600, **more)
    return SerialLink(settings, clock, transport)


def test_a_simulated_controller_that_does_not_read_gets_no_remedy_for_cables():
    transport, clock = Unreliable(), VirtualClock(0)
    transport.busy = True
    link = on(transport, clock, simulate={})
    link.post(STATUS)
    link.service(0)
    assert "this machine is too slow" in (link.last_error or "")


def test_an_absent_device_is_an_error_at_start():
    transport = Unreliable()
    transport.absent = True
    link = on(transport, MonotonicClock())
    with pytest.raises(LinkError, match="link 'cell': port is not there"):
        link.start()
    link.stop()


def test_an_absent_device_may_be_waited_for():
    transport = Unreliable()
    transport.absent = True
    link = on(transport, MonotonicClock(), wait_for_device=True)
    link.start()
    assert not link.connected
    link.post(STATUS)
    transport.absent = False
    eventually(lambda: heard(transport))
    assert link.connected
    link.stop()


def test_it_tries_again_less_and_less_often():
    clock, transport = VirtualClock(), Unreliable()
    transport.absent = True
    link = on(transport, clock)
    tries = []
    for ms in range(0, 10_000, 10):
        before = transport.opens
        link.service(ms * 1_000_000)
        if transport.opens > before:
            tries.append(ms)
    gaps = [b - a for a, b in itertools.pairwise(tries)]
    assert gaps == [50, 100, 200, 400, 800, 1600, 2000, 2000, 2000]
    assert link.last_error == "port is not there"


def test_a_full_queue_keeps_the_newest_and_never_a_backlog():
    clock, transport = VirtualClock(), Unreliable()
    link = on(transport, clock)
    link.service(0)
    transport.busy = True
    for cycle in range(1, 11):
        link.post(advice(cycle))
        link.service(cycle * 40_000_000)
        assert len(link._slots) == 1
    assert link.connected
    assert link.counters.write_errors == 10
    assert link.counters.superseded == 9
    transport.busy = False
    link.service(440_000_000)
    assert [m.latch_id for m in heard(transport)] == [10]
    assert link.last_error == "queue is full"


def test_a_queue_that_stays_full_gets_the_device_reopened():
    clock, transport = VirtualClock(), Unreliable()
    link = on(transport, clock)
    link.service(0)
    transport.busy = True
    for ms in range(0, 1200, 10):
        link.post(advice(1))
        link.service(ms * 1_000_000)
    assert link.counters.disconnects == 1
    assert link.counters.reconnects == 1


def test_an_unplugged_device_is_reopened_and_gets_the_newest():
    transport = Unreliable()
    link = on(transport, MonotonicClock())
    link.start()
    link.post(advice(1))
    eventually(lambda: transport.written)
    transport.absent = transport.broken = True
    eventually(lambda: not link.connected)
    link.post(advice(2))
    link.post(advice(3))
    transport.absent = transport.broken = False
    eventually(lambda: link.connected and len(transport.written) > 1)
    assert [m.latch_id for m in heard(transport)] == [1, 3]
    assert link.counters.reconnects == link.counters.disconnects == 1
    link.stop()


def test_after_a_reconnection_nothing_old_is_echoed():
    clock, (near, far) = VirtualClock(), byte_pipe()
    link = SerialLink(SerialLinkSettings(name="cell", port="x", baudrate=921_600), clock, near)
    far.open()
    link.service(0)
    far.write(SerialSender().encode(make_state((0.0,), counter=9)))
    link.post(advice(1))
    link.service(0)
    near.close()  # unplugged
    link.service(1)
    assert not link.connected
    link.post(advice(2))
    link.service(100_000_000)
    receiver = SerialReceiver()
    heard: list[Any] = [m for unit in far.read(0.0) for m in receiver.feed(unit)]
    assert [(m.latch_id, m.echo) for m in heard] == [(1, 9), (2, None)]


def test_a_bug_in_a_driver_does_not_end_the_thread():
    transport: Any = Unreliable()
    link = on(transport, MonotonicClock())
    link.start()
    good = transport.write

    def buggy(unit: bytes) -> None:
        raise RuntimeError("driver lost its mind")

    transport.write = buggy
    link.post(STATUS)
    eventually(lambda: link.counters.disconnects)
    assert link.last_error == "driver lost its mind"
    transport.write = good
    link.post(STATUS)
    eventually(lambda: heard(transport))
    link.stop()


def test_what_a_stopped_link_could_not_say_is_counted():
    transport = Unreliable()
    link = on(transport, MonotonicClock())
    link.start()
    transport.busy = True
    for message in (STATUS, advice(1), zone()):
        link.post(message)
    eventually(lambda: link.counters.write_errors)
    link.stop()
    assert transport.written == []
    assert link.counters.write_errors >= 3  # at least one refusal, and two never written
    assert link.counters.decimated == 1
    assert len(link._slots) == 0
