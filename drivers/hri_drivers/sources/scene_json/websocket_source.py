"""``kind: websocket``: one scene per message over WebSocket (RFC 6455), text or binary UTF-8.

``codec`` defines the messages. A web page can open a WebSocket to any address that its browser
reaches, including this machine, but the browser sends its origin. The server accepts only pages
from the configured ``origins``, and programs, which send no origin.
"""

import contextlib
import logging
import socket
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal, Self

from pydantic import Field, field_validator, model_validator
from websockets.exceptions import ConnectionClosed, InvalidURI, WebSocketException
from websockets.frames import Frame, Opcode
from websockets.http11 import Request
from websockets.server import ServerProtocol
from websockets.sync.client import ClientConnection, connect
from websockets.uri import parse_uri

from hri_drivers.sources.live import Receiver
from hri_drivers.sources.scene_json.codec import MAX_BYTES, plain
from hri_drivers.sources.scene_json.json_source import SceneJsonSettings, SceneJsonSource
from hri_drivers.sources.tcp import (
    ALLOW_UNAUTHENTICATED,
    CONNECT_TIMEOUT_S,
    StreamServer,
    check_exposure,
)
from hri_predict.base.errors import SourceError, first_line
from hri_predict.base.quantities.safe_side import Safety, harmless
from hri_predict.contracts.source import SourceCounters

DEFAULT_PORT = 9872
_DATA = (Opcode.TEXT, Opcode.BINARY, Opcode.CONT)

log = logging.getLogger("hri_drivers.websocket")
log.setLevel(logging.CRITICAL)  # the library logs every failed handshake; we count them


class WebSocketSettings(SceneJsonSettings):
    """``source:`` of ``kind: websocket``."""

    kind: Literal["websocket"]
    url: str | None = Field(
        None,
        description="ws:// or wss:// address to connect to; default: the sender connects",
    )
    host: str = Field("127.0.0.1", min_length=1, description="address to listen on, without 'url'")
    port: int = Field(DEFAULT_PORT, ge=0, le=65535, description="TCP port")
    origins: list[str] = Field(
        [],
        description="web pages that may send, such as https://cell.example; default none",
    )

    allow_unauthenticated: bool = ALLOW_UNAUTHENTICATED

    safety: ClassVar[Safety] = harmless("port")

    @model_validator(mode="after")
    def _protected(self) -> Self:
        if self.url is None:
            check_exposure(self.host, self.allow_unauthenticated)
        return self

    @field_validator("url")
    @classmethod
    def _known_scheme(cls, url: str | None) -> str | None:
        if url is not None and not url.startswith(("ws://", "wss://")):
            raise ValueError("must begin with ws:// or wss://")
        try:
            if url is not None:
                parse_uri(url)
        except (InvalidURI, ValueError) as error:
            raise ValueError(
                f"{first_line(error)}; give it as ws://192.168.0.7:8765/scenes"
            ) from None
        return url


class WebSocketSplitter:
    """The server's side of one connection: extracts messages and prepares answers.

    Attributes:
        trouble: protocol error of the other side; ``None`` if none.
    """

    def __init__(self, origins: Sequence[str]) -> None:
        known: list[Any] = [None, *origins]  # None: no web page
        self.trouble: Exception | None = None
        self._protocol = ServerProtocol(origins=known, max_size=MAX_BYTES, logger=log)
        self._fragments = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the messages that they complete."""
        try:
            self._protocol.receive_data(data)
            for event in self._protocol.events_received():
                if isinstance(event, Request):
                    self._protocol.send_response(self._protocol.accept(event))
                elif isinstance(event, Frame) and event.opcode in _DATA:
                    self._fragments += event.data  # the protocol limits their sum
                    if event.fin:
                        message, self._fragments = self._fragments, b""
                        yield message
            self.trouble = self._protocol.handshake_exc or self._protocol.parser_exc
        except Exception as error:  # the library asserts rules that a stranger may break
            self.trouble = error

    def answer(self) -> bytes:
        """Bytes to send: handshake, pongs, and the close frame."""
        return b"".join(self._protocol.data_to_send())

    @property
    def over(self) -> bool:
        """Whether the connection has ended."""
        return self.trouble is not None or self._protocol.close_expected()


class WebSocketServer(StreamServer):
    """Waits for one sender; see ``hri_drivers.sources.live.Receiver``."""

    def __init__(
        self, host: str, port: int, origins: Sequence[str], counters: SourceCounters
    ) -> None:
        super().__init__(
            host=host,
            port=port,
            splitter=lambda: WebSocketSplitter(origins),
            places=1,
            counters=counters,
        )

    def _units(self, connection: socket.socket, data: bytes) -> list[bytes]:
        splitter = self._senders[connection].splitter
        assert isinstance(splitter, WebSocketSplitter)
        messages = list(splitter.feed(data))
        try:
            answer = splitter.answer()
            unsent = len(answer) - (connection.send(answer) if answer else 0)
        except OSError:
            unsent = 1
        if splitter.trouble is not None:
            self._counters.malformed += 1
            self._counters.note(plain(splitter.trouble) or "not a WebSocket")
        if unsent or splitter.over:  # a sender that takes not even our few bytes is no WebSocket
            self._lose(connection)
        return messages


class WebSocketClient:
    """Connects to a server that sends; see ``hri_drivers.sources.live.Receiver``."""

    def __init__(self, url: str) -> None:
        self._url = url
        self._connection: ClientConnection | None = None
        self._context = contextlib.ExitStack()

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: there is no answer, or the server is not a WebSocket.
        """
        self.close()
        try:
            connecting = connect(
                self._url,
                max_size=MAX_BYTES,
                compression=None,
                open_timeout=CONNECT_TIMEOUT_S,
                logger=log,
            )
            self._context.enter_context(connecting)
            self._connection = connecting
        except (OSError, WebSocketException, ValueError) as error:
            raise SourceError(
                f"{self._url}: {_why(error)}; start the server, or correct 'url'"
            ) from error

    def read(self, timeout_s: float) -> list[bytes]:
        """Return the message that arrives within ``timeout_s``, if any.

        Raises:
            SourceError: the connection is lost.
        """
        if self._connection is None:
            raise SourceError(f"{self._url} is closed; open it first")
        try:
            return [_as_bytes(self._connection.recv(timeout_s))]
        except TimeoutError:
            return []
        except ConnectionClosed as error:
            raise SourceError(f"{self._url}: lost ({error}); check the server") from error

    def close(self) -> None:
        """Hang up."""
        connection, self._connection = self._connection, None
        if connection is not None:
            with contextlib.suppress(Exception):  # a silent server must not block us
                connection.close_socket()
            with contextlib.suppress(Exception):
                self._context.close()


class WebSocketSource(SceneJsonSource):
    """See ``hri_predict.contracts.source.Source``."""

    settings_model = WebSocketSettings

    @staticmethod
    def _make_receiver(settings: WebSocketSettings, counters: SourceCounters) -> Receiver:
        if settings.url is not None:
            return WebSocketClient(settings.url)
        return WebSocketServer(settings.host, settings.port, settings.origins, counters)


def _why(error: Exception) -> str:
    """Reason for a missing connection, in one line."""
    if isinstance(error, TimeoutError):  # of the connection, of TLS, or of the handshake
        return f"no WebSocket server answers within {CONNECT_TIMEOUT_S:g} s"
    return first_line(error)


def _as_bytes(message: str | bytes) -> bytes:
    return message.encode() if isinstance(message, str) else message
