"""What only a serial line does, over real pseudo-terminals."""

import contextlib
import os
import subprocess
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.serial import SerialTransport
from hri_drivers.wires.transport import TransportBusy
from hri_drivers.wires.usb_ports import UsbDevice
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.protocol.messages import Acknowledge, Schema
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.wires.pty import PtyTransport, open_pty
from tests.hri_drivers.links.pairs import advice, more
from tests.waiting import eventually


def link_on(port: str) -> SerialLink:
    return SerialLink(SerialLinkSettings(name="cell", port=port), MonotonicClock())


def more_from(into: list[Any], link: SerialLink) -> list[Any]:
    return more(into, link.take())


class Controller:
    def __init__(self) -> None:
        master, self.path = open_pty()
        self.wire = PtyTransport(master)
        self.wire.open()
        self.receiver = SerialReceiver()
        self.heard: list[Any] = []

    def listen(self) -> list[Any]:
        for chunk in self.wire.read(0.02):
            self.heard += self.receiver.feed(chunk)
        return self.heard


def test_unplugged_and_plugged_in_again_behind_the_same_name(tmp_path: Path):
    name = tmp_path / "ttyCell"
    first = Controller()
    name.symlink_to(first.path)
    link = link_on(str(name))
    link.start()
    link.post(advice(1))
    eventually(first.listen)

    first.wire.close()
    name.unlink()
    link.post(advice(2))
    eventually(lambda: not link.connected)
    assert "lost" in str(link.last_error) or "not found" in str(link.last_error)
    link.post(advice(3))

    second = Controller()
    name.symlink_to(second.path)
    eventually(second.listen)
    assert [m.latch_id for m in second.heard] == [3]
    assert link.connected
    assert link.counters.disconnects == link.counters.reconnects == 1
    second.wire.write(SerialSender().encode(Acknowledge(3, 1)))
    received: list[Any] = []
    eventually(lambda: more(received, link.take()))
    assert received[0].message == Acknowledge(3, 1)
    link.stop()
    second.wire.close()


def test_noise_on_the_line_costs_only_what_it_touches():
    controller = Controller()
    link = link_on(controller.path)
    link.start()
    sender = SerialSender()
    good, bad = sender.encode(Acknowledge(1, 1)), bytearray(sender.encode(Acknowledge(2, 2)))
    bad[8] ^= 0x10
    controller.wire.write(b"\xff\x13 noise \0" + good + bytes(bad))
    controller.wire.write(sender.encode(Acknowledge(3, 3)))
    received: list[Any] = []
    eventually(lambda: len(more(received, link.take())) == 2)
    assert [r.message.ack_id for r in received] == [1, 3]
    counters = link.counters
    assert counters.crc_errors + counters.malformed == 2
    assert link.connected
    link.stop()
    controller.wire.close()


def test_a_port_serves_one_program_alone():
    controller = Controller()
    first = SerialTransport(controller.path, 115_200)
    first.open()
    with pytest.raises(LinkError, match="in use by another program"):
        SerialTransport(controller.path, 115_200).open()
    first.close()
    again = SerialTransport(controller.path, 115_200)
    again.open()
    again.close()
    controller.wire.close()


def test_a_controller_that_does_not_read_makes_the_port_busy_not_stuck():
    controller = Controller()
    transport = SerialTransport(controller.path, 115_200)
    transport.open()
    flood = b"".join(SerialSender().encode(advice(n)) for n in range(50))

    def fill() -> None:
        for _ in range(5000):
            transport.write(flood)

    with pytest.raises(TransportBusy):
        fill()
    while controller.wire.read(0.05):
        pass
    transport.write(b"again")
    assert b"".join(controller.wire.read(5.0)).endswith(b"again")
    transport.close()
    controller.wire.close()


class Stuck:
    """A pyserial port that takes ten bytes, then no more until it is freed."""

    def __init__(self) -> None:
        self.taken = b""
        self.out_waiting = 0
        self.stuck = True

    def write(self, data: bytes) -> None:
        self.taken += data[:10] if self.stuck else data
        if self.stuck:
            raise serial.SerialTimeoutException("Write timeout")

    def close(self) -> None:
        pass


def test_a_message_that_was_cut_short_costs_no_other():
    transport, port = SerialTransport("x", 115_200), Stuck()
    transport._serial = port
    sender = SerialSender()
    with pytest.raises(TransportBusy, match="longer than 50 ms"):
        transport.write(sender.encode(advice(1)))
    port.stuck = False
    transport.write(sender.encode(advice(2)))
    transport.write(sender.encode(advice(3)))
    heard: list[Any] = list(SerialReceiver().feed(port.taken))
    assert [m.latch_id for m in heard] == [2, 3]


def test_an_output_buffer_that_has_become_a_queue_takes_no_more():
    transport, port = SerialTransport("x", 115_200), Stuck()
    transport._serial, port.stuck, port.out_waiting = port, False, 600
    with pytest.raises(TransportBusy, match="does not drain"):
        transport.write(b"late")
    assert port.taken == b""
    port.out_waiting = 500  # 43 ms at 115200
    transport.write(b"fine")
    assert port.taken == b"fine"


CHILD = """
import os, sys
from hri_predict.protocol.messages import Acknowledge, Advice
from hri_predict.protocol.serial import SerialReceiver, SerialSender
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
receiver, sender = SerialReceiver(), SerialSender()
print("ready", flush=True)
while True:
    for message in receiver.feed(os.read(port, 4096)):
        if isinstance(message, Advice):
            os.write(port, sender.encode(Acknowledge(message.latch_id, message.latch_id + 1)))
"""


@pytest.mark.realtime
def test_a_controller_in_another_process_answers_every_advice():
    master, path = open_pty()
    child = subprocess.Popen([sys.executable, "-c", CHILD, path], stdout=subprocess.PIPE, text=True)
    try:
        assert child.stdout
        assert child.stdout.readline() == "ready\n"
        settings = SerialLinkSettings(name="cell", port=path)
        link = SerialLink(settings, MonotonicClock(), PtyTransport(master))
        link.start()
        for latch_id in range(1, 31):
            link.post(advice(latch_id))
            received: list[Any] = []
            eventually(partial(more_from, received, link))
            assert received[0].message == Acknowledge(latch_id, latch_id + 1)
        link.stop()
    finally:
        child.kill()
        child.wait()


def test_two_links_on_one_port_are_refused():
    def link(name: str, **more: Any) -> SerialLinkSettings:
        return SerialLinkSettings.model_validate({"name": name, "port": "/dev/ttyUSB0"} | more)

    with pytest.raises(ConfigError, match="'a' and 'b' both use /dev/ttyUSB0"):
        SerialLink.check_together([link("a"), link("b")])
    fine = [link("a"), link("b", port="/dev/ttyUSB1"), link("c", simulate={})]
    SerialLink.check_together(fine)


def test_closing_twice_and_stopping_unstarted_is_fine():
    controller = Controller()
    link = link_on(controller.path)
    link.stop()
    link.start()
    link.stop()
    link.stop()
    controller.wire.close()


class Adapter(Controller):
    """A USB adapter with a controller behind it, as ``list_ports`` shows it."""

    def __init__(self, serial_number: str) -> None:
        super().__init__()
        self.device = self.path
        self.vid: int | None = 0x0403
        self.pid: int | None = 0x6001
        self.location: str | None = "1-1"
        self.serial_number: str | None = serial_number


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
    counters = link.counters  # the last one was on the wire before it was counted
    eventually(lambda: counters.messages_sent + counters.superseded == posted)
    link.stop()
    controller.wire.close()
