"""The server's connections: a limited number, and none that piles up replies.

pymodbus limits neither. Without a limit, clients that open connections and never close them take
all files that the node's process may open, and one that asks and does not read takes its memory.
"""

import asyncio
import logging
import time
from typing import Any

from pymodbus.server import ModbusTcpServer
from pymodbus.server.requesthandler import ServerRequestHandler

log = logging.getLogger(__name__)

MOST = 32
"""Connections at once. One more ends the one that has been silent for the longest: a PLC that lost
its power leaves a connection behind, and must be able to come back."""
MOST_UNREAD = 65_536
"""Bytes of replies that a client may leave unread."""


class Connection(ServerRequestHandler):
    """A client's connection.

    Attributes:
        heard_s: when bytes arrived last, or when it was opened.
    """

    def __init__(self, *of: Any) -> None:
        super().__init__(*of)
        self.heard_s = time.monotonic()

    @property
    def writes(self) -> asyncio.WriteTransport | None:
        """Its transport; ``None`` if it is not open yet, or ends."""
        found = self.transport
        if not isinstance(found, asyncio.WriteTransport) or found.is_closing():
            return None
        return found

    def callback_data(self, data: bytes, addr: tuple[Any, ...] | None = None) -> int:
        """See pymodbus; end a connection of which too many replies were not read."""
        self.heard_s = time.monotonic()
        writes = self.writes
        if writes is not None and writes.get_write_buffer_size() > MOST_UNREAD:
            log.warning("Modbus server: a client does not read its replies; connection ended")
            writes.abort()
            return len(data)
        return super().callback_data(data, addr)


class LimitedServer(ModbusTcpServer):
    """A server of at most ``MOST`` connections."""

    def callback_new_connection(self) -> Connection:
        """See pymodbus; make room."""
        held = [c for c in self.active_connections.values() if isinstance(c, Connection)]
        opened = [(c.heard_s, writes) for c in held if (writes := c.writes) is not None]
        opened.sort(key=lambda each: each[0])
        for _, writes in opened[: max(0, len(opened) - MOST + 1)]:
            log.warning(
                "Modbus server: more than %d connections; the one that has been silent for the "
                "longest was ended",
                MOST,
            )
            writes.abort()
        return Connection(self, self.trace_packet, self.trace_pdu, self.trace_connect)
