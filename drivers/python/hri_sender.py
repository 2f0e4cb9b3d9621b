"""Sends what your tracker sees to hri-predict. Copy this file; it needs Python 3.10 or newer.

    sender = SceneSender("127.0.0.1", 47800, ["l_wrist", "r_wrist"])
    while True:
        positions = ...                     # your tracker: metres, one [x, y, z] per joint
        sender.send([(1, positions)])       # the sensor sees person 1
        # sender.send([(1, positions, 0.4)])  # the whole body may be 0.4 m off
        # sender.send([])                   # the sensor sees the whole room, which is empty
        # sender.send([], sees_room=False)  # the sensor does not know who is there

Joint names, order, units and axes are those of the node's ``source.joint_map``: with ``canonical``
z points up, with ``coco17`` the axes are a camera's (x right, y down, z away from the camera). A
joint that the sensor does not see is ``None`` or NaN. Send every capture, at a steady rate, even if
no one is in view: after a few missing periods the node's state is *unknown*, and the robot stops.
The node believes an empty scene: if a body may be hidden, send ``sees_room=False``.

Run this file as a program to send a swaying person, for a first test: ``python hri_sender.py
--help``. Its joints are those of ``canonical``; docs/guides/live-sources.md shows a program that
sends those of ``coco17``. SCENE_STREAM.md specifies the format.
"""

import argparse
import contextlib
import hashlib
import hmac
import math
import socket
import struct
import sys
import time
import zlib
from collections.abc import Iterable, Sequence
from typing import Any

Joints = Sequence[Sequence[float] | None]
Body = tuple[int, Joints] | tuple[int, Joints, float]

VERSION = 1
SEES_ROOM, AUTHENTICATED, HAS_ERRORS = 1, 2, 4
HEADER = struct.Struct("<4sBBBBQQqIBBH")
MAX_DATAGRAM, TAG_BYTES = 1400, 16
CHUNK = MAX_DATAGRAM - HEADER.size - TAG_BYTES
MAX_PEOPLE, MAX_JOINTS, MIN_KEY_BYTES = 16, 128, 32
MAX_ERROR_M = 20.0


