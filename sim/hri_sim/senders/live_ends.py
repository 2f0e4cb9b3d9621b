"""Senders for every kind of live source: the other end of the wire, for the fault table.

A kind joins the table by a line in ``LIVE_ENDS``.
"""

import contextlib
import os
import secrets
import socket
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol

from hri_drivers.sources.scene_stream.key_file import read_key
from hri_predict.contracts.scene import Scene
from hri_sim.senders.mocap_ends import (
    MocapEnd,
    RokokoStudio,
    VmcPerformer,
    ZedLiveLink,
    motive,
    qtm,
)
from hri_sim.senders.stream_ends import (
    JsonEnd,
    MvnTcpEnd,
    MvnUdpEnd,
    SceneStreamEnd,
    SerialEnd,
    WebSocketEnd,
)
from hri_sim.wires.ports import free_udp_port


class LiveEnd(Protocol):
    """A sender, and the settings of the source that receives from it.

    Attributes:
        source: settings of the source; the caller adds ``room_from_source`` and ``rate_hz``.
        checked: whether the wire has a checksum, so that damaged scenes must be refused.
        stamped: whether scenes carry the sender's own time.
    """

    source: dict[str, Any]
    checked: bool
    stamped: bool

    def start(self) -> None:
        """Start, or start again as after a restart of the sender's program."""

    def encode(self, scene: Scene) -> list[bytes]:
        """Return a scene of canonical joints (metres) as units: datagrams, lines or frames.

        The scene's stamp is nanoseconds of UTC; its sequence begins at 0 with each ``start``.
        """

    def write(self, unit: bytes) -> None:
        """Put a unit on the wire; it may be lost without notice."""

    def stop(self) -> None:
        """Stop, as the sender's program does at its end. Safe to call twice."""


class UdpEnd(SceneStreamEnd):
    """The node's own scene stream, with or without a key."""

    def __init__(self, folder: Path, keyed: bool = False) -> None:
        self._address = ("127.0.0.1", free_udp_port())
        self.source: dict[str, Any] = {"kind": "udp", "port": self._address[1]}
        if keyed:
            path = folder / "live.key"
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
            with os.fdopen(descriptor, "w", encoding="ascii") as file:
                file.write(secrets.token_hex(32))
            self._key = read_key(str(path))
            self.source["key_file"] = str(path)
        self._socket: socket.socket | None = None

    def start(self) -> None:
        """A new session."""
        self.stop()
        super().start()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def write(self, unit: bytes) -> None:
        """Send one."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(unit, self._address)

    def stop(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


LIVE_ENDS: dict[str, Callable[[Path], LiveEnd]] = {
    "udp": UdpEnd,
    "udp with a key": lambda folder: UdpEnd(folder, keyed=True),
    "serial": SerialEnd,
    "mvn": MvnUdpEnd,
    "mvn over tcp": MvnTcpEnd,
    "json": JsonEnd,
    "vmc": lambda _: MocapEnd(VmcPerformer()),
    "rokoko": lambda _: MocapEnd(RokokoStudio()),
    "zed_livelink": lambda _: MocapEnd(ZedLiveLink()),
    "natnet": lambda _: motive(),
    "qualisys": lambda _: qtm(),
}
if find_spec("websockets") is not None:
    LIVE_ENDS["websocket"] = WebSocketEnd
if find_spec("zenoh") is not None:
    from hri_sim.senders.zenoh import ZenohEnd

    LIVE_ENDS["zenoh"] = ZenohEnd
if find_spec("rclpy") is not None and find_spec("rosbags") is not None:

    def _ros2(folder: Path) -> LiveEnd:
        from hri_sim.senders.ros2 import Ros2End  # rclpy takes a second

        return Ros2End(folder)

    LIVE_ENDS["ros2"] = _ros2
