"""The process of an operator's page: reads pictures from standard input, and serves pages.

It uses plain HTTP with server-sent events, from the standard library alone, and nothing from
elsewhere. It exits when its input ends. ``page`` and ``fleet`` run it, for one cell and for many.
"""

import argparse
import contextlib
import json
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from typing import Any
from urllib.parse import SplitResult, urlsplit

from hri_predict.base.looks import LOOKS
from hri_predict.operation.monitoring.fleet_levels import WORST_FIRST
from hri_predict.protocol.messages import LEVELS, Level
from hri_predict.viewing.operator.state import State
from hri_predict.viewing.picture import read

SOONEST_S = 0.05
"""Minimum interval of updates to browsers while alerts arrive or are marked as read,"""
QUIET_S = 0.5
"""and maximum interval: a page without updates for longer turns grey."""
FAREWELL_S = 1.0
MAX_BROWSERS = 32
MAX_CONNECTIONS = 96
"""Maximum number of listening browsers, and of other requests; each has a thread and a file."""
REQUEST_S = 5.0
"""Time limit for a whole request; the socket's own time limit restarts with every byte."""
SENDS_BYTES = 65_536
"""Maximum amount of unread data before a browser is disconnected."""
MAX_BODY = 1024
_KINDS = {"html": "text/html", "js": "text/javascript", "css": "text/css"}
_SHARED = ("common.js", "common.css", "looks.js", "looks.css")
_POLICY = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
_POLICY += "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"


_SLOWED = {level.name for level in LEVELS if level.rank >= Level.SLOW.rank}


def looks_script() -> str:
    """``LOOKS``: symbol, word, and whether the robot slows, by level, most urgent first."""
    looks = {
        name: {
            "shape": LOOKS[name].shape,
            "sign": LOOKS[name].sign,
            "word": LOOKS[name].word,
            "slows": name in _SLOWED,
        }
        for name in WORST_FIRST
    }
    return f'"use strict";\nconst LOOKS = {json.dumps(looks)};\n'


def looks_style() -> str:
    """Return the colours of each level, for elements of its class."""
    colours = ((name, LOOKS[name]) for name in WORST_FIRST)
    return "".join(
        f".{name} {{ --field: {look.field}; --ink: {look.ink}; }}\n" for name, look in colours
    )


_MADE = {"looks.js": looks_script, "looks.css": looks_style}


class Server(ThreadingHTTPServer):
    """Serves one state to all browsers.

    Args:
        name: name of the page's files NAME.html, NAME.js, NAME.css.
        urls: addresses under which proxies serve the page; see ``Published``.
        request_s: see ``REQUEST_S``.
    """

    daemon_threads = True
    request_queue_size = 64

    def __init__(
        self,
        *,
        host: str,
        port: int,
        state: State,
        name: str = "page",
        request_s: float = REQUEST_S,
        urls: Sequence[str] = (),
    ) -> None:
        if ":" in host:
            self.address_family = socket.AF_INET6
        super().__init__((host, port), _Handler)
        self.state, self.request_s = state, request_s
        self.published = Published(urls)
        own = {f"/{name}.{kind}": f"{name}.{kind}" for kind in ("js", "css")}
        self.files = {"/": f"{name}.html"} | own | {f"/{name}": name for name in _SHARED}
        self.browsers = threading.BoundedSemaphore(MAX_BROWSERS)
        self._connections = threading.BoundedSemaphore(MAX_CONNECTIONS)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread, unless there are too many already."""
        if self._connections.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._connections.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore the error of a browser that disconnected."""


