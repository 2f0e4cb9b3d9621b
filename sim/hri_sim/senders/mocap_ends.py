"""Senders of motion capture over UDP; see ``live_ends``."""

import contextlib
import socket
import time
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Protocol

from hri_predict.contracts.scene import Scene
from hri_sim.senders import natnet, qualisys, rokoko, vmc, zed_livelink
from hri_sim.wires.ports import free_udp_port

HOURS_2_S = 7200.0
"""Programs with a clock of their own start it here, so that it can step back."""


class Server(Protocol):
    """Sends units to the client that asked for them."""

    def send(self, unit: bytes) -> None:
        """Send one, if there is a client."""


class Program(ABC):
    """A program that sends captures; what it writes, without the socket."""

    kind: str
    greeting: tuple[bytes, ...] = ()
    """Datagrams for a client that asks, before the first capture."""
    _began_ns = 0

    def start(self) -> None:
        """Start, or start again: its clock does, too."""
        self._began_ns = time.time_ns()

    @abstractmethod
    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of one capture of canonical joints; its stamp is ns of UTC."""

    def time_s(self, scene: Scene) -> float:
        """Time of a capture on the program's clock."""
        return (scene.stamp_ns - self._began_ns) * 1e-9 + HOURS_2_S


class VmcPerformer(Program):
    """A performer in an MR mode."""

    kind = "vmc"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the packets of the first person; a performer has no other."""
        time_s = self.time_s(scene)
        if not scene.people:
            return [vmc.bundle([vmc.message("/VMC/Ext/OK", 0), vmc.message("/VMC/Ext/T", time_s)])]
        return vmc.capture(scene.people[0].positions, time_s)


class RokokoStudio(Program):
    """Rokoko Studio, without compression."""

    kind = "rokoko"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return one datagram."""
        actors = {f"actor {person.id}": person.positions for person in scene.people}
        return [rokoko.capture(actors, self.time_s(scene))]


class ZedLiveLink(Program):
    """Stereolabs' sender for Unreal."""

    kind = "zed_livelink"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return a datagram for each person."""
        people = {person.id: person.positions for person in scene.people}
        return zed_livelink.for_unreal(people, scene.stamp_ns, scene.sequence)


class MotiveProgram(Program):
    """Motive with one skeleton."""

    kind = "natnet"
    skeletons: ClassVar[dict[int, str]] = {1: "person"}
    greeting = (natnet.server_info(), natnet.model_definitions(skeletons))

    def encode(self, scene: Scene) -> list[bytes]:
        """Return one frame."""
        people = {person.id: person.positions for person in scene.people}
        return [natnet.frame(scene.sequence, self.time_s(scene), people)]


class QtmProgram(Program):
    """Qualisys Track Manager with one skeleton."""

    kind = "qualisys"
    skeletons: ClassVar[list[str]] = ["person"]
    greeting = (
        qualisys.packet(1, b"QTM RT Interface connected\0"),
        qualisys.packet(1, b"Version set to 1.25\0"),
        qualisys.parameters(skeletons),
    )

    def encode(self, scene: Scene) -> list[bytes]:
        """Return one data packet."""
        (name,) = self.skeletons
        people = {name: scene.people[0].positions} if scene.people else {}
        return [qualisys.data(scene.sequence, round(self.time_s(scene) * 1e6), people)]


PROGRAMS: dict[str, type[Program]] = {
    program.kind: program
    for program in (VmcPerformer, RokokoStudio, ZedLiveLink, MotiveProgram, QtmProgram)
}


class MocapEnd:
    """A program on this machine, which sends to the node's port; see ``live_ends.LiveEnd``."""

    checked = False
    stamped = True

    def __init__(self, program: Program) -> None:
        self._program = program
        self._address = ("127.0.0.1", free_udp_port())
        self.source: dict[str, Any] = {
            "kind": program.kind, "sees_room": True, "port": self._address[1],
        }  # fmt: skip
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def start(self) -> None:
        """Start the program."""
        self._program.start()

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of one capture."""
        return self._program.encode(scene)

    def write(self, unit: bytes) -> None:
        """Send one."""
        with contextlib.suppress(OSError):
            self._socket.sendto(unit, self._address)

    def stop(self) -> None:
        """Pause; the next start goes on with the same socket."""


class ServedEnd:
    """A program on this machine that answers a client, as Motive and QTM do; see ``LiveEnd``.

    Args:
        program: writes the captures.
        server: answers, and sends them.
        source: settings of the source, without its kind.
    """

    checked = False
    stamped = True

    def __init__(self, program: Program, server: Server, **source: Any) -> None:
        self._program, self._server = program, server
        self.source: dict[str, Any] = {"kind": program.kind, "sees_room": True} | source

    def start(self) -> None:
        """Start the program."""
        self._program.start()

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the units of one capture."""
        return self._program.encode(scene)

    def write(self, unit: bytes) -> None:
        """Send one to the client that asked last."""
        self._server.send(unit)

    def stop(self) -> None:
        """Pause; the server goes on answering."""


def motive() -> ServedEnd:
    """Motive with one skeleton."""
    server = natnet.Motive(MotiveProgram.skeletons)
    return ServedEnd(MotiveProgram(), server, command_port=server.port)


def qtm() -> ServedEnd:
    """QTM with one skeleton."""
    server = qualisys.Qtm(QtmProgram.skeletons)
    return ServedEnd(QtmProgram(), server, port=server.port)
