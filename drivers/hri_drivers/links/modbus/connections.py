"""The server's connections: their number and their unread replies are limited.

pymodbus limits neither. Without a limit, clients that never close their connections use up all
files that the node's process may open, and a client that sends requests and does not read replies
uses up its memory.
"""

import asyncio
import logging
import time
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler

log = logging.getLogger(__name__)

MOST = 32
"""Maximum number of open connections. A further one closes the connection that has been silent for
the longest: a PLC that lost power leaves a connection behind, and must be able to reconnect."""
MOST_UNREAD = 65_536
"""Maximum number of reply bytes that a client may leave unread."""


class Connection(ServerRequestHandler):
    """A client's connection.

    Attributes:
        heard_s: time at which bytes last arrived, or at which the connection was opened.
    """

    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self.heard_s = time.monotonic()

    @property
    def writes(self) -> asyncio.WriteTransport | None:
        """Its transport; ``None`` if it is not open yet or is closing."""
        found = self.transport
        if not isinstance(found, asyncio.WriteTransport) or found.is_closing():
            return None
        return found

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """See pymodbus; close a connection with too many unread replies."""
        self.heard_s = time.monotonic()
        writes = self.writes
        if writes is not None and writes.get_write_buffer_size() > MOST_UNREAD:
            log.warning("Modbus server: a client does not read its replies; connection closed")
            writes.abort()
            return len(data)
        return super().callback_data(data, addr)


class LimitedServer(ModbusTcpServer):
    """A server of at most ``MOST`` connections."""

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
