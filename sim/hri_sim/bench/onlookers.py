"""Observers of a node while it is measured: both screens, a reader of each, and three alert hooks.

The hooks fail slowly: two servers accept the connection and never answer, and a command never
exits. The process reads the data that the 3D view and the operator's page send to a browser, but
draws nothing, because a browser would run on another computer. For the same reason it has the
lowest priority.
"""

import contextlib
import importlib.util
import os
import socket
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hri_predict.base.errors import LinkError
from hri_sim.wires.child import Child, child
from hri_sim.wires.ports import free_tcp_port

TRY_AGAIN_S = 0.2
SCREENS_S = 60.0  # a screen that is not up by then never comes
NICE = 19
_TIMEOUT_S = 5.0  # the default of a hook: so long each attempt hangs


@dataclass(frozen=True)
class Onlookers:
    """Options with which a node runs observed.

    Attributes:
        flags: options of ``hri-predict run``.
        alerts: the block ``alerts:`` of its configuration.
        process: the reader; it sends a message after data from both screens, and reports the bytes
            received from each.
    """

    flags: list[str]
    alerts: dict[str, Any]
    process: Child


@contextlib.contextmanager
def onlookers() -> Iterator[Onlookers]:
    """Yield the options; servers and reader stop when the context exits.

    Raises:
        LinkError: a library of screens or hooks is not installed.
    """
    _check()
    with contextlib.ExitStack() as stack:
        viewer, operator = free_tcp_port(), free_tcp_port()
        silent = [stack.enter_context(_silent_server()) for _ in range(2)]
        watcher = stack.enter_context(child(watch, viewer, operator))
        hooks: list[dict[str, Any]] = [
            {"kind": "webhook", "url": f"http://127.0.0.1:{silent[0]}/"},
            {"kind": "mqtt", "host": "127.0.0.1", "port": silent[1], "tls": False},
            {"kind": "command", "command": [sys.executable, "-c", "import time; time.sleep(60)"]},
        ]
        every = {"debounce_s": 0.0, "rate_per_minute": 6000, "timeout_s": _TIMEOUT_S}
        yield Onlookers(
            ["--viewer", str(viewer), "--operator", str(operator)],
            {"to": [hook | every for hook in hooks]},
            watcher,
        )


def _check() -> None:
    for module, extra in (("viser", "viewer"), ("paho", "mqtt"), ("websockets", "viewer")):
        if importlib.util.find_spec(module) is None:
            raise LinkError(f"needs {module}: pip install 'hri-predict[{extra}]'")


@contextlib.contextmanager
def _silent_server() -> Iterator[int]:
    """Yield the port of a server that queues connections and never answers."""
    with socket.create_server(("127.0.0.1", 0), backlog=128) as server:
        yield int(server.getsockname()[1])


class _Watch(threading.Thread):
    """Reads one screen, reconnecting after each loss, and counts the bytes."""

    def __init__(self, read: Callable[[int], Iterator[int]], port: int) -> None:
        super().__init__(daemon=True)
        self._read, self._port = read, port
        self.seen = 0
        self.trouble = "nothing came"

    def run(self) -> None:
        while True:
            try:
                for count in self._read(self._port):
                    self.seen += count
            except (OSError, WebSocketException, ImportError) as error:
                self.trouble = f"{type(error).__name__}: {error}"
            time.sleep(TRY_AGAIN_S)


def _viewer(port: int) -> Iterator[int]:
    import viser  # the version is part of its protocol

    protocols = [Subprotocol(f"viser-v{viser.__version__}")]
    with connect(f"ws://127.0.0.1:{port}/", subprotocols=protocols, max_size=None) as connection:
        for message in connection:
            yield len(message)


def _operator(port: int) -> Iterator[int]:
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/events", timeout=10.0) as events:
        for line in events:
            yield len(line)


def watch(pipe: Connection, viewer: int, operator: int) -> dict[str, int]:
    """Read both screens and report the bytes of each; for ``child``.

    Raises:
        LinkError: a screen sent nothing.
    """
    os.nice(NICE)
    watches = {"viewer": _Watch(_viewer, viewer), "operator": _Watch(_operator, operator)}
    for each in watches.values():
        each.start()
    give_up_s = time.monotonic() + SCREENS_S
    while not all(each.seen for each in watches.values()):
        time.sleep(TRY_AGAIN_S)
        if time.monotonic() > give_up_s:
            trouble = [f"{name}: {w.trouble}" for name, w in watches.items() if not w.seen]
            raise LinkError("; ".join(trouble))
    pipe.send("both were seen")
    pipe.poll(None)
    return {name: each.seen for name, each in watches.items()}
