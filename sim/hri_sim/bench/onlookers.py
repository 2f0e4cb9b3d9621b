"""Readers of a node while it is heard: both screens, a reader of each, and three alert hooks.

    python -m hri_sim.bench.onlookers VIEWER_PORT OPERATOR_PORT

The hooks fail slowly: two servers take the connection and never answer, and a command never ends.
The process reads what a browser would be sent by the 3D view and by the operator's page, and draws
nothing: a browser belongs to another computer. It runs at the lowest priority for the same reason.
"""

import contextlib
import importlib.util
import json
import os
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from hri_predict.base.errors import LinkError

TRY_AGAIN_S = 0.2
SCREENS_S = 60.0  # a screen that is not up by then never comes
END_S = 10.0
NICE = 19
_TIMEOUT_S = 5.0  # the default of a hook: so long each attempt hangs


@dataclass(frozen=True)
class Onlookers:
    """Options of a node, so that it is looked at.

    Attributes:
        flags: of ``hri-predict run``.
        alerts: the block ``alerts:`` of its configuration.
        process: the reader; it prints a line when it has seen both screens.
    """

    flags: list[str]
    alerts: dict[str, Any]
    process: Any

    def seen(self) -> dict[str, int]:
        """End the process; how much it was sent by each screen, bytes."""
        told, _ = self.process.communicate(timeout=END_S)
        return {str(key): int(count) for key, count in json.loads(told).items()}


@contextlib.contextmanager
def onlookers() -> Iterator[Onlookers]:
    """Yield them; servers and watcher end with the context.

    Raises:
        LinkError: a library of screens or hooks is not installed.
    """
    _check()
    with contextlib.ExitStack() as stack:
        viewer, operator = _free_port(), _free_port()
        silent = [stack.enter_context(_silent_server()) for _ in range(2)]
        watcher = subprocess.Popen(
            [sys.executable, "-m", "hri_sim.bench.onlookers", str(viewer), str(operator)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        stack.callback(_end, watcher)
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


def _end(process: Any) -> None:
    process.kill()
    process.communicate()


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def _silent_server() -> Iterator[int]:
    """The port of a server whose queue takes connections, and who never answers."""
    with socket.create_server(("127.0.0.1", 0), backlog=128) as server:
        yield int(server.getsockname()[1])


class _Watch(threading.Thread):
    """Reads one screen, again after each loss, and counts the bytes."""

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


def main(viewer: int, operator: int) -> int:
    """Watch both screens until standard input ends; say when both were seen; the exit status."""
    os.nice(NICE)
    watches = {"viewer": _Watch(_viewer, viewer), "operator": _Watch(_operator, operator)}
    for watch in watches.values():
        watch.start()
    give_up_s = time.monotonic() + SCREENS_S
    while not all(watch.seen for watch in watches.values()):
        time.sleep(TRY_AGAIN_S)
        if time.monotonic() > give_up_s:
            trouble = [f"{name}: {w.trouble}" for name, w in watches.items() if not w.seen]
            print("; ".join(trouble), file=sys.stderr)
            return 1
    print(json.dumps({"ready": True}), flush=True)
    sys.stdin.read()
    print(json.dumps({name: watch.seen for name, watch in watches.items()}))
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1]), int(sys.argv[2])))
