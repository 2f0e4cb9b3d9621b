"""Senders for live sources: a program's output, and the wire that carries it to the node."""

import contextlib
import json
import os
import socket
import weakref
from abc import ABC, abstractmethod
from typing import Any

from hri_drivers.sources.scene_stream import codec as scene_codec
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.scene_stream.serial_source import framed
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.errors import LinkError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.scene import Scene
from hri_sim.senders import mvn as mvn_sender
from hri_sim.senders.mocap_ends import HOURS_2_S, Program
from hri_sim.wires.pty import PtyTransport, open_pty


class Wire(ABC):
    """Carries units to the node's port; they may be lost without notice."""

    def open(self) -> None:  # noqa: B027  # most have nothing to do
        """Start, or start again after ``close``."""

    @abstractmethod
    def write(self, unit: bytes) -> None:
        """Carry one."""

    def close(self) -> None:  # noqa: B027
        """Disconnect, as the sender's program does on exit. Safe to call twice."""


class LiveEnd:
    """A sender: a program, its wire, and the source that receives from it.

    Attributes:
        source: settings of the source; the caller adds ``room_from_source`` and ``rate_hz``.
        checked: whether the wire has a checksum, so that damaged scenes must be refused.
    """

    def __init__(
        self, program: Program, wire: Wire, source: dict[str, Any], *, checked: bool = False
    ) -> None:
        self._program, self._wire = program, wire
        self.source, self.checked = source, checked

    def start(self) -> None:
        """Start, or start again as after a restart of the sender's program."""
        self._wire.close()
        self._wire.open()
        self._program.start()

    def encode(self, scene: Scene) -> list[bytes]:
        """Return a scene of canonical joints (metres) as units: datagrams, lines or frames.

        The scene's stamp is nanoseconds of UTC; its sequence starts at 0 with each ``start``.
        """
        return self._program.encode(scene)

    def write(self, unit: bytes) -> None:
        """Put a unit on the wire; it may be lost without notice."""
        self._wire.write(unit)

    def stop(self) -> None:
        """Stop, as the sender's program does on exit. Safe to call twice."""
        self._wire.close()


# -- wires -----------------------------------------------------------------------------------------


class Udp(Wire):
    """Datagrams to a port of this machine.

    Args:
        port: port of the source.
        lasting: a restarted program continues with the same socket.
    """

    def __init__(self, port: int, *, lasting: bool = False) -> None:
        self._address, self._lasting = ("127.0.0.1", port), lasting
        self._socket: socket.socket | None = None

    def write(self, unit: bytes) -> None:
        """Send one."""
        if self._socket is None:
            self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with contextlib.suppress(OSError):
            self._socket.sendto(unit, self._address)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None and not self._lasting:
            self._socket.close()
            self._socket = None


class Tcp(Wire):
    """Connects to the node, retrying with each unit until it succeeds."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._socket: socket.socket | None = None

    def write(self, unit: bytes) -> None:
        """Send a unit if the node is connected."""
        try:
            if self._socket is None:
                self._socket = socket.create_connection(("127.0.0.1", self._port), 1.0)
            self._socket.sendall(unit)
        except OSError:
            self.close()

    def close(self) -> None:
        """Hang up."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class WebSocket(Wire):
    """Messages over a WebSocket. Needs the extra ``websocket``."""

    def __init__(self, port: int) -> None:
        from websockets.sync.client import connect

        self._connect, self._url = connect, f"ws://127.0.0.1:{port}"
        self._context = contextlib.ExitStack()
        self._connection: Any = None

    def write(self, unit: bytes) -> None:
        """Send a unit as text if the node is connected."""
        try:
            if self._connection is None:
                connecting = self._connect(self._url, open_timeout=1.0)
                self._connection = self._context.enter_context(connecting)
            self._connection.send(unit)
        except Exception:  # the library's own and OSError: it is not there, or hung up
            self.close()

    def close(self) -> None:
        """Hang up."""
        self._connection = None
        with contextlib.suppress(Exception):
            self._context.close()


class Serial(Wire):
    """A serial line that stays open.

    Attributes:
        path: path of the node's port.
    """

    def __init__(self) -> None:
        master, self.path = open_pty()
        weakref.finalize(self, os.close, master)
        self._line = PtyTransport(master)
        self._line.open()

    def write(self, unit: bytes) -> None:
        """Send a unit if the line accepts it."""
        with contextlib.suppress(LinkError):
            self._line.write(unit)


# -- programs --------------------------------------------------------------------------------------


class SceneStream(Program):
    """The node's own scene stream.

    Args:
        key: key of the stream; ``None``: none.
        serial: whether to send frames of a serial line.
    """

    def __init__(self, key: Key | None = None, *, serial: bool = False) -> None:
        self._key, self._serial = key, serial

    def encode(self, scene: Scene) -> list[bytes]:
        """Return datagrams or frames; each start opens a new session."""
        people = tuple(SentPerson(p.id, p.positions, p.observed, p.error_m) for p in scene.people)
        sent = SentScene(
            stamp_ns=scene.stamp_ns,
            sequence=scene.sequence,
            sees_room=scene.sees_room,
            people=people,
            session=self._began_ns,
        )
        datagrams = scene_codec.encode(sent, CANONICAL.joints, self._key)
        return [framed(datagram) for datagram in datagrams] if self._serial else datagrams


class Mvn(Program):
    """People in MVN."""

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of all people."""
        since_ms = (scene.stamp_ns - self._began_ns) // 1_000_000 + round(1e3 * HOURS_2_S)
        return [
            datagram
            for person in scene.people
            for datagram in mvn_sender.quaternions(
                scene.sequence, since_ms, person.id, mvn_sender.segments_of(person.positions)
            )
        ]


class Json(Program):
    """A scene as JSON text (``drivers/SCENE_JSON.md``).

    Args:
        end: terminator of each scene's text.
    """

    def __init__(self, end: bytes = b"") -> None:
        self._end = end

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the scene as one text."""
        people = [
            {
                "id": person.id,
                "joints": {
                    name: [round(float(x), 4) for x in place]
                    for name, place, seen in zip(
                        CANONICAL.joints, person.positions, person.observed, strict=True
                    )
                    if seen
                },
            }
            for person in scene.people
        ]
        told = {
            "format": "hri-scene/1",
            "sequence": scene.sequence,
            "stamp_s": scene.stamp_ns * 1e-9,
            "sees_room": scene.sees_room,
            "units": "m",
            "axes": ["x", "y", "z"],
            "people": people,
        }
        return [json.dumps(told).encode() + self._end]
