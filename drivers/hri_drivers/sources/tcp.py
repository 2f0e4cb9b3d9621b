"""Receivers of units over TCP: a server for senders, and a client of a sender.

A unit is a line or a datagram. Each connection has its own splitter, so a unit cut off by a lost
connection does not damage the next one.
"""

import contextlib
import errno
import select
import socket
import time
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from pydantic import Field

from hri_drivers.sources.udp_receiver import is_loopback
from hri_drivers.wires.tcp import keep_alive
from hri_predict.base.errors import SourceError
from hri_predict.contracts.source import SourceCounters

CHUNK = 65_536
CONNECT_TIMEOUT_S = 2.0
SILENT_S = 2.0
"""A connection without a complete unit for this long can be replaced by a new one. Single bytes or
pings do not prevent that."""


class Splitter(Protocol):
    """Finds units in the bytes of one connection, with bounded memory."""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the units that they complete."""


class _Sender(NamedTuple):
    """A connection's splitter, the time of its last unit, and the address of its machine."""

    splitter: Splitter
    heard_s: float
    machine: str


class StreamServer:
    """Waits for senders at a port; see ``hri_drivers.sources.live.Receiver``.

    It accepts at most ``places`` senders. A new sender never replaces one that still sends.

    Args:
        host, port: address to listen on.
        splitter: returns a new splitter for each connection.
        places: maximum number of senders connected at the same time.
        counters: counts ``disconnects``, ``reconnects`` and ``refused`` of the senders.
    """

    def __init__(
        self,
        *,
        host: str,
        port: int,
        splitter: Callable[[], Splitter],
        places: int,
        counters: SourceCounters,
    ) -> None:
        self._address = (host, port)
        self._splitter = splitter
        self._places = places
        self._counters = counters
        self._listener: socket.socket | None = None
        self._senders: dict[socket.socket, _Sender] = {}

    @property
    def port(self) -> int:
        """The open port: the system's choice if 0 is configured."""
        assert self._listener is not None
        return int(self._listener.getsockname()[1])

    @property
    def contradicted(self) -> bool:
        """Whether two machines are connected and were heard recently."""
        since_s = time.monotonic() - SILENT_S
        machines = {each.machine for each in self._senders.values() if each.heard_s > since_s}
        return len(machines) > 1

    def open(self) -> None:
        """Listen.

        Raises:
            SourceError: it cannot listen on the address.
        """
        self.close()
        try:
            family = socket.AF_INET6 if ":" in self._address[0] else socket.AF_INET
            self._listener = socket.create_server(self._address, family=family, backlog=4)
        except OSError as error:
            raise listen_error(self._address, error) from error
        self._listener.setblocking(False)

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the units of all senders that arrive within ``timeout_s``."""
        if self._listener is None:
            raise SourceError(f"{self._address[0]}:{self._address[1]} is closed; open it first")
        ready, _, _ = select.select([self._listener, *self._senders], [], [], timeout_s)
        units: list[bytes] = []
        for connection in ready:
            if connection is not self._listener:
                units += self._receive(connection)
        if self._listener in ready:  # last: a sender that hangs up frees its place
            self._accept()
        return units

    def close(self) -> None:
        """Close all connections and stop listening."""
        for connection in list(self._senders):
            self._drop(connection)
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()

    def _accept(self) -> None:
        assert self._listener is not None
        try:
            connection, address = self._listener.accept()
        except OSError:  # it has gone again
            return
        if len(self._senders) >= self._places and not self._make_room():
            self._counters.refused += 1
            connection.close()
            return
        connection.setblocking(False)
        if self._counters.disconnects > self._counters.reconnects:
            self._counters.reconnects += 1
        self._senders[connection] = _Sender(self._splitter(), time.monotonic(), address[0])

    def _make_room(self) -> bool:
        oldest = min(self._senders, key=lambda connection: self._senders[connection].heard_s)
        if time.monotonic() - self._senders[oldest].heard_s < SILENT_S:
            return False
        self._lose(oldest)
        return True

    def _receive(self, connection: socket.socket) -> list[bytes]:
        try:
            data = connection.recv(CHUNK)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._lose(connection)
            return []
        units = self._units(connection, data)
        if units and connection in self._senders:
            sender = self._senders[connection]
            self._senders[connection] = sender._replace(heard_s=time.monotonic())
        return units

    def _units(self, connection: socket.socket, data: bytes) -> list[bytes]:
        """Return the units of one sender."""
        return list(self._senders[connection].splitter.feed(data))

    def _lose(self, connection: socket.socket) -> None:
        self._drop(connection)
        self._counters.disconnects += 1

    def _drop(self, connection: socket.socket) -> None:
        del self._senders[connection]
        connection.close()


class StreamClient:
    """Connects to a server that sends; see ``hri_drivers.sources.live.Receiver``."""

    def __init__(self, host: str, port: int, splitter: Callable[[], Splitter]) -> None:
        self._address = (host, port)
        self._make_splitter = splitter
        self._splitter = splitter()
        self._connection: socket.socket | None = None

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: there is no answer.
        """
        self.close()
        try:
            self._connection = socket.create_connection(self._address, CONNECT_TIMEOUT_S)
            keep_alive(self._connection)
        except OSError as error:
            raise connect_error(self._address, error) from error
        self._splitter = self._make_splitter()

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the units that arrive within ``timeout_s``.

        Raises:
            SourceError: the connection is lost.
        """
        host, port = self._address
        if self._connection is None:
            raise SourceError(f"{host}:{port} is closed; open it first")
        try:
            self._connection.settimeout(timeout_s)
            data = self._connection.recv(CHUNK)
        except TimeoutError as error:
            if error.errno is None:
                return []
            raise SourceError(
                f"{host}:{port}: the sender no longer answers; check its power and its cable"
            ) from error
        except OSError as error:
            raise SourceError(f"{host}:{port}: lost ({error}); check the sender") from error
        if not data:
            raise SourceError(
                f"{host}:{port}: the sender closed the connection; restart the sender"
            )
        return list(self._splitter.feed(data))

    def close(self) -> None:
        """Hang up."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.close()


