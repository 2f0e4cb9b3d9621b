"""Senders for live sources with third-party formats and other wires; see ``live_ends``."""

import contextlib
import json
import os
import socket
import time
import weakref
from pathlib import Path
from typing import Any

from hri_drivers.sources.scene_stream import codec as scene_codec
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.scene_stream.serial_source import framed
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_predict.base.errors import LinkError
from hri_predict.base.skeleton import CANONICAL
from hri_predict.contracts.scene import Scene
from hri_sim.senders import mvn as mvn_sender
from hri_sim.wires.ports import free_tcp_port, free_udp_port
from hri_sim.wires.pty import PtyTransport, open_pty

HOUR_MS = 3_600_000


class TcpEnd:
    """Connects to the node, trying again until it succeeds, and sends units."""

    checked = False  # TCP has a checksum, but it covers only damage on the way
    stamped = True

    def __init__(self, source: dict[str, Any]) -> None:
        self._port = free_tcp_port()
        self.source: dict[str, Any] = source | {"port": self._port}
        self._socket: socket.socket | None = None

    def start(self) -> None:
        """Begin again."""
        self.stop()

    def write(self, unit: bytes) -> None:
        """Send one, if the node is there."""
        try:
            if self._socket is None:
                self._socket = socket.create_connection(("127.0.0.1", self._port), 1.0)
            self._socket.sendall(unit)
        except OSError:
            self.stop()

    def stop(self) -> None:
        """Hang up."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


class JsonEnd(TcpEnd):
    """A line of JSON for each scene."""

    def __init__(self, _: Path) -> None:
        super().__init__({"kind": "json"})

    def encode(self, scene: Scene) -> list[bytes]:
        """One line."""
        return [scene_text(scene).encode() + b"\n"]


class WebSocketEnd:
    """A message of JSON for each scene. Needs the extra ``websocket``."""

    checked = False
    stamped = True

    def __init__(self, _: Path) -> None:
        from websockets.sync.client import connect

        self._connect = connect
        port = free_tcp_port()
        self.source: dict[str, Any] = {"kind": "websocket", "port": port}
        self._url = f"ws://127.0.0.1:{port}"
        self._context = contextlib.ExitStack()
        self._connection: Any = None

    def start(self) -> None:
        """Begin again."""
        self.stop()

    def encode(self, scene: Scene) -> list[bytes]:
        """One message."""
        return [scene_text(scene).encode()]

    def write(self, unit: bytes) -> None:
        """Send one, if the node is there."""
        try:
            if self._connection is None:
                connecting = self._connect(self._url, open_timeout=1.0)
                self._connection = self._context.enter_context(connecting)
            self._connection.send(unit)
        except Exception:  # the library's own and OSError: it is not there, or hung up
            self.stop()

    def stop(self) -> None:
        """Hang up."""
        self._connection = None
        with contextlib.suppress(Exception):
            self._context.close()


class MvnCharacter:
    """One person in MVN; its time code starts one hour early, so that the clock can step back."""

    checked = False
    stamped = True

    def start(self) -> None:
        """MVN's recording begins again."""
        self._began_ns = time.time_ns()

    def encode(self, scene: Scene) -> list[bytes]:
        """Return the datagrams of all people."""
        since_ms = (scene.stamp_ns - self._began_ns) // 1_000_000
        return [
            datagram
            for person in scene.people
            for datagram in mvn_sender.quaternions(
                scene.sequence,
                since_ms + 2 * HOUR_MS,
                person.id,
                mvn_sender.segments_of(person.positions),
            )
        ]


class MvnUdpEnd(MvnCharacter):
    """MVN's stream over UDP."""

    def __init__(self, _: Path) -> None:
        self._address = ("127.0.0.1", free_udp_port())
        self.source: dict[str, Any] = {
            "kind": "mvn", "sees_room": True, "port": self._address[1],
        }  # fmt: skip
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def write(self, unit: bytes) -> None:
        """Send one."""
        with contextlib.suppress(OSError):
            self._socket.sendto(unit, self._address)

    def stop(self) -> None:
        """Keep everything: the next start uses it."""


class MvnTcpEnd(MvnCharacter, TcpEnd):
    """MVN's stream over TCP."""

    def __init__(self, _: Path) -> None:
        TcpEnd.__init__(self, {"kind": "mvn", "sees_room": True, "protocol": "tcp"})

    def start(self) -> None:
        """MVN's recording begins again."""
        TcpEnd.start(self)
        MvnCharacter.start(self)


class SceneStreamEnd:
    """The node's own scene stream, over any wire."""

    checked = stamped = True
    _session = 0
    _key: Key | None = None

    def start(self) -> None:
        """A new session."""
        self._session = time.time_ns()

    def encode(self, scene: Scene) -> list[bytes]:
        """Datagrams."""
        people = tuple(SentPerson(p.id, p.positions, p.observed, p.error_m) for p in scene.people)
        sent = SentScene(
            stamp_ns=scene.stamp_ns,
            sequence=scene.sequence,
            sees_room=scene.sees_room,
            people=people,
            session=self._session,
        )
        return scene_codec.encode(sent, CANONICAL.joints, self._key)


class SerialEnd(SceneStreamEnd):
    """The node's own scene stream over a serial line."""

    def __init__(self, _: Path) -> None:
        master, path = open_pty()
        weakref.finalize(self, os.close, master)
        self.source: dict[str, Any] = {"kind": "serial_skeleton", "port": path}
        self._line = PtyTransport(master)
        self._line.open()

    def encode(self, scene: Scene) -> list[bytes]:
        """Frames."""
        return [framed(datagram) for datagram in super().encode(scene)]

    def write(self, unit: bytes) -> None:
        """Send one, if the line accepts it."""
        with contextlib.suppress(LinkError):
            self._line.write(unit)

    def stop(self) -> None:
        """Keep the line open."""


def scene_text(scene: Scene) -> str:
    """Return a scene of canonical joints as JSON text (``drivers/SCENE_JSON.md``)."""
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
    return json.dumps(
        {
            "format": "hri-scene/1",
            "sequence": scene.sequence,
            "stamp_s": scene.stamp_ns * 1e-9,
            "sees_room": scene.sees_room,
            "units": "m",
            "axes": ["x", "y", "z"],
            "people": people,
        }
    )
