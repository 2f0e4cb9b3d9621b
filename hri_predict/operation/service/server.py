"""Answers GET /metrics and GET /healthz over HTTP, in a separate thread.

Clients are not trusted: each connection may send one request of limited length within a limited
time, and the number of connections is limited. Clients cannot affect the loop.
"""

import asyncio
import json
import logging
import math
import socket
import threading
import time
from collections.abc import Callable

from hri_predict.base.errors import ConfigError
from hri_predict.operation.service.exposition import CONTENT_TYPE, as_text
from hri_predict.operation.service.figures import Figures
from hri_predict.operation.service.settings import MetricsSettings

log = logging.getLogger(__name__)

CONNECTIONS = 16
REQUEST_BYTES = 8192
REQUEST_S = 2.0
"""Time limit from the connection to the last byte of the answer."""
KEEP_S = 0.5
"""Time within which further requests for metrics get the same text. Building it uses the
interpreter that also runs the loop, so a flood of requests must not rebuild it often.
"""
END_S = 2.0


class MetricsServer:
    """The server; listens as soon as it is constructed.

    Args:
        settings: address to listen on.
        figures: the figures to serve.
        request_s: see ``REQUEST_S``.

    Attributes:
        answered, refused, failed: answered requests; connections above the maximum; connections
            that were too slow, too long, or broken.

    Raises:
        ConfigError: the port is in use, or the address does not belong to this machine.
    """

    def __init__(
        self, settings: MetricsSettings, figures: Figures, request_s: float = REQUEST_S
    ) -> None:
        self._figures, self._request_s = figures, request_s
        self.answered = self.refused = self.failed = 0
        self._open = 0
        self._kept, self._kept_s = b"", -math.inf
        self._socket = _listening(settings)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, name="metrics", daemon=True)
        self._up = threading.Event()
        self._thread.start()
        self._up.wait(END_S)

    def close(self) -> None:
        """Stop answering; safe to call twice."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join(END_S)
        self._socket.close()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.set_exception_handler(self._trouble)
        serving = asyncio.start_server(self._serve, sock=self._socket, limit=REQUEST_BYTES)
        server = self._loop.run_until_complete(serving)
        self._up.set()
        try:
            self._loop.run_forever()
        finally:
            server.close()
            for task in asyncio.all_tasks(self._loop):
                task.cancel()
            self._loop.run_until_complete(asyncio.sleep(0))
            self._loop.close()

    def _trouble(self, _loop: asyncio.AbstractEventLoop, what: dict[str, object]) -> None:
        self.failed += 1
        log.warning("metrics: %s", what.get("exception") or what.get("message"))

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._open >= CONNECTIONS:
            self.refused += 1
            writer.transport.abort()
            return
        self._open += 1
        try:
            async with asyncio.timeout(self._request_s):
                request = await reader.readuntil(b"\r\n\r\n")
                writer.write(self._answer(request))
                writer.close()
                await writer.wait_closed()
                self.answered += 1
        except (TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError, OSError):
            self.failed += 1
        finally:
            self._open -= 1
            writer.transport.abort()  # what a slow client did not take is dropped

    def _answer(self, request: bytes) -> bytes:
        words = request.split(b"\r\n", 1)[0].split(b" ")
        if len(words) != 3 or not words[2].startswith(b"HTTP/1."):
            return _response("400 Bad Request", "not a valid request\n")
        method, path = words[0], words[1].split(b"?", 1)[0]
        if method not in (b"GET", b"HEAD"):
            return _response("405 Method Not Allowed", "only GET\n", "Allow: GET, HEAD\r\n")
        pages: dict[bytes, Callable[[], bytes]] = {
            b"/metrics": self._metrics,
            b"/healthz": self._health,
        }
        if path not in pages:
            return _response("404 Not Found", "available: /metrics and /healthz\n")
        whole = pages[path]()
        return whole if method == b"GET" else whole.partition(b"\r\n\r\n")[0] + b"\r\n\r\n"

    def _metrics(self) -> bytes:
        now_s = time.monotonic()
        if now_s - self._kept_s >= KEEP_S:
            text = as_text(self._figures.families())
            self._kept, self._kept_s = _response("200 OK", text, kind=CONTENT_TYPE), now_s
        return self._kept

    def _health(self) -> bytes:
        is_well, said = self._figures.health()
        status = "200 OK" if is_well else "503 Service Unavailable"
        return _response(status, json.dumps(said) + "\n", kind="application/json")


def _listening(settings: MetricsSettings) -> socket.socket:
    try:
        found = socket.getaddrinfo(settings.host, settings.port, type=socket.SOCK_STREAM)
        family, kind, protocol, _, address = found[0]
        server = socket.socket(family, kind | socket.SOCK_CLOEXEC, protocol)
        server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            server.bind(address)
        except OSError:
            server.close()
            raise
    except (OSError, UnicodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "is not an address"
        raise ConfigError(
            f"metrics: {settings.host} port {settings.port}: {why}; choose another port or host"
        ) from error
    return server


def _response(status: str, body: str, more: str = "", kind: str = "text/plain") -> bytes:
    data = body.encode()
    head = (
        f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(data)}\r\n"
        f"Cache-Control: no-store\r\n{more}Connection: close\r\n\r\n"
    )
    return head.encode() + data
