"""A serial line that is unplugged, disturbed or not read, and what is lost by it."""

import contextlib
import os
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.serial import SerialTransport
from hri_drivers.wires.usb_ports import UsbDevice
from hri_predict.base.clock import MonotonicClock
from hri_predict.protocol.messages import Schema
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.wires.pty import PtyTransport, open_pty
from tests.hri_drivers.links.pairs import advice
from tests.waiting import eventually


class Adapter:
    """A USB adapter with a controller behind it, as ``list_ports`` shows it."""

    def __init__(self, serial_number: str) -> None:
        self.vid: int | None = 0x0403
        self.pid: int | None = 0x6001
        self.location: str | None = "1-1"
        self.serial_number: str | None = serial_number
        master, self.device = open_pty()
        self.wire = PtyTransport(master)
        self.wire.open()
        self.receiver = SerialReceiver()
        self.heard: list[Any] = []

    def listen(self) -> list[Any]:
        for chunk in self.wire.read(0.02):
            self.heard += self.receiver.feed(chunk)
        return self.heard


def test_an_adapter_that_comes_back_under_another_name_is_found():
    usb = UsbDevice(vid=0x0403, pid=0x6001, serial_number="A5")
    link_settings = SerialLinkSettings(name="drive", usb=usb)
    assert SerialLink.make_transport(link_settings).port == usb
    first, other = Adapter("A5"), Adapter("A6")
    plugged = [first, other]
    transport = SerialTransport(usb, 115_200, comports=lambda: plugged)
    link = SerialLink(link_settings, MonotonicClock(), transport)
    link.start()
    link.post(advice(1))
    eventually(first.listen)

    plugged.remove(first)
    first.wire.close()
    eventually(lambda: not link.connected)
    eventually(lambda: "not found" in str(link.last_error))
    assert "\n" not in str(link.last_error)
    assert f"{other.device} is 0403:6001 serial_number 'A6'" in str(link.last_error)
    link.post(advice(2))

    taken = Adapter("x")  # so that the name is another one, even where the system gives it again
    second = Adapter("A5")
    plugged.append(second)
    eventually(second.listen)
    assert second.device != other.device
    assert [m.latch_id for m in second.heard] == [2]
    assert link.connected
    assert link.counters.disconnects == link.counters.reconnects == 1
    assert other.listen() == []
    link.stop()
    for adapter in (other, taken, second):
        adapter.wire.close()


BURSTS = st.lists(
    st.binary(max_size=120) | st.lists(st.just(0xFF), max_size=120).map(bytes), max_size=12
)


def frames(count: int) -> list[bytes]:
    """Schemas, which are judged by their CRC alone: what is lost is lost to the garbage."""
    sender = SerialSender()
    return [sender.encode(Schema(1, n)) for n in range(count)]


def fed(stream: bytes, sizes: list[int]) -> list[int]:
    """Hashes of the schemas in ``stream``, which comes in pieces of these sizes."""
    receiver, heard = SerialReceiver(), []
    for size in [*sizes, len(stream)]:
        heard += [m.hash for m in receiver.feed(stream[:size]) if isinstance(m, Schema)]
        stream = stream[size:]
    return heard


@given(BURSTS, st.lists(st.integers(1, 90), max_size=30))
def test_garbage_costs_the_frame_that_it_touches_and_no_other(bursts, sizes):
    """Only a frame that follows garbage without a delimiter in between is lost."""
    whole = frames(len(bursts))
    stream = b"".join(garbage + frame for garbage, frame in zip(bursts, whole, strict=True))
    untouched = [n for n, garbage in enumerate(bursts) if garbage.endswith(b"\0") or not garbage]
    assert fed(stream, sizes) == untouched


@given(BURSTS, st.lists(st.integers(1, 90), max_size=30))
def test_behind_a_leading_delimiter_no_frame_is_lost_to_garbage(bursts, sizes):
    whole = frames(len(bursts))
    stream = b"".join(noise + b"\0" + frame for noise, frame in zip(bursts, whole, strict=True))
    assert fed(stream, sizes) == list(range(len(bursts)))


def test_the_first_frame_after_every_opening_is_heard_whatever_came_before():
    controller = Adapter("A5")
    controller.receiver.feed(b"\x13 noise of plugging in")
    link = SerialLink(SerialLinkSettings(name="cell", port=controller.device), MonotonicClock())
    link.start()
    link.post(advice(1))
    eventually(controller.listen)
    assert [m.latch_id for m in controller.heard] == [1]
    link.stop()
    controller.wire.close()


def fill(device: str) -> None:
    """Write until the other side's buffer is full, as a dead controller's is."""
    descriptor = os.open(device, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
    with contextlib.suppress(BlockingIOError):
        while True:
            os.write(descriptor, b"x" * 256)
    os.close(descriptor)


@pytest.mark.realtime
def test_a_controller_that_does_not_read_is_told_counted_and_gets_the_newest():
    controller = Adapter("A5")
    fill(controller.device)
    link = SerialLink(
        SerialLinkSettings(name="cell", port=controller.device, baudrate=921_600), MonotonicClock()
    )
    link.start()
    posted = 0

    def post() -> None:
        nonlocal posted
        posted += 1
        link.post(advice(posted))

    def full() -> bool:
        post()
        return link.counters.write_errors > 0

    eventually(full)
    assert "longer than 50 ms; check that the other end reads" in str(link.last_error)
    for _ in range(20):
        post()
        assert len(link._slots) <= 1  # no queue grows
    eventually(lambda: link.counters.reconnects)  # busy for a second: opened again
    assert link.counters.disconnects >= 1

    def hears_what_comes_now() -> bool:  # after so many lost, three in a row make it fresh again
        post()
        return bool(controller.listen()) and controller.heard[-1].latch_id > after

    after = posted
    eventually(hears_what_comes_now)
    eventually(lambda: controller.listen()[-1].latch_id == posted)
    heard = [m.latch_id for m in controller.heard]
    assert heard == sorted(heard)
    eventually(lambda: len(link._slots) == 0)
    counters = link.counters
    assert counters.messages_sent + counters.superseded == posted
    link.stop()
    controller.wire.close()
