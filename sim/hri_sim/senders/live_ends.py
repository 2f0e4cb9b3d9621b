"""Senders for every kind of live source: the other end of the wire, for the fault table.

To add a kind, add a line to ``LIVE_ENDS``.
"""

import os
import secrets
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hri_drivers.sources.scene_stream.key_file import read_key
from hri_sim.senders.mocap_ends import (
    MotiveProgram,
    Program,
    QtmProgram,
    RokokoStudio,
    VmcPerformer,
    ZedLiveLink,
)
from hri_sim.senders.natnet import Motive
from hri_sim.senders.qualisys import Qtm
from hri_sim.senders.stream_ends import (
    Json,
    LiveEnd,
    Mvn,
    SceneStream,
    Serial,
    Tcp,
    Udp,
    WebSocket,
    Wire,
)
from hri_sim.wires.ports import free_tcp_port, free_udp_port


def _udp(_: Path) -> LiveEnd:
    port = free_udp_port()
    return LiveEnd(SceneStream(), Udp(port), {"kind": "udp", "port": port}, checked=True)


def _udp_with_key(folder: Path) -> LiveEnd:
    path, port = folder / "live.key", free_udp_port()
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "w", encoding="ascii") as file:
        file.write(secrets.token_hex(32))
    source = {"kind": "udp", "port": port, "key_file": str(path)}
    return LiveEnd(SceneStream(read_key(str(path))), Udp(port), source, checked=True)


def _serial(_: Path) -> LiveEnd:
    wire = Serial()
    source = {"kind": "serial_skeleton", "port": wire.path}
    return LiveEnd(SceneStream(serial=True), wire, source, checked=True)


def _json(_: Path) -> LiveEnd:
    port = free_tcp_port()
    return LiveEnd(Json(b"\n"), Tcp(port), {"kind": "json", "port": port})


def _websocket(_: Path) -> LiveEnd:
    port = free_tcp_port()
    return LiveEnd(Json(), WebSocket(port), {"kind": "websocket", "port": port})


def _mvn_over_tcp(_: Path) -> LiveEnd:
    port = free_tcp_port()
    source = {"kind": "mvn", "sees_room": True, "protocol": "tcp", "port": port}
    return LiveEnd(Mvn(), Tcp(port), source)


def _mocap(program: Callable[[], Program], kind: str) -> Callable[[Path], LiveEnd]:
    """A program that sends datagrams to the node's port."""

    def end(_: Path) -> LiveEnd:
        port = free_udp_port()
        source = {"kind": kind, "sees_room": True, "port": port}
        return LiveEnd(program(), Udp(port, lasting=True), source)

    return end


class _Served(Wire):
    """A server on this machine, which keeps answering while its program restarts."""

    def __init__(self, server: Motive | Qtm) -> None:
        self._server = server

    def write(self, unit: bytes) -> None:
        """Send the unit to the clients that requested captures."""
        self._server.send(unit)


def _served(program: Program, server: Motive | Qtm, **source: Any) -> LiveEnd:
    return LiveEnd(program, _Served(server), {"kind": program.kind, "sees_room": True} | source)


def _motive(_: Path) -> LiveEnd:
    server = Motive(MotiveProgram.skeletons)
    return _served(MotiveProgram(), server, command_port=server.port)


def _qtm(_: Path) -> LiveEnd:
    server = Qtm(QtmProgram.skeletons)
    return _served(QtmProgram(), server, port=server.port)


LIVE_ENDS: dict[str, Callable[[Path], LiveEnd]] = {
    "udp": _udp,
    "udp with a key": _udp_with_key,
    "serial": _serial,
    "mvn": _mocap(Mvn, "mvn"),
    "mvn over tcp": _mvn_over_tcp,
    "json": _json,
    "vmc": _mocap(VmcPerformer, "vmc"),
    "rokoko": _mocap(RokokoStudio, "rokoko"),
    "zed_livelink": _mocap(ZedLiveLink, "zed_livelink"),
    "natnet": _motive,
    "qualisys": _qtm,
}
if find_spec("websockets") is not None:
    LIVE_ENDS["websocket"] = _websocket
if find_spec("zenoh") is not None:
    from hri_sim.senders.zenoh import zenoh_end

    LIVE_ENDS["zenoh"] = zenoh_end
if find_spec("rclpy") is not None and find_spec("rosbags") is not None:

    def _ros2(folder: Path) -> LiveEnd:
        from hri_sim.senders.ros2 import Ros2End  # rclpy takes a second

        return Ros2End(folder)

    LIVE_ENDS["ros2"] = _ros2
