"""Real receivers for the tests, and alerts to send them."""

import socket
import socketserver
import ssl
import subprocess
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from hri_predict.operation.alerting.alert import Alert
from hri_predict.operation.alerting.sender import HookContext


def alert(level="stop", robot="arm", **changes: Any) -> Alert:
    values: dict[str, Any] = {
        "at": "2026-03-01T14:03:07.123+00:00",
        "time_s": 12.5,
        "robot": robot,
        "level": level,
        "was": "clear",
        "reason": "a person is too close",
        "detail": "",
        "clears_when": "everybody is far enough away",
        "separation_m": 0.7,
        "speed_limit_m_s": 0.0,
    }
    return Alert(**(values | changes))


def place(folder: Path, *, live: bool = True) -> HookContext:
    return HookContext(base_dir=folder, cell="cell7", live=live)


class WebServer(ThreadingHTTPServer):
    """Answers each POST with the next of ``statuses`` (the last stays), and keeps what came."""

    daemon_threads = True

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Poster)
        self.statuses = [200]
        self.headers: dict[str, str] = {}
        self.got: list[tuple[str, dict[str, str], bytes]] = []

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that does not trust us is no error of ours."""


class _Poster(BaseHTTPRequestHandler):
    server: WebServer

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.got.append((self.path, dict(self.headers), body))
        statuses = self.server.statuses
        self.send_response(statuses.pop(0) if len(statuses) > 1 else statuses[0])
        self.send_header("Location", f"{self.server.url}/elsewhere")
        for name, value in self.server.headers.items():
            self.send_header(name, value)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Say nothing."""


@contextmanager
def web_server(tls: ssl.SSLContext | None = None) -> Iterator[WebServer]:
    server = WebServer()
    if tls is not None:
        server.socket = tls.wrap_socket(server.socket, server_side=True)
    with serving(server):
        yield server


@contextmanager
def serving(server: socketserver.BaseServer) -> Iterator[None]:
    thread = threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


@contextmanager
def accepting(talk: Callable[[socket.socket], None]) -> Iterator[int]:
    """A port; ``talk`` has each connection in a thread of its own."""
    listener = socket.create_server(("127.0.0.1", 0))

    def accept() -> None:
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=talk, args=(connection,), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield listener.getsockname()[1]
    finally:
        listener.shutdown(socket.SHUT_RDWR)
        listener.close()


@contextmanager
def silent_server(word: bytes = b"", every_s: float = 0.05) -> Iterator[int]:
    """A port that accepts and never answers, or sends ``word`` now and then without an end."""
    ended = threading.Event()

    def drip(connection: socket.socket) -> None:
        with connection:
            while not ended.wait(every_s):
                try:
                    connection.sendall(word)
                except OSError:
                    return

    with accepting(drip) as port:
        try:
            yield port
        finally:
            ended.set()


@contextmanager
def flooding_server(first: bytes, then: bytes) -> Iterator[tuple[int, list[int]]]:
    """A port that sends ``first`` and then ``then`` as fast as it is taken; how much was taken."""
    taken = [0]

    def flood(connection: socket.socket) -> None:
        with connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
            try:
                connection.sendall(first)
                while True:
                    taken[0] += connection.send(then)
            except OSError:
                return

    with accepting(flood) as port:
        yield port, taken


IN_BUFFERS = 20_000_000
"""What the system's buffers for a connection may hold, bytes; seconds of a flood are far more."""


def certificate(folder: Path) -> tuple[Path, Path]:
    """A certificate for ``localhost`` and its key, made by openssl; it vouches for itself."""
    made, key = folder / "server.pem", folder / "server.key"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    command += ["-nodes", "-days", "2", "-subj", "/CN=localhost", "-addext"]
    command += ["subjectAltName=DNS:localhost", "-keyout", str(key), "-out", str(made)]
    subprocess.run(command, check=True, capture_output=True)
    return made, key


def server_tls(folder: Path) -> ssl.SSLContext:
    made, key = certificate(folder)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(made, key)
    return context
