"""The other processes of ``heard``: a receiver at the end of a wire, and a bare loop.

The bare loop only sleeps until an absolute deadline and writes a byte into a pipe. The receiver
records the arrival of the node's messages and of the bare loop's bytes in the same way, so that
both include its own lateness.
"""

import gc
import os
import select
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any, Protocol

import can

from hri_predict.protocol.can import CanFrame, CanReceiver
from hri_predict.protocol.messages import Advice, NodeState, Status
from hri_predict.protocol.serial import SerialReceiver
from hri_sim.wires.ports import free_udp_port
from hri_sim.wires.pty import PtyTransport, open_pty
from hri_sim.wires.slcan_adapter import SlcanAdapter

PRIORITY = 10
MULTICAST = "239.74.163.3"
LINK = {"name": "bench", "repeat_hz": 0}
"""Settings of each measured link: one message per tick, so message intervals are tick intervals."""
Stamped = tuple[int, Any]
"""Arrival time (nanoseconds of the monotonic clock) and a unit for the decoder."""


class Ear(Protocol):
    """One end of a wire.

    Attributes:
        link: entry of ``links:`` for the node at the other end.
        stamps: the clock that stamps arrivals.
        receiver: decoder of the units.
    """

    link: dict[str, Any]
    stamps: str
    receiver: Any

    def fileno(self) -> int:
        """Return the file descriptor to wait for."""

    def take(self) -> list[Stamped]:
        """Return the arrivals so far, without waiting."""

    def close(self) -> None:
        """Disconnect from the wire."""


class PtyEar:
    """The other side of a serial line, or a CAN adapter on one; each read is stamped on return.

    Args:
        link: entry of ``links:``, except for the line's path.
        key: the entry's key for that path.
        transport: reads from the line.
        receiver: decoder of the units read.
    """

    stamps = "receiver's clock after a blocking read"

    def __init__(
        self, link: dict[str, Any], key: str, transport: Callable[[int], Any], receiver: Any
    ) -> None:
        self._fd, path = open_pty()
        # without it reading fails until the node has opened the line
        self._held = os.open(path, os.O_RDWR | os.O_NOCTTY)
        self.link = LINK | link | {key: path}
        self.receiver = receiver
        self._transport = transport(self._fd)
        self._transport.open()

    def fileno(self) -> int:
        """The descriptor."""
        return self._fd

    def take(self) -> list[Stamped]:
        """Return the bytes, or frames, that have arrived."""
        units = self._transport.read(0.0)
        now_ns = time.monotonic_ns()
        return [(now_ns, unit) for unit in units]

    def close(self) -> None:
        """Close both sides."""
        self._transport.close()
        os.close(self._held)


class UdpEar:
    """Another node on a CAN bus over UDP multicast; the kernel stamps each datagram."""

    stamps = "kernel's, at arrival"

    def __init__(self) -> None:
        options: dict[str, Any] = {"port": free_udp_port(), "hop_limit": 0}
        wire: dict[str, Any] = {"interface": "udp_multicast", "channel": MULTICAST, "fd": True}
        self.link = LINK | wire | {"kind": "can", "options": options}
        self.receiver = CanReceiver(fd=True)
        self._bus = can.Bus(**wire, ignore_config=True, **options)
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return int(self._bus.fileno())

    def take(self) -> list[Stamped]:
        """One frame."""
        message = self._bus.recv(0.0)
        if message is None:
            return []
        frame = CanFrame(
            message.arbitration_id,
            bytes(message.data),
            fd=message.is_fd,
            extended=message.is_extended_id,
        )
        return [(round(message.timestamp * 1e9) - self._ahead_ns, frame)]

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


_SLCAN = {"kind": "can", "interface": "slcan", "fd": True, "options": {"sleep_after_open": 0}}
EARS: dict[str, Callable[[], Ear]] = {
    "serial pty 921600": lambda: PtyEar(
        {"kind": "serial", "baudrate": 921_600}, "port", PtyTransport, SerialReceiver()
    ),
    "CAN FD udp_multicast": UdpEar,
    "CAN FD slcan pty": lambda: PtyEar(_SLCAN, "channel", SlcanAdapter, CanReceiver(fd=True)),
}
"""The wires at whose far end a node can be measured, simplest first."""


class Heard:
    """Arrival times of the messages."""

    def __init__(self, receiver: Any) -> None:
        self._receiver = receiver
        self._running = self._advised = False
        self.first_ns: int | None = None
        self.messages: list[tuple[str, int, int]] = []  # kind, time, and see ``take``

    def take(self, stamp_ns: int, unit: Any) -> None:
        """Decode a unit; record a Status with its cycle, an Advice with its age (ms, -1: none)."""
        for message in self._receiver.feed(unit):
            if isinstance(message, Status):
                self._running = message.node_state in (NodeState.RUNNING, NodeState.DEGRADED)
                self.messages.append(("Status", stamp_ns, message.cycle))
            elif isinstance(message, Advice):
                self._advised = True
                age_ms = -1 if message.age_s is None else round(1e3 * message.age_s)
                self.messages.append(("Advice", stamp_ns, age_ms))
        if self._running and self.first_ns is None and self._advised:
            self.first_ns = stamp_ns


def hear(pipe: Connection, wire: str, loop: Connection) -> dict[str, Any]:
    """Receive a node's messages at the end of a wire, and the bytes of a bare loop; for ``child``.

    It sends the node's entry of ``links:``, then the arrival time of the first advice of a running
    node, and finally reports everything received. Units are decoded on arrival up to that advice;
    later ones are decoded at the end, so that decoding delays no stamp.
    """
    ear = EARS[wire]()
    heard, kept, bare = Heard(ear.receiver), list[Stamped](), list[int]()
    priority = _ahead_of_others()
    pipe.send(ear.link)
    gc.disable()
    while True:
        waited: list[Any] = [ear, loop, pipe]
        ready, _, _ = select.select(waited, [], [])
        if loop in ready:
            if not os.read(loop.fileno(), 4096):
                break
            bare.append(time.monotonic_ns())
        if ear in ready:
            kept += ear.take()
        if heard.first_ns is None:
            for stamp_ns, unit in kept:
                heard.take(stamp_ns, unit)
            kept.clear()
            if heard.first_ns is not None:
                pipe.send(heard.first_ns)
        if pipe in ready:
            break
    ear.close()
    for stamp_ns, unit in kept:
        heard.take(stamp_ns, unit)
    told = {"messages": heard.messages, "bare": bare}
    return told | {"stamps": ear.stamps, "priority": priority}


def _ahead_of_others() -> str:
    """Run at a higher priority than all measured processes, if allowed; return the scheduling."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        return f"SCHED_FIFO {PRIORITY}"
    except OSError:
        return "ordinary"


def bare_loop(_: Connection, out: Connection, rate_hz: float) -> None:
    """Write a byte at each deadline while there is a reader; for ``child``."""
    deadline_ns = time.monotonic_ns()
    while True:
        deadline_ns += round(1e9 / rate_hz)
        time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
        try:
            os.write(out.fileno(), b".")
        except BrokenPipeError:
            return