class SceneSender:
    """Sends scenes to one address, or to a multicast group.

    Each sender is its own session, named by its start time. With a key, this machine's clock must
    be set (NTP).

    Args:
        host: address on which the node listens: its ``source.host`` or ``multicast_group``.
        port: its ``source.port``.
        joints: names and order of the node's joint map.
        key_file: a copy of the node's ``source.key_file``; without a key, only damage to the stream
            is detected.
        interface: for multicast: address of the network interface to send on.
    """

    def __init__(
        self,
        host: str,
        port: int,
        joints: Sequence[str],
        key_file: str | None = None,
        interface: str | None = None,
    ) -> None:
        joints = list(joints)
        if not 1 <= len(joints) <= MAX_JOINTS or len(set(joints)) != len(joints):
            raise ValueError(f"joints: give 1 to {MAX_JOINTS} different names")
        if not 1 <= port <= 65535:
            raise ValueError(f"port {port}: give the node's source.port, 1 to 65535")
        self.session = time.time_ns()
        self.sequence = 0
        self._joints = joints
        self._names_crc = zlib.crc32("\n".join(joints).encode())
        self._key = read_key(key_file) if key_file is not None else None
        self._address: Any
        family, kind, protocol, _, self._address = socket.getaddrinfo(
            host, port, type=socket.SOCK_DGRAM
        )[0]
        self._is_refused = False
        self._socket = socket.socket(family, kind, protocol)
        self._is_here = self._address[0].startswith("127.") or self._address[0] == "::1"
        if self._is_here:  # only a connected socket is told that no program listens
            self._socket.connect(self._address)
        if interface is not None:
            self._socket.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface)
            )

    def send(
        self, people: Iterable[Body], sees_room: bool = True, stamp_ns: int | None = None
    ) -> None:
        """Send one scene. There is no error if no node listens: the datagrams are lost.

        On this machine, standard error then names the port once.

        Args:
            people: for each an id (0 to 65535, the same for the same body from scene to scene) and
                its joints: for each name [x, y, z], or ``None`` or NaN if not seen. Arrays work. A
                third number is the error of the position: a 99 % bound in metres of the common
                offset of all joints. Older nodes refuse scenes with an error above 0.
            sees_room: whether the sensor saw the whole room that it watches.
            stamp_ns: time of the capture, nanoseconds of UTC since 1970; default now. Prefer the
                camera's own time if it is UTC, so that the node can determine the age.

        Raises:
            ValueError: too many people, a person without a position for each joint, or an error
                that is not 0 to 20 m.
        """
        stamp_ns = time.time_ns() if stamp_ns is None else stamp_ns
        for datagram in self.encode(people, sees_room, stamp_ns):
            try:
                self._write(datagram)
            except ConnectionRefusedError:  # of an earlier one; this one has not left
                self._warn_of_refusal()
                with contextlib.suppress(OSError):
                    self._write(datagram)
            except OSError:  # the network is down; the next one may arrive
                continue

    def encode(self, people: Iterable[Body], sees_room: bool, stamp_ns: int) -> list[bytes]:
        """Return the datagrams of one scene, for programs that send them themselves."""
        people = list(people)
        if len(people) > MAX_PEOPLE:
            raise ValueError(f"people: {len(people)}; a scene holds at most {MAX_PEOPLE}")
        errors = [_error_m(number, *rest) for number, _, *rest in people]
        body = b""
        for (number, positions, *_), error_m in zip(people, errors, strict=True):
            body += self._record(number, positions)
            body += struct.pack("<f", error_m) if any(errors) else b""
        parts = max(1, -(-len(body) // CHUNK))
        flags = (SEES_ROOM if sees_room else 0) | (AUTHENTICATED if self._key else 0)
        flags |= HAS_ERRORS if any(errors) else 0
        datagrams = []
        for part in range(parts):
            data = HEADER.pack(
                b"HRIS", VERSION, flags, part, parts, self.session, self.sequence, stamp_ns,
                self._names_crc, len(self._joints), len(people), len(body),
            ) + body[part * CHUNK : (part + 1) * CHUNK]  # fmt: skip
            datagrams.append(data + self._tag(data))
        self.sequence += 1
        return datagrams

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _warn_of_refusal(self) -> None:
        if not self._is_refused:
            self._is_refused = True
            host, port, *_ = self._address
            print(
                f"warning: no program listens on {host} port {port}: start the node, or give its "
                f"source.host and source.port; sending continues",
                file=sys.stderr,
                flush=True,
            )

    def _write(self, datagram: bytes) -> None:
        if self._is_here:
            self._socket.send(datagram)
        else:
            self._socket.sendto(datagram, self._address)

    def _record(self, number: int, positions: Joints) -> bytes:
        """One person: id, which joints are seen, their positions."""
        if len(positions) != len(self._joints):
            raise ValueError(f"person {number}: {len(positions)} joints, not {len(self._joints)}")
        seen = bytearray(-(-len(self._joints) // 8))
        values = []
        for i, place in enumerate(positions):
            x, y, z = (0.0, 0.0, 0.0) if place is None else (float(v) for v in place)
            if place is not None and all(math.isfinite(v) for v in (x, y, z)):
                seen[i // 8] |= 1 << i % 8
                values += [x, y, z]
            else:
                values += [0.0, 0.0, 0.0]
        return struct.pack("<H", number) + bytes(seen) + struct.pack(f"<{len(values)}f", *values)

    def _tag(self, data: bytes) -> bytes:
        if self._key is None:
            return struct.pack("<I", zlib.crc32(data))
        return hmac.new(self._key, data, hashlib.sha256).digest()[:TAG_BYTES]


def _error_m(number: int, error_m: float = 0.0) -> float:
    """The error of a person's position, if it is valid."""
    try:
        stated = float(error_m)
    except (TypeError, ValueError):
        stated = math.nan
    if not 0.0 <= stated <= MAX_ERROR_M:
        raise ValueError(f"person {number}: error {error_m!r} m; give 0 to {MAX_ERROR_M:g}")
    return stated


def read_key(path: str) -> bytes:
    """The key in a file: its bytes without white space at both ends."""
    with open(path, "rb") as file:
        key = file.read().strip()
    if len(key) < MIN_KEY_BYTES:
        raise ValueError(f"{path}: holds {len(key)} bytes; a key has at least {MIN_KEY_BYTES}")
    return key


CANONICAL = [
    "waist", "torso", "neck", "head", "head_top",
    "l_shoulder", "l_elbow", "l_wrist", "l_hand", "r_shoulder", "r_elbow", "r_wrist", "r_hand",
    "l_hip", "l_knee", "l_ankle", "l_foot", "r_hip", "r_knee", "r_ankle", "r_foot",
]  # fmt: skip
_STANDING = [  # x forward, y left, z up: somebody standing at the origin, facing along x
    (0, 0, 0.95), (0, 0, 1.2), (0, 0, 1.5), (0.02, 0, 1.65), (0, 0, 1.8),
    (0, 0.2, 1.45), (0, 0.25, 1.15), (0, 0.26, 0.9), (0, 0.26, 0.8),
    (0, -0.2, 1.45), (0, -0.25, 1.15), (0, -0.26, 0.9), (0, -0.26, 0.8),
    (0, 0.1, 0.93), (0, 0.1, 0.5), (0, 0.1, 0.1), (0.15, 0.1, 0.02),
    (0, -0.1, 0.93), (0, -0.1, 0.5), (0, -0.1, 0.1), (0.15, -0.1, 0.02),
]  # fmt: skip


def swaying(seconds: float, place: tuple[float, float] = (2.0, 0.0)) -> Joints:
    """A test person at ``place`` on the node's floor, with the joints of the map ``canonical``."""
    sway = 0.02 * math.sin(1.5 * seconds)
    tremble = 0.001 * math.sin(40.0 * seconds)  # no two captures are equal, as with a real sensor
    return [(place[0] + x + sway * z + tremble, place[1] + y + tremble, z) for x, y, z in _STANDING]


def main() -> None:
    """Send a swaying person."""
    parser = argparse.ArgumentParser(description="Send a swaying person to hri-predict.")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=47800)
    parser.add_argument("--key-file")
    parser.add_argument("--rate", type=float, default=30.0, help="scenes per second")
    parser.add_argument("--seconds", type=float, default=math.inf, help="stop after this time")
    arguments = parser.parse_args()
    if not arguments.rate > 0:
        parser.error(f"--rate {arguments.rate:g}: give a number above 0")
    if not 1 <= arguments.port <= 65535:
        parser.error(f"--port {arguments.port}: give the node's source.port, 1 to 65535")
    try:
        if arguments.key_file is not None:
            read_key(arguments.key_file)
    except (OSError, ValueError) as error:
        parser.error(f"--key-file: {error}; give a copy of the node's source.key_file")
    try:
        sender = SceneSender(arguments.host, arguments.port, CANONICAL, arguments.key_file)
    except OSError as error:
        parser.error(f"--host {arguments.host}: {error}; give the node's source.host")
    print(
        f"sends to {arguments.host} port {arguments.port}, {arguments.rate:g} scenes a second; the "
        f"node needs 'joint_map: canonical'",
        flush=True,
    )
    start = time.monotonic()
    try:
        while time.monotonic() - start < arguments.seconds:
            sender.send([(1, swaying(time.monotonic() - start))])
            due = start + sender.sequence / arguments.rate
            time.sleep(max(0.0, due - time.monotonic()))
    except KeyboardInterrupt:
        pass
    sender.close()


if __name__ == "__main__":
    main()
