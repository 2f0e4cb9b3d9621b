"""What only CAN does: python-can's interfaces, slcan over real pseudo-terminals, the DBC."""

import errno
import fcntl
import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import can
import pytest

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import GARBAGE_LIMIT, CanTransport
from hri_drivers.wires.transport import TransportBusy
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.can import CanFrame, CanReceiver, CanSender
from hri_predict.protocol.messages import Acknowledge
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.hri_drivers.links.pairs import advice, more
from tests.namespaces import in_namespace, why_not
from tests.processes import python
from tests.waiting import eventually

TALK = Path(__file__).with_name("dbc_talk.py")
FAST = {"sleep_after_open": 0}


class Controller:
    """An adapter and what it hears, in a thread."""

    def __init__(self) -> None:
        master, self.path = open_pty()
        self.adapter = SlcanAdapter(master)
        self.adapter.open()
        self.heard: list[Any] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        receiver = CanReceiver()
        while not self._stop.is_set():
            for frame in self.adapter.read(0.05):
                self.heard += receiver.feed(frame)

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.adapter.close()


def agreed(done: "subprocess.CompletedProcess[str]") -> None:
    """Fail unless the listener heard all that was sent, and the node all that was answered."""
    assert done.returncode == 0, done.stderr
    outcome = json.loads(done.stdout)
    assert outcome["wrong"] == []
    assert outcome["status"] == 0
    assert outcome["compared"] > 1000
    assert outcome["counters"]["messages_sent"] == outcome["sent"]
    assert outcome["states"] == list(range(len(outcome["states"])))
    assert len(outcome["states"]) > 30
    errors = ("crc_errors", "counter_errors", "malformed", "incomplete", "write_errors")
    assert not any(outcome["counters"][name] for name in errors)


@pytest.mark.realtime
@pytest.mark.parametrize("fd", [[], ["fd"]], ids=["classic", "fd"])
def test_cantools_in_another_process_decodes_what_the_node_sent(fd):
    """Slcan over a pseudo-terminal, both ways, random messages, the shipped DBC."""
    agreed(python(TALK, "node", "slcan", *fd, timeout=120))


@pytest.mark.realtime
@pytest.mark.long
def test_cantools_in_another_process_decodes_fd_frames_over_udp_multicast():
    if reason := why_not():
        pytest.skip(reason)
    pytest.importorskip("msgpack", reason="python-can's udp_multicast needs msgpack")
    agreed(in_namespace(f"exec {sys.executable} {TALK} node udp_multicast fd", 120))


def test_an_adapter_unplugged_and_plugged_in_again(tmp_path: Path):
    name = tmp_path / "ttyCan"
    first = Controller()
    name.symlink_to(first.path)
    settings = CanLinkSettings(name="cell", interface="slcan", channel=str(name), options=FAST)
    link = CanLink(settings, MonotonicClock())
    link.start()
    eventually(lambda: first.adapter.channel_open)
    link.post(advice(1))
    eventually(lambda: first.heard)
    descriptors = len(os.listdir("/proc/self/fd")) if Path("/proc/self/fd").exists() else 0

    first.close()
    name.unlink()
    link.post(advice(2))
    eventually(lambda: not link.connected)
    link.post(advice(3))
    second = Controller()
    name.symlink_to(second.path)
    eventually(lambda: second.heard)
    assert [m.latch_id for m in second.heard][-1] == 3
    assert link.counters.disconnects == link.counters.reconnects == 1
    if descriptors:  # the dead port was closed too
        assert len(os.listdir("/proc/self/fd")) <= descriptors
    for frame in CanSender().encode(Acknowledge(3, 1)):
        second.adapter.write(frame)
    received: list[Any] = []
    eventually(lambda: more(received, link.take()))
    assert received[0].message == Acknowledge(3, 1)
    link.stop()
    second.close()


def test_an_adapter_serves_one_program_alone():
    controller = Controller()
    first = CanTransport(interface="slcan", channel=controller.path, options=FAST)
    first.open()
    with pytest.raises(LinkError, match="in use by another program"):
        CanTransport(interface="slcan", channel=controller.path, options=FAST).open()
    first.close()
    controller.close()


def test_other_trouble_with_the_lock_is_not_called_another_program(monkeypatch):
    controller = Controller()

    def no_lock(_descriptor, _operation):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", no_lock)
    with pytest.raises(LinkError, match="No locks available"):
        CanTransport(interface="slcan", channel=controller.path, options=FAST).open()
    controller.close()


