"""Sends scenes to a node over its UDP scene stream, and never receives."""

import ipaddress
import socket
import sys
import time
from collections.abc import Sequence

from hri_drivers.sources.scene_stream.codec import encode
from hri_drivers.sources.scene_stream.key_file import Key
from hri_drivers.sources.sent import SentPerson, SentScene
from hri_drivers.sources.udp_receiver import is_loopback
from hri_predict.base.errors import ConfigError

STEP_NS = 50_000_000
"""A clock that moves by more than this between two scenes was set, not slewed."""


class Sender:
    """Sends scenes to one address.

    Args:
        host: IP address at which the node listens.
        port: UDP port of the node.
        joints: names of the joints in the node's joint map.
        key: the node's key; needed for an address that is not this machine's own.

    Attributes:
        scenes: number of scenes that were sent.
        unsent: number of datagrams that the system refused.
        clock_steps: number of times that this machine's UTC was set. The images' own times do not
            follow the change; the node sees that the sender's clock jumped.

    Raises:
        ConfigError: the host is not an IP address, or needs a key.
    """

    def __init__(self, host: str, port: int, joints: Sequence[str], key: Key | None = None) -> None:
        address = address_of(host, key)
        family = socket.AF_INET6 if address.version == 6 else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._address = (str(address), port)
        self._joints = list(joints)
        self._key = key
        self._session = time.time_ns()
        self._sequence = 0
        self._ahead_ns = _utc_ahead_ns()
        self.scenes = self.unsent = self.clock_steps = 0

    def send(
        self, people: tuple[SentPerson, ...], *, sees_room: bool, stamp_ns: int, missed: int = 0
    ) -> None:
        """Send one scene; datagrams that the system refuses are counted.

        Args:
            people: in the units and axes of the joint map.
            sees_room: see ``hri_predict.contracts.scene.Scene``.
            stamp_ns: time of the exposure by ``time.monotonic_ns``; UTC is sent.
            missed: number of captures since the previous scene for which no scene was sent.
        """
        self._sequence += missed
        scene = SentScene(
            stamp_ns=self._utc(stamp_ns),
            sequence=self._sequence,
            sees_room=sees_room,
            people=people,
            session=self._session,
        )
        self._sequence += 1
        self.scenes += 1
        for datagram in encode(scene, self._joints, self._key):
            try:
                self._socket.sendto(datagram, self._address)
            except OSError:
                self.unsent += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _utc(self, monotonic_ns: int) -> int:
        """Return a time of the monotonic clock as nanoseconds of UTC; report if UTC was set."""
        ahead_ns = _utc_ahead_ns()
        step_ns = ahead_ns - self._ahead_ns
        if abs(step_ns) > STEP_NS:
            self.clock_steps += 1
            way = "forward" if step_ns > 0 else "back"
            print(
                f"camera: this machine's clock was set {way} by {abs(step_ns) / 1e9:.3g} s",
                file=sys.stderr,
                flush=True,
            )
        self._ahead_ns = ahead_ns
        return monotonic_ns + ahead_ns


def address_of(host: str, key: Key | None) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """Return the address to which scenes may be sent.

    Raises:
        ConfigError: the host is not an IP address, or needs a key.
    """
    try:
        address = ipaddress.ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        raise ConfigError(f"--host {host}: not an IP address; give one such as 127.0.0.1") from None
    if key is None and not is_loopback(str(address)):
        raise ConfigError(
            f"--host {host}: on a network scenes need --key-file, a copy of the node's "
            f"source.key_file"
        )
    return address


def _utc_ahead_ns() -> int:
    """Return UTC minus the monotonic clock, from the quickest of a few pairs of readings."""
    readings = []
    for _ in range(3):
        before_ns, utc_ns, after_ns = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        readings.append((after_ns - before_ns, utc_ns - before_ns))
    return min(readings)[1]
