"""A UDP socket that receives datagrams."""

import contextlib
import errno
import ipaddress
import socket
import sys
from typing import Annotated

from pydantic import AfterValidator, Field

from hri_predict.base.errors import SourceError

LARGEST = 65_535
_IP_MULTICAST_ALL = 49  # <linux/in.h>; Python has no name for it
AT_ONCE = 64  # datagrams per ``read``, so that it returns even in a flood


def is_loopback(host: str) -> bool:
    """Whether only programs on this machine can send there."""
    return ipaddress.ip_address(host).is_loopback


class UdpReceiver:
    """``hri_drivers.sources.live.Receiver``: one element of ``read`` is one datagram.

    Args:
        host: address to bind: of one network interface, or of all (``0.0.0.0`` or ``::``).
        port: 0 lets the system choose; see the attribute ``port``.
        multicast_group: address of a group to join on the interface with address ``host``.
        largest: size in bytes of the longest useful datagram; longer ones are cut to one byte more.
    """

    def __init__(
        self, host: str, port: int, multicast_group: str | None = None, largest: int = LARGEST
    ) -> None:
        self._host = host
        self._configured_port = port
        self._group = multicast_group
        self._size = largest + 1
        self._socket: socket.socket | None = None

    @property
    def port(self) -> int:
        """Port to send datagrams to; 0 until the socket is open."""
        return self._socket.getsockname()[1] if self._socket is not None else 0

    def open(self) -> None:
        """Bind the socket.

        Raises:
            SourceError: the address is not this machine's, or another program has the port.
        """
        self.close()
        six = ":" in self._host
        opened = socket.socket(socket.AF_INET6 if six else socket.AF_INET, socket.SOCK_DGRAM)
        try:
            if self._group is not None:
                opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                # bound to the group: datagrams to this machine's own address stay out
                opened.bind((self._group, self._configured_port))
                self._join(opened, self._group)
            else:
                opened.bind((self._host, self._configured_port))
        except OSError as error:
            opened.close()
            raise SourceError(
                f"udp {self._host}:{self._configured_port}: {_remedy(error)}"
            ) from error
        self._socket = opened

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the datagrams that have arrived; wait at most ``timeout_s`` for the first.

        Raises:
            SourceError: the socket is lost.
        """
        opened = self._socket
        if opened is None:
            raise SourceError(f"udp {self._host}: the socket is closed; open it first")
        received: list[tuple[bytes, object]] = []
        try:
            opened.settimeout(timeout_s)
            received.append(opened.recvfrom(self._size))
            opened.settimeout(0.0)
            while len(received) < AT_ONCE:
                received.append(opened.recvfrom(self._size))
        except (TimeoutError, BlockingIOError):
            pass
        except OSError as error:
            raise SourceError(f"udp {self._host}: lost ({error}); check the network") from error
        return [data for data, sender in received if self.accepts(sender)]

    def accepts(self, sender: object) -> bool:
        """Whether a datagram from this address is accepted; here always true."""
        return True

    def close(self) -> None:
        """Close the socket."""
        opened, self._socket = self._socket, None
        if opened is not None:
            with contextlib.suppress(OSError):
                opened.close()

    def _join(self, opened: socket.socket, group: str) -> None:
        interface = socket.inet_aton(self._host)
        membership = socket.inet_aton(group) + interface
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
        if sys.platform == "linux":  # only our group, not those that other programs joined
            opened.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)


def _remedy(error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return "in use by another program; close that program, or choose another 'port'"
    if error.errno == errno.EADDRNOTAVAIL:
        return "not an address of this machine; correct 'host'"
    if error.errno == errno.EACCES:
        return "not permitted; choose a 'port' above 1023"
    if error.errno == errno.ENODEV:
        return "no interface for this 'multicast_group'; set 'host' to the interface's address"
    return f"cannot be opened ({error.strerror}); check 'host' and 'port'"


def _is_group(value: str | None) -> str | None:
    try:
        if value is None or ipaddress.IPv4Address(value).is_multicast:
            return value
    except ValueError:
        pass
    raise ValueError("must be an IPv4 multicast address, such as 239.255.0.1")


MulticastGroup = Annotated[
    str | None,
    AfterValidator(_is_group),
    Field(description="IPv4 address of a group to join"),
]
