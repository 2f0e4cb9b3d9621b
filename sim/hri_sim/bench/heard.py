"""A node in its own process, measured in real time by a receiver in another process.

``hri-predict run`` runs the cell of ``cell.settings`` on a real wire. A receiver at the wire's
other end stamps each unit on arrival, as well as the bytes of a bare loop: a process that only
sleeps until absolute deadlines at the node's rate. At that moment, no node on this machine can be
more punctual than the bare loop.
"""

import contextlib
import importlib.util
import itertools
import json
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.errors import LinkError
from hri_predict.base.machine.orphans import command_of
from hri_sim.bench import cell
from hri_sim.bench.processes import cores_busy, processor_time, resident_mib
from hri_sim.bench.receiver import bare_loop, hear
from hri_sim.wires.child import Child, child
from hri_sim.wires.ports import free_tcp_port

WARM_UP_S = 6.0  # the publish phase is learned from the ticks so far
START_S = 120.0  # a cold start compiles
CYCLES = 256  # the modulus of Status.cycle on the wire


def heard(
    *,
    wire: str,
    predictor: str,
    rate_hz: float,
    seconds: float,
    cache: Path | None = None,
    watched: bool = False,
    captures_hz: float | None = None,
    change: Callable[[dict[str, Any]], None] = lambda settings: None,
    partner: Sequence[Any] = (),
) -> dict[str, Any]:
    """Start a node on a wire, receive its messages for some seconds, and stop it.

    Args:
        wire: one of ``EARS``.
        predictor: name of the predictor.
        rate_hz: the node's rate.
        seconds: time to receive, after the warm-up; 0: only the start is measured.
        cache: the node's cache folder; ``None``: the user's own.
        watched: run both screens, a reader for each, and three alert hooks that fail slowly.
        captures_hz: capture rate of the source; default: five a second more than ticks.
        change: called with the configuration's settings before the node starts.
        partner: a function for ``child`` and its arguments: another process, started once the node
            runs; that process sends a message when it is ready.

    Returns:
        ``summary``: the node's output on exit; ``partner``: the other process's report;
        ``window_ns``: start and end of the measured time;
        ``first_advice_s``: time from starting the process to the first Advice of a running node;
        ``resident_mib``: memory of the node's processes at the end; ``cpu_percent``: share of one
        core, by group of threads; ``cores_percent``: load of each core; ``deviation_ms``: deviation
        from the period of the intervals between its Status and Advice messages, and ``bare_ms`` the
        same deviation for the bare loop; ``missing``: number of cycles without a Status;
        ``stamps``, ``priority``: the clock that stamped the messages, and the receiver's
        scheduling.

    Raises:
        LinkError: this machine has no such wire, or the node did not start; the error gives the
            reason.
    """
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        looking = stack.enter_context(onlookers()) if watched else None
        receiver = stack.enter_context(receiving(wire, rate_hz))
        settings = cell.settings(
            predictor=predictor,
            rate_hz=rate_hz,
            captures_hz=captures_hz or rate_hz + 5.0,
            links=[receiver.receive()],
        )
        flags: list[str] = []
        if looking is not None:
            settings["alerts"], flags = looking.alerts, looking.flags
        change(settings)
        path = Path(folder) / "cell.yaml"
        path.write_text(yaml.safe_dump(settings), encoding="utf-8")
        began_ns = time.monotonic_ns()
        node = stack.enter_context(running_node(path, flags, cache))
        first_ns = receiver.receive(START_S, node)
        result: dict[str, Any] = {"first_advice_s": (first_ns - began_ns) * 1e-9}
        if looking is not None:
            looking.process.receive(START_S, node)  # both screens were seen
        other = stack.enter_context(child(*partner)) if partner else None
        if other is not None:
            other.receive()
        time.sleep(WARM_UP_S)
        if seconds > 0:
            result |= used_by(node.pid, seconds)
        result["resident_mib"] = resident_mib(node.pid)
        if looking is not None:
            result["seen_bytes"] = looking.process.report()
        if other is not None:
            result["partner"] = other.report()
        node.send_signal(signal.SIGTERM)
        result["summary"] = json.loads(node.communicate(timeout=30.0)[0])
        result["alerts"] = result["summary"].get("alerts", {})
        told = receiver.report()
    if seconds > 0:
        begin_ns, end_ns = result["window_ns"]
        result |= figures(told, begin_ns, end_ns, rate_hz)
    return result


