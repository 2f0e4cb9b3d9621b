"""The other processes of ``heard``: a receiver at the end of a wire, and a bare loop beside it.

    python -m hri_sim.bench.receiver bare FD RATE_HZ
    python -m hri_sim.bench.receiver serial FD BARE_FD
    python -m hri_sim.bench.receiver slcan FD BARE_FD
    python -m hri_sim.bench.receiver udp CHANNEL PORT BARE_FD

The bare loop sleeps to an absolute deadline, writes a byte into a pipe, and does nothing else. The
receiver notes when the messages of a node and the bytes of the bare loop come, both in the same
way, so that its own lateness is in both. It ends when standard input ends.
"""

import gc
import json
import os
import select
import sys
import time
from collections.abc import Sequence
from typing import Any, Protocol

import can

from hri_predict.protocol.can import CanFrame, CanReceiver
from hri_predict.protocol.messages import Advice, NodeState, Status
from hri_predict.protocol.serial import SerialReceiver
from hri_sim.wires.slcan_adapter import SlcanAdapter

PRIORITY = 10
Stamped = tuple[int, Any]
"""When it came, nanoseconds of the monotonic clock, and a unit that the decoder takes."""


class Ear(Protocol):
    """One end of a wire."""

    stamps: str

    def fileno(self) -> int:
        """Return the file to wait for."""

    def take(self) -> list[Stamped]:
        """Return what has come, without waiting."""


class SerialEar:
    """The other side of a serial line; the clock is read after each read."""

    stamps = "receiver's clock after a blocking read"

    def __init__(self, fd: int) -> None:
        self._fd = fd

    def fileno(self) -> int:
        """The descriptor."""
        return self._fd

    def take(self) -> list[Stamped]:
        """One chunk of bytes."""
        data = os.read(self._fd, 65_536)
        return [(time.monotonic_ns(), data)]


class SlcanEar:
    """A CAN adapter on a serial line; the clock is read after each read."""

    stamps = "receiver's clock after a blocking read"

    def __init__(self, fd: int) -> None:
        self._fd = fd
        self._adapter = SlcanAdapter(fd)
        self._adapter.open()

    def fileno(self) -> int:
        """The descriptor."""
        return self._fd

    def take(self) -> list[Stamped]:
        """The frames that came."""
        frames = self._adapter.read(0.0)
        now_ns = time.monotonic_ns()
        return [(now_ns, frame) for frame in frames]


class UdpEar:
    """Another node on a CAN bus over UDP multicast; the kernel stamps each datagram."""

    stamps = "kernel's, at arrival"

    def __init__(self, channel: str, port: int) -> None:
        self._bus = can.Bus(
            interface="udp_multicast",
            channel=channel,
            port=port,
            hop_limit=0,
            fd=True,
            ignore_config=True,
        )
        self._ahead_ns = time.time_ns() - time.monotonic_ns()

    def fileno(self) -> int:
        """The socket's descriptor."""
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


class Heard:
    """When which message came."""

    def __init__(self, receiver: Any) -> None:
        self._receiver = receiver
        self._running = self._advised = False
        self.first_ns: int | None = None
        self.messages: list[tuple[str, int, int]] = []  # kind, time, cycle (-1: it has none)

    def take(self, stamp_ns: int, unit: Any) -> None:
        """Decode a unit."""
        for message in self._receiver.feed(unit):
            if isinstance(message, Status):
                self._running = message.node_state in (NodeState.RUNNING, NodeState.DEGRADED)
                self.messages.append(("Status", stamp_ns, message.cycle))
            elif isinstance(message, Advice):
                self._advised = True
                self.messages.append(("Advice", stamp_ns, -1))
        if self._running and self.first_ns is None and self._advised:
            self.first_ns = stamp_ns


def hear(ear: Ear, receiver: Any, bare_fd: int) -> None:
    """Hear until standard input ends, then print what was heard, as JSON.

    Units are decoded as they come until the first advice of a running node is there, which one line
    reports; later ones are decoded at the end, so that decoding makes no stamp late.
    """
    heard, kept, bare = Heard(receiver), list[Stamped](), list[int]()
    priority = _ahead_of_others()
    print(json.dumps({"ready": True}), flush=True)
    gc.disable()
    while True:
        ready, _, _ = select.select([ear, bare_fd, sys.stdin], [], [])
        if bare_fd in ready:
            if not os.read(bare_fd, 4096):
                break
            bare.append(time.monotonic_ns())
        if ear in ready:
            kept += ear.take()
        if heard.first_ns is None:
            for stamp_ns, unit in kept:
                heard.take(stamp_ns, unit)
            kept.clear()
            if heard.first_ns is not None:
                print(json.dumps({"first_ns": heard.first_ns}), flush=True)
        if sys.stdin in ready:
            break
    for stamp_ns, unit in kept:
        heard.take(stamp_ns, unit)
    told = {"messages": heard.messages, "bare": bare, "stamps": ear.stamps, "priority": priority}
    print(json.dumps(told), flush=True)


def _ahead_of_others() -> str:
    """Run ahead of all that is measured, where this is allowed; return how."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        return f"SCHED_FIFO {PRIORITY}"
    except OSError:
        return "ordinary"


def bare(fd: int, rate_hz: float) -> None:
    """Write a byte at each deadline, for as long as there is a reader."""
    deadline_ns = time.monotonic_ns()
    while True:
        deadline_ns += round(1e9 / rate_hz)
        time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
        try:
            os.write(fd, b".")
        except BrokenPipeError:
            return


def main(arguments: Sequence[str]) -> None:
    """Run one of the processes."""
    kind, *more = arguments
    if kind == "bare":
        bare(int(more[0]), float(more[1]))
    elif kind == "serial":
        hear(SerialEar(int(more[0])), SerialReceiver(), int(more[1]))
    elif kind == "slcan":
        hear(SlcanEar(int(more[0])), CanReceiver(fd=True), int(more[1]))
    else:
        hear(UdpEar(more[0], int(more[1])), CanReceiver(fd=True), int(more[2]))


if __name__ == "__main__":
    main(sys.argv[1:])