@pytest.mark.parametrize(
    "garbage",
    [
        b"\xff\xfe\xfd\r",
        b"tXYZ0\r",
        b"t1238\r",
        b"t12\r",
        b"T\r",
        b"\r\a\r",
        b"b123F00\r",
        b"t123900\r",
    ],
)
def test_garbage_from_an_adapter_is_counted_and_survived(garbage):
    master, path = open_pty()
    transport = CanTransport(interface="slcan", channel=path, options=FAST)
    transport.open()
    os.write(master, garbage)
    frames: list[CanFrame] = []
    for _ in range(5):
        frames += transport.read(0.05)
    os.write(master, b"t1232ABCD\r")
    good = CanFrame(0x123, b"\xab\xcd")
    eventually(lambda: good in more(frames, transport.read(0.05)))
    transport.close()
    os.close(master)


def test_only_garbage_gets_the_interface_reopened(monkeypatch):
    transport = CanTransport(interface="virtual", channel="garbage-only")
    transport.open()

    def garbage(timeout: float) -> None:
        raise ValueError("not a frame")

    assert transport._bus is not None
    monkeypatch.setattr(transport._bus, "recv", garbage)
    for _ in range(GARBAGE_LIMIT):
        assert transport.read(0.0) == []
    with pytest.raises(LinkError, match="lost"):
        transport.read(0.0)
    assert transport.malformed == GARBAGE_LIMIT + 1
    transport.close()


@pytest.mark.parametrize(
    ("error", "busy"),
    [
        (can.CanOperationError("Failed to transmit: No buffer space available", 105), True),
        (can.CanOperationError("Transmit buffer full"), True),
        (can.CanTimeoutError("timed out"), True),
        (can.CanOperationError("Failed to transmit: Network is down", 100), False),
    ],
)
def test_a_full_transmit_queue_means_not_now_and_another_error_lost(monkeypatch, error, busy):
    transport = CanTransport(interface="virtual", channel="full")
    transport.open()

    def fails(message: Any, timeout: Any = None) -> None:
        raise error

    assert transport._bus is not None
    monkeypatch.setattr(transport._bus, "send", fails)
    with pytest.raises(LinkError, match="transmit queue full" if busy else "lost") as caught:
        transport.write(CanFrame(1, b""))
    assert isinstance(caught.value, TransportBusy) is busy
    transport.close()


def test_error_frames_are_counted_and_remote_frames_ignored():
    transport = CanTransport(interface="virtual", channel="errors")
    transport.open()
    other = can.Bus(interface="virtual", channel="errors", ignore_config=True)
    other.send(can.Message(is_error_frame=True))
    other.send(can.Message(arbitration_id=0x680, is_remote_frame=True, is_extended_id=False))
    other.send(can.Message(arbitration_id=0x680, data=b"\x01", is_extended_id=False))
    frames: list[CanFrame] = []
    eventually(lambda: more(frames, transport.read(0.05)))
    assert frames == [CanFrame(0x680, b"\x01")]
    assert transport.health.frames == 1
    transport.close()
    other.shutdown()


@pytest.mark.parametrize(
    ("interface", "channel", "bitrate", "words"),
    [
        ("socketcn", "can0", 500_000, "did you mean 'socketcan'"),
        ("slcan", "/dev/no_such_adapter", 500_000, "not found; plug it in or correct 'channel'"),
        ("slcan", "PTY", 123_456, "bitrate"),
        ("udp_multicast", "10.0.0.1", 500_000, "cannot be opened"),
        ("socketcan", "no_such_can", 500_000, "CAN interface socketcan, channel no_such_can: "),
    ],
)
def test_an_interface_that_does_not_open_gets_one_line(interface, channel, bitrate, words):
    master, path = open_pty()
    transport = CanTransport(
        interface=interface,
        channel=path if channel == "PTY" else channel,
        bitrate=bitrate,
        options=FAST if interface == "slcan" else None,
    )
    with pytest.raises(LinkError) as caught:
        transport.open()
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)
    os.close(master)


def test_what_waited_before_the_port_was_opened_is_not_fresh():
    master, slave = open_pty()
    transport = CanTransport(interface="slcan", channel=slave, options={"sleep_after_open": 0})
    try:
        os.write(master, b"t12381122334455667788\r" * 20)
        transport.open()
        assert transport.read(0.2) == []
        os.write(master, b"t12381122334455667788\r")
        assert [frame.arbitration_id for frame in transport.read(5.0)] == [0x123]
    finally:
        transport.close()
        os.close(master)