@contextlib.contextmanager
def receiving(wire: str, rate_hz: float) -> Iterator[Child]:
    """Start the receiver at a wire's end, and the bare loop, whose bytes the receiver also
    receives.
    """
    reading, writing = multiprocessing.Pipe(duplex=False)
    with child(hear, wire, reading) as receiver, child(bare_loop, writing, rate_hz):
        reading.close()
        writing.close()
        yield receiver


@contextlib.contextmanager
def running_node(
    path: Path, flags: Sequence[str], cache: Path | None
) -> Iterator["subprocess.Popen[str]"]:
    """Run a node with this configuration until the context exits.

    Args:
        path: the configuration.
        flags: options of ``hri-predict run``.
        cache: the node's cache folder; ``None``: the user's own.
    """
    command = command_of("hri_predict", "run", str(path), "--json", *flags)
    environment = dict(os.environ)
    if cache is not None:
        environment["HRI_PREDICT_CACHE"] = environment["NUMBA_CACHE_DIR"] = str(cache)
    node = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    try:
        yield node
    finally:
        node.kill()
        node.communicate()


def used_by(pid: int, seconds: float) -> dict[str, Any]:
    """Let the node run for ``seconds``; return the resources that it used."""
    before, cores, begin_ns = processor_time(pid), cores_busy(), time.monotonic_ns()
    time.sleep(seconds)
    after, cores_after, end_ns = processor_time(pid), cores_busy(), time.monotonic_ns()
    elapsed_s = (end_ns - begin_ns) * 1e-9
    used = {group: 100.0 * (after[group] - before[group]) / elapsed_s for group in after}
    busy = [
        100.0 * (b1 - b0) / max(1e-9, t1 - t0)
        for (b0, t0), (b1, t1) in zip(cores, cores_after, strict=True)
    ]
    return {"cpu_percent": used, "cores_percent": busy, "window_ns": (begin_ns, end_ns)}


def figures(told: dict[str, Any], begin_ns: int, end_ns: int, rate_hz: float) -> dict[str, Any]:
    """Return the intervals of messages in the window; a missing Status gives a long interval."""
    inside = [m for m in told["messages"] if begin_ns <= m[1] <= end_ns]
    status = [(at, cycle) for kind, at, cycle in inside if kind == "Status"]
    steps = [(b[1] - a[1]) % CYCLES for a, b in itertools.pairwise(status)]
    times = {name: [at for kind, at, _ in inside if kind == name] for name in ("Status", "Advice")}
    bare = [at for at in told["bare"] if begin_ns <= at <= end_ns]
    return {
        "deviation_ms": [d for at in times.values() for d in deviations(at, rate_hz)],
        "bare_ms": deviations(bare, rate_hz),
        "ages_ms": [age for kind, _, age in inside if kind == "Advice" and age >= 0],
        "heard": len(times["Advice"]),
        "missing": sum(step - 1 for step in steps if step > 1),
        "stamps": told["stamps"],
        "priority": told["priority"],
    }


def deviations(at_ns: Sequence[int], rate_hz: float) -> list[float]:
    """Return the absolute difference between each interval and the period, in milliseconds."""
    at_ms = np.asarray(at_ns, np.float64) * 1e-6  # 0.1 ns of a day: floats hold it
    return [float(d) for d in np.abs(np.diff(at_ms) - 1e3 / rate_hz)]


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

    They are both screens, a reader of each, and three alert hooks that fail slowly: two servers
    accept the connection and never answer, and a command never exits. The process reads the data
    that the 3D view and the operator's page send to a browser, but draws nothing, because a browser
    would run on another computer. For the same reason it has the lowest priority.

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
            raise LinkError(f"needs {module}; install it with: pip install 'hri-predict[{extra}]'")


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
        from websockets.exceptions import WebSocketException

        while True:
            try:
                for count in self._read(self._port):
                    self.seen += count
            except (OSError, WebSocketException, ImportError) as error:
                self.trouble = f"{type(error).__name__}: {error}"
            time.sleep(TRY_AGAIN_S)


def _viewer(port: int) -> Iterator[int]:
    import viser  # the version is part of its protocol
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

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
