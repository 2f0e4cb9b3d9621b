"""Senders of motion capture over UDP; see ``live_ends``."""

import contextlib
import socket
import time
from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any

from hri_predict.contracts.scene import Scene
from hri_sim.senders import rokoko, vmc, zed_livelink
from hri_sim.wires.ports import free_udp_port

HOURS_2_S = 7200.0
"""Programs with a clock of their own start it here, so that it can step back."""


class MocapEnd(ABC):
    """A program that sends datagrams to one port."""

    checked = False
    stamped = True
    kind: str

    def __init__(self, _: Path) -> None:
        self._address = ("127.0.0.1", free_udp_port())
        self.source: dict[str, Any] = {
            "kind": self.kind, "sees_room": True, "port": self._address[1],
        }  # fmt: skip
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._began_ns = 0

    def start(self) -> None:
        """The program's clock starts again."""
        self._began_ns = time.time_ns()

    @abstractmethod
    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of one capture."""

    def write(self, unit: bytes) -> None:
        """Send one."""
        with contextlib.suppress(OSError):
            self._socket.sendto(unit, self._address)

    def stop(self) -> None:
        """Pause; the next start goes on with the same socket."""
        self._began_ns = 0

    def _time_s(self, scene: Scene) -> float:
        return (scene.stamp_ns - self._began_ns) * 1e-9 + HOURS_2_S


class VmcEnd(MocapEnd):
    """A performer in an MR mode."""

    kind = "vmc"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the packets of the first person, whom alone a performer has."""
        time_s = self._time_s(scene)
        if not scene.people:
            return [vmc.bundle([vmc.message("/VMC/Ext/OK", 0), vmc.message("/VMC/Ext/T", time_s)])]
        return vmc.capture(scene.people[0].positions, time_s)


class RokokoEnd(MocapEnd):
    """Rokoko Studio, without compression."""

    kind = "rokoko"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return one datagram."""
        actors = {f"actor {person.id}": person.positions for person in scene.people}
        return [rokoko.capture(actors, self._time_s(scene))]


class ZedEnd(MocapEnd):
    """Stereolabs' sender for Unreal."""

    kind = "zed_livelink"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return a datagram for each person."""
        people = {person.id: person.positions for person in scene.people}
        return zed_livelink.for_unreal(people, scene.stamp_ns, scene.sequence)