class _Handler(BaseHTTPRequestHandler):
    server: Server
    timeout = 10.0
    server_version, sys_version = "hri-predict", ""

    def setup(self) -> None:
        super().setup()
        self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SENDS_BYTES)
        self._slow = threading.Timer(self.server.request_s, self._cut)
        self._slow.daemon = True
        self._slow.start()

    def finish(self) -> None:
        self._slow.cancel()
        super().finish()

    def _cut(self) -> None:
        with contextlib.suppress(OSError):
            self.connection.shutdown(socket.SHUT_RDWR)

    def do_GET(self) -> None:
        self._slow.cancel()
        if not self._is_ours():
            return
        path = self.server.published.inner(self.path)
        if path == "":
            self._redirect(f"{self.path}/")  # the page's own names are relative
        elif path == "/events":
            self._events()
        elif (name := self.server.files.get(path)) is not None:
            self._answer(200, _content(name), f"{_KINDS[name.rsplit('.')[-1]]}; charset=utf-8")
        else:
            self._answer(404, b"no such page")

    def do_POST(self) -> None:
        if not self._is_ours():
            return
        try:
            length = int(self.headers.get("Content-Length", "0"))
            path = self.server.published.inner(self.path)
            if path != "/acknowledge" or not 0 < length <= MAX_BODY:
                raise ValueError
            asked = json.loads(self.rfile.read(length))
            ((which, number),) = asked.items()
            if which not in ("number", "up_to") or type(number) is not int:
                raise ValueError
        except (ValueError, AttributeError, RecursionError):
            self._answer(400, b'POST /acknowledge takes {"number": N} or {"up_to": N}')
            return
        found = self.server.state.acknowledge(number, with_older=which == "up_to")
        self._answer(204 if found else 404, b"")

    def _is_ours(self) -> bool:
        """Refuse pages of other sites, by requested host name and stated origin.

        A foreign host name that resolves to this address must not give access to the page.
        """
        with contextlib.suppress(ValueError):  # neither name nor address
            host = urlsplit(f"//{self.headers.get('Host', '')}").hostname or ""
            origin = self.headers.get("Origin")
            published = self.server.published
            is_own = origin is None or urlsplit(origin).netloc == self.headers.get("Host")
            is_own = is_own or origin in published.origins
            names = ("localhost", socket.gethostname().lower(), *published.hosts)
            if is_own and (_is_address(host) or host in names):
                return True
        self._answer(403, b"ask for this page by its address, or start it with --operator-url")
        return False

    def _events(self) -> None:
        if not self.server.browsers.acquire(blocking=False):
            self._answer(503, b"too many browsers")
            return
        try:
            self._start(200, "text/event-stream")
            state = self.server.state
            seen, alerts = 0, -1
            while not state.ended:
                alerts = self._tell(alerts)
                time.sleep(SOONEST_S)
                state.wait_for_alerts(alerts, state.told_s - SOONEST_S)
                seen = state.wait(seen, QUIET_S)
            self._tell(alerts)
        except OSError:
            pass  # the browser went away
        finally:
            self.server.browsers.release()

    def _tell(self, alerts: int) -> int:
        """Send everything except alerts that this browser has; return the version of its alerts."""
        said = self.server.state.told(alerts)
        self.wfile.write(f"data: {json.dumps(said)}\n\n".encode())
        self.wfile.flush()
        return int(said["alerts"])

    def _redirect(self, path: str) -> None:
        self.send_response(308)
        self.send_header("Location", path)
        self.send_header("Content-Length", "0")
        self.end_headers()

    def _answer(self, status: int, body: bytes, kind: str = "text/plain") -> None:
        self._start(status, kind, len(body))
        self.wfile.write(body)

    def _start(self, status: int, kind: str, length: int | None = None) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Content-Security-Policy", _POLICY)
        self.end_headers()

    def log_message(self, format: str, *args: Any) -> None:
        """Suppress log lines of requests."""


class Published:
    """Addresses under which proxies serve a page, such as ``https://plant.example/cells/7``.

    Headers from a proxy (``X-Forwarded-Host``, ``Forwarded``) are ignored, because anyone can send
    them. Only configured addresses are accepted.

    Attributes:
        hosts: host names.
        origins: ``Origin`` values of browsers that use these addresses.
    """

    def __init__(self, urls: Sequence[str]) -> None:
        parts = [urlsplit(url) for url in urls]
        self.hosts = {(part.hostname or "").lower() for part in parts}
        self.origins = {_origin(part) for part in parts}
        self._prefixes = sorted({part.path.rstrip("/") for part in parts}, key=len, reverse=True)

    def inner(self, path: str) -> str:
        """Return a path without the proxy's prefix; empty for the prefix without a slash."""
        for prefix in self._prefixes:
            if prefix and (path == prefix or path.startswith(f"{prefix}/")):
                return path[len(prefix) :]
        return path


def _origin(url: SplitResult) -> str:
    """Return the ``Origin`` of an address; browsers leave out the usual port of the scheme."""
    place = url.netloc.lower()
    if url.port == {"http": 80, "https": 443}.get(url.scheme):
        place = place.rpartition(":")[0]
    return f"{url.scheme}://{place}"


def _content(name: str) -> bytes:
    if name in _MADE:
        return _MADE[name]().encode()
    return resources.files("hri_predict.viewing.operator").joinpath(name).read_bytes()


def _is_address(host: str) -> bool:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        socket.inet_pton(family, host)
    except OSError:
        return False
    return True


def _take(state: State) -> None:
    try:
        while (picture := read(sys.stdin.buffer)) is not None:
            state.take(picture, time.monotonic())
    except (ValueError, KeyError, TypeError) as error:
        print(f"the operator's page exits: {error}", file=sys.stderr)
    state.end()


def serve(state: State, name: str) -> None:
    """Serve a page until the pipe ends; main function of ``python -m``.

    Args:
        state: the page's content, updated by pictures.
        name: name of its files.
    """
    parser = argparse.ArgumentParser()
    parser.add_argument("--host", required=True)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--url", action="append", default=[])
    args = parser.parse_args()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who feeds us gets it too; its end is our end
    os.nice(10)  # who feeds us goes first
    server = Server(host=args.host, port=args.port, state=state, name=name, urls=args.url)
    threading.Thread(target=server.serve_forever, name="pages", daemon=True).start()
    host, port = server.server_address[:2]
    address = f"[{host!s}]" if ":" in str(host) else str(host)
    print(f"http://{address}:{port}", flush=True)
    _take(state)
    time.sleep(FAREWELL_S)  # browsers take the last word
