"""Programs that send captures: motion capture systems; see ``live_ends``."""

import time
from abc import ABC, abstractmethod
from typing import ClassVar

from hri_predict.contracts.scene import Scene
from hri_sim.senders import natnet, qualisys, rokoko, vmc, zed_livelink

HOURS_2_S = 7200.0
"""Initial time of programs with their own clock, so that the clock can step back."""


class Program(ABC):
    """A program that sends captures: its datagrams, without the socket."""

    kind: str
    greeting: tuple[bytes, ...] = ()
    """Datagrams for a client's requests, before the first capture."""
    _began_ns = 0

    def start(self) -> None:
        """Start or restart the program and its clock."""
        self._began_ns = time.time_ns()

    @abstractmethod
    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of one capture of canonical joints; its stamp is ns of UTC."""

    def time_s(self, scene: Scene) -> float:
        """Return the time of a capture on the program's clock."""
        return (scene.stamp_ns - self._began_ns) * 1e-9 + HOURS_2_S


class VmcPerformer(Program):
    """A performer in an MR mode."""

    kind = "vmc"

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the packets of the first person; a performer is a single person."""
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
