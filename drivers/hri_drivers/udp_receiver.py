"""A UDP socket that datagrams come to."""

import contextlib
import errno
import ipaddress
import socket
import sys

from hri_predict.errors import SourceError

LARGEST = 65_535
_IP_MULTICAST_ALL = 49  # <linux/in.h>; Python has no name for it
AT_ONCE = 64  # datagrams for one ``read``, so that a flood does not keep it for ever


def is_loopback(host: str) -> bool:
    """Whether only this machine's own programs can send there."""
    return ipaddress.ip_address(host).is_loopback


class UdpReceiver:
    """``live_source.Receiver`` of datagrams: one element of ``read`` is one datagram.

    Args:
        host: address to bind; of the network interface, or of all: ``0.0.0.0`` or ``::``.
        port: 0 lets the system choose; see ``port``.
        multicast_group: address of a group to join on the interface whose address is ``host``.
        largest: bytes of the longest datagram that is of any use; a longer one is cut to one more.
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
        """Port that datagrams must be sent to; 0 until one is open."""
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
                # bound to the group, nothing that is sent to this machine alone comes in
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
        """Datagrams that have come, waiting for the first at most ``timeout_s``.

        Raises:
            SourceError: the socket is lost.
        """
        opened = self._socket
        if opened is None:
            raise SourceError(f"udp {self._host}: the socket is closed; open it first")
        datagrams: list[bytes] = []
        try:
            opened.settimeout(timeout_s)
            datagrams.append(opened.recv(self._size))
            opened.settimeout(0.0)
            while len(datagrams) < AT_ONCE:
                datagrams.append(opened.recv(self._size))
        except (TimeoutError, BlockingIOError):
            pass
        except OSError as error:
            raise SourceError(f"udp {self._host}: lost ({error}); check the network") from error
        return datagrams

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
        if sys.platform == "linux":  # not what other programs joined on other interfaces
            opened.setsockopt(socket.IPPROTO_IP, _IP_MULTICAST_ALL, 0)


def _remedy(error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return "another program has this port; stop it, or choose another 'port'"
    if error.errno == errno.EADDRNOTAVAIL:
        return "not an address of this machine; correct 'host'"
    if error.errno == errno.EACCES:
        return "not permitted; choose a 'port' above 1023"
    if error.errno == errno.ENODEV:
        return "no interface for this 'multicast_group'; set 'host' to the interface's address"
    return f"cannot be opened ({error.strerror}); check 'host' and 'port'"