ALLOW_UNAUTHENTICATED: bool = Field(
    False, description="accept network input: believe any program that reaches the port"
)


def check_exposure(host: str, allowed: bool) -> None:
    """Refuse network input unless the configuration allows it.

    Raises:
        ValueError: ``host`` is not an IP address, or not on loopback and not ``allowed``.
    """
    try:
        local = is_loopback(host)
    except ValueError:
        raise ValueError("host must be an IP address of this machine, such as 127.0.0.1") from None
    if not local and not allowed:
        raise ValueError(
            f"host {host} accepts network input, and any program could claim an empty room: set "
            "'allow_unauthenticated: true' if you trust the whole network"
        )


def listen_error(address: tuple[str, int], error: OSError) -> SourceError:
    """The reason why it cannot listen on a port, and the remedy."""
    remedies = {
        errno.EADDRINUSE: "in use by another program; close that program, or choose another 'port'",
        errno.EADDRNOTAVAIL: "not an address of this machine; correct 'host'",
        errno.EACCES: "not permitted; choose a 'port' above 1023",
    }
    why = remedies.get(error.errno or 0, f"cannot listen there ({error}); correct 'host'")
    return SourceError(f"{address[0]}:{address[1]}: {why}")


def connect_error(address: tuple[str, int], error: OSError) -> SourceError:
    """Return the reason why an address does not answer, and the remedy."""
    if error.errno == errno.ECONNREFUSED:
        why = "connection refused; start the sender there, or correct 'port'"
    elif isinstance(error, TimeoutError):
        why = "no answer; check 'host' and the network"
    else:
        why = f"cannot be reached ({error}); correct 'host'"
    return SourceError(f"{address[0]}:{address[1]}: {why}")
