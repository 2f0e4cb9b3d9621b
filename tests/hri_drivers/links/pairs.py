"""Pairs of a link and its peer over every kind of wire."""

import itertools
import threading
from dataclasses import dataclass
from typing import Any

from hri_drivers.links.can.link import CanLink, CanLinkSettings
from hri_drivers.links.can.transport import CanTransport
from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_drivers.wires.transport import pipe
from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.messages import (
    Level,
    NodeState,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.wires.pty import PtyTransport
from hri_sim.wires.slcan_adapter import SlcanAdapter, open_pty
from tests.messages import make_advice, make_state

CHANNELS = itertools.count()


def advice(latch_id=0, robot=0, **more):
    return make_advice(
        Level.SLOW, Reason.PERSON_NEAR, robot=robot, latch_id=latch_id, speed_limit_m_s=0.25, **more
    )


def robot_state(counter, robot=0):
    return make_state((0.1,) * 6, counter=counter, robot=robot)


def zone(person=0, step=0, capture_ns=0, segments=3):
    capsules = tuple(ZoneCapsule(i, (0.0, 0.0, 1.0), (0.0, 0.5, 1.0), 0.2) for i in range(segments))
    return Zone(
        person=person, step=step, horizon_s=0.04 * step, capsules=capsules, capture_ns=capture_ns
    )


STATUS = Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0, cycle=7)


class Peer:
    """The controller's end: decodes what it hears, in a thread of its own where time is real."""

    def __init__(self, transport: Any, sender: Any, receiver: Any) -> None:
        self.transport, self._sender, self._receiver = transport, sender, receiver
        self.heard: list[Any] = []
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        self.transport.open()
        self._thread.start()

    def _run(self) -> None:
        while not self._stop.is_set():
            self.listen(0.05)

    def listen(self, timeout_s: float = 0.0) -> None:
        for unit in self.transport.read(timeout_s):
            self.heard += self._receiver.feed(unit)

    def say(self, message: Any) -> None:
        units = self._sender.encode(message)
        for unit in [units] if isinstance(units, bytes) else units:
            self.transport.write(unit)

    def heard_of(self, kind: type) -> list[Any]:
        return [m for m in self.heard if isinstance(m, kind)]

    def stop(self) -> None:
        self._stop.set()
        if self._thread.is_alive():
            self._thread.join()
        self.transport.close()


@dataclass
class Pair:
    link: Any
    peer: Peer


def serial_pair(clock: Any, transport: Any, far: Any, port: str | None = None) -> Pair:
    settings = SerialLinkSettings(name="cell", port=port or "pipe", baudrate=921_600)
    link = SerialLink(settings, clock, transport)
    return Pair(link, Peer(far, SerialSender(), SerialReceiver()))


def can_pair(clock: Any, far: Any, fd: bool, transport: Any = None, **where: str) -> Pair:
    settings = CanLinkSettings(
        name="cell", simulate={}, fd=fd, **({"interface": "virtual", "channel": "x"} | where)
    )
    return Pair(CanLink(settings, clock, transport), Peer(far, CanSender(fd), CanReceiver(fd)))


def make(kind: str, clock: Any) -> Pair:
    fd = kind.endswith("fd")
    if kind == "serial pipe":
        return serial_pair(clock, *pipe())
    if kind.startswith("can pipe"):
        near, end = pipe()  # type: ignore[var-annotated]
        return can_pair(clock, end, fd, near)
    if kind == "serial pty":
        master, path = open_pty()
        return serial_pair(clock, None, PtyTransport(master), path)
    if kind.startswith("slcan"):
        master, path = open_pty()
        return can_pair(clock, SlcanAdapter(master), fd, interface="slcan", channel=path)
    channel = f"test-{next(CHANNELS)}"
    far = CanTransport(interface="virtual", channel=channel, fd=fd)
    return can_pair(clock, far, fd, interface="virtual", channel=channel)


REAL_TIME = ["serial pipe", "serial pty", "virtual", "virtual fd", "slcan", "slcan fd"]
VIRTUAL_TIME = ["serial pipe", "can pipe", "can pipe fd"]


def more(into: list[Any], new: list[Any]) -> list[Any]:
    """``into`` with what is new."""
    into += new
    return into


def take_into(received: list[Any], link: Any) -> int:
    received += link.take()
    return len(received)
