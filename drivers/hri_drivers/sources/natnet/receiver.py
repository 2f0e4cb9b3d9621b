"""The sockets of a NatNet client: one for Motive's command port, one for a multicast group."""

import contextlib
import select
import socket
import time
from collections.abc import Callable

from hri_drivers.sources.natnet.packets import request
from hri_drivers.sources.udp_receiver import UdpReceiver
from hri_predict.base.errors import SourceError

ASK_S = 0.5
"""Interval of requests, and of the keep-alive messages that unicast needs."""
NEXT_S = 0.05
"""Interval if the needed information changes, for example to the models once the version is
known."""
LARGEST = 65_507
AT_ONCE = 64


class NatNetReceiver:
    """See ``hri_drivers.sources.live.Receiver``; receives only from the server.

    Args:
        server: address of the machine that runs Motive.
        command_port: Motive's.
        host: address of this machine's interface.
        group: the multicast group, or ``None`` for unicast.
        data_port: the group's port.
        wanted: returns the message to send next.
    """

    def __init__(
        self,
        *,
        server: str,
        command_port: int,
        host: str,
        group: str | None,
        data_port: int,
        wanted: Callable[[], int],
    ) -> None:
        self._server = (server, command_port)
        self._host = host
        self._group = None if group is None else _Group(server, host, data_port, group)
        self._wanted = wanted
        self._socket: socket.socket | None = None
        self._asked_s = -ASK_S
        self._asked: int | None = None

    def open(self) -> None:
        """Open the sockets.

        Raises:
            SourceError: the address is not this machine's, or the port is taken.
        """
        self.close()
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            opened.bind((self._host, 0))
        except OSError as error:
            opened.close()
            raise SourceError(
                f"udp {self._host}: {error.strerror}; correct 'host', the address of this machine"
            ) from error
        opened.setblocking(False)
        self._socket = opened
        if self._group is not None:
            self._group.open()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the datagrams that have arrived; send the next request to Motive."""
        if self._socket is None:
            raise SourceError("natnet: the socket is closed; open it first")
        self._ask(self._socket)
        group = self._group.socket if self._group is not None else None
        sockets = [self._socket] if group is None else [self._socket, group]
        ready, _, _ = select.select(sockets, [], [], timeout_s)
        found = self._replies(self._socket) if self._socket in ready else []
        if self._group is not None and group in ready:
            found += self._group.read(0.0)
        return found

    def close(self) -> None:
        """Close the sockets."""
        opened, self._socket = self._socket, None
        if opened is not None:
            opened.close()
        if self._group is not None:
            self._group.close()

    def _ask(self, opened: socket.socket) -> None:
        now_s, wanted = time.monotonic(), self._wanted()
        if now_s - self._asked_s >= (ASK_S if wanted == self._asked else NEXT_S):
            self._asked_s, self._asked = now_s, wanted
            with contextlib.suppress(OSError):  # unreachable for now; it is asked again
                opened.sendto(request(wanted), self._server)

    def _replies(self, opened: socket.socket) -> list[bytes]:
        found: list[bytes] = []
        with contextlib.suppress(BlockingIOError, ConnectionError):
            for _ in range(AT_ONCE):
                data, sender = opened.recvfrom(LARGEST)
                if sender[0] == self._server[0]:
                    found.append(data)
        return found


class _Group(UdpReceiver):
    """The multicast group, in which only the server's datagrams are accepted."""

    def __init__(self, server: str, host: str, port: int, group: str) -> None:
        super().__init__(host, port, group, LARGEST)
        self._only = server

    @property
    def socket(self) -> socket.socket | None:
        """The open socket."""
        return self._socket

    def accepts(self, sender: object) -> bool:
        """Whether this address is the server's."""
        return isinstance(sender, tuple) and sender[0] == self._only
