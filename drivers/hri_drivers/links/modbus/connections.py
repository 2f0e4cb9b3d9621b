"""Connections of the Modbus TCP server: requests in order, and limits of what clients may use."""

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler
from pymodbus.simulator import SimDevice

log = logging.getLogger(__name__)

READ, WRITE = (3, 4), (6, 16)
"""Functions that are answered."""
MOST = 32
"""Maximum number of open connections. A further one closes the connection that has been silent for
the longest: a PLC that lost power leaves a connection behind, and must be able to reconnect."""
MOST_UNREAD = 65_536
"""Maximum number of reply bytes that a client may leave unread."""
MOST_WAITING = 256
"""Maximum number of requests that a client may send before it gets the reply to the first."""
_HEADER = 6  # bytes before those that the header counts: transaction, protocol, length
_LENGTHS = range(2, 255)  # Modbus messaging on TCP/IP 1.0b, 4.1: unit and PDU
_FUNCTION = 7  # its place in a request


class Connection(ServerRequestHandler):
    """A client's connection; its requests are answered one after the other.

    pymodbus alone reads one request of each segment, and loses what arrives before it has replied.

    Args:
        server: the server; the other arguments are pymodbus's.

    Attributes:
        heard_s: time at which bytes last arrived, or at which the connection was opened.
    """

    def __init__(self, server: "LimitedServer", *of: Any) -> None:
        super().__init__(server, *of)
        self.heard_s = time.monotonic()
        self._dropped = server.dropped
        self._come = b""
        self._requests: deque[bytes] = deque()
        self._answering = False

    @property
    def writes(self) -> asyncio.WriteTransport | None:
        """Its transport; ``None`` if it is not open yet or is closing."""
        found = self.transport
        if not isinstance(found, asyncio.WriteTransport) or found.is_closing():
            return None
        return found

    def data_received(self, data: bytes) -> None:
        """See asyncio; take whole requests, and close a connection that goes beyond a limit."""
        self.heard_s = time.monotonic()
        writes = self.writes
        if writes is not None and writes.get_write_buffer_size() > MOST_UNREAD:
            self._end("a client does not read its replies")
            return
        self._come += data
        while len(self._come) >= _HEADER:
            length = int.from_bytes(self._come[4:_HEADER], "big")
            if self._come[2:4] != b"\0\0" or length not in _LENGTHS:
                self._end("a client sent bytes that are not Modbus TCP")
                return
            if len(self._come) < _HEADER + length:
                break
            request, self._come = self._come[: _HEADER + length], self._come[_HEADER + length :]
            self._requests.append(request)
            if len(self._requests) > MOST_WAITING:
                self._end(f"a client sent more than {MOST_WAITING} requests ahead of the replies")
                return
        self._answer()

    async def handle_request(self) -> None:
        """See pymodbus; then answer the next request."""
        try:
            await super().handle_request()
        finally:
            self._answering = False
            self._answer()

    def _answer(self) -> None:
        """Begin with the next request, if none is being answered.

        Requests that arrived before the client closed its connection are carried out, too.
        """
        while self._requests and not self._answering:
            super().callback_data(self._requests.popleft())
            self._answering = self.last_pdu is not None  # else it is answered, with an exception

    def _end(self, why: str) -> None:
        """Close the connection; what waits is not carried out."""
        self._dropped(sum(each[_FUNCTION] in WRITE for each in self._requests))
        self._requests.clear()
        self._come = b""
        log.warning("Modbus server: %s; connection closed", why)
        if (writes := self.writes) is not None:
            writes.abort()


class LimitedServer(ModbusTcpServer):
    """A server of at most ``MOST`` connections.

    pymodbus limits neither their number nor their unread replies. Without a limit, clients that
    never close their connections use up all files that the node's process may open, and a client
    that sends requests and does not read replies uses up its memory.

    Args:
        device: the registers.
        address: host and port to listen on.
        dropped: called with the number of write requests that a connection did not carry out.
    """

    def __init__(
        self, device: SimDevice, address: tuple[str, int], dropped: Callable[[int], None]
    ) -> None:
        super().__init__(device, address=address)
        self.dropped = dropped

    async def listen(self) -> bool:
        """See pymodbus, which would only log why it cannot listen.

        Raises:
            OSError: it cannot listen on the address.
        """
        create, failed = self.call_create, list[OSError]()

        async def noted() -> Any:
            try:
                return await create()
            except OSError as error:
                failed.append(error)
                raise

        self.call_create = noted
        if not await super().listen():
            raise failed[0]
        return True

    def callback_new_connection(self) -> Connection:
        """See pymodbus; close the most silent connection if there are too many."""
        held = [c for c in self.active_connections.values() if isinstance(c, Connection)]
        opened = [(c.heard_s, writes) for c in held if (writes := c.writes) is not None]
        opened.sort(key=lambda each: each[0])
        for _, writes in opened[: max(0, len(opened) - MOST + 1)]:
            log.warning(
                "Modbus server: more than %d connections; the one that has been silent for the "
                "longest was closed",
                MOST,
            )
            writes.abort()
        return Connection(self, self.trace_packet, self.trace_pdu, self.trace_connect)
