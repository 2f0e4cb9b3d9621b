"""A node in a process of its own, as a receiver in another process hears it, in real time.

``hri-predict run`` runs the cell of ``cell.settings`` on a real wire. A receiver at the wire's
other end stamps what comes, and beside it the bytes of a bare loop: a process that sleeps to
absolute deadlines at the node's rate and does nothing else. What the bare loop shows, no node can
better on this machine in that minute.
"""

import contextlib
import itertools
import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.errors import LinkError
from hri_sim.bench import cell
from hri_sim.bench.onlookers import onlookers
from hri_sim.bench.processes import cores_busy, processor_time, resident_mib
from hri_sim.wires.pty import open_pty

WARM_UP_S = 1.0
START_S = 120.0  # a cold start compiles
MULTICAST = "239.74.163.3"
CYCLES = 256  # the modulus of Status.cycle on the wire
WIRES = ("serial pty 921600", "CAN FD udp_multicast", "CAN FD slcan pty")


def heard(
    *,
    wire: str,
    predictor: str,
    rate_hz: float,
    seconds: float,
    cache: Path | None = None,
    watched: bool = False,
) -> dict[str, Any]:
    """Start a node on a wire, hear it for some seconds, and stop it.

    Args:
        wire: one of ``WIRES``.
        predictor: its name.
        rate_hz: the node's rate.
        seconds: to hear it, after it has warmed up; 0: only its start.
        cache: the folder that the node keeps things in; ``None``: the user's own.
        watched: with both screens, a reader of each, and three alert hooks that fail slowly.

    Returns:
        ``first_advice_s``: from starting the process to the first Advice of a running node;
        ``resident_mib``: of the node's processes at the end; ``cpu_percent``: of one core, by
        group of threads; ``cores_percent``: how busy each core was; ``deviation_ms``: how far the
        intervals of its Status and Advice messages were from the period, and ``bare_ms`` those of
        the bare loop; ``missing``: cycles of which no Status came; ``stamps``, ``priority``: whose
        stamps these are, and how the receiver ran.

    Raises:
        LinkError: this machine has no such wire, or the node did not start; says why.
    """
    with contextlib.ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        link, arguments, fds = stack.enter_context(_far_end(wire))
        looking = stack.enter_context(onlookers()) if watched else None
        path = Path(folder) / "cell.yaml"
        settings = cell.settings(
            predictor=predictor, rate_hz=rate_hz, captures_hz=rate_hz + 5.0, links=[link]
        )
        flags: list[str] = []
        if looking is not None:
            settings["alerts"], flags = looking.alerts, looking.flags
        path.write_text(yaml.safe_dump(settings), encoding="utf-8")
        command = [sys.executable, "-m", "hri_predict", "run", str(path), "--json", *flags]
        node, receiver, began_ns = stack.enter_context(
            _processes(command, arguments=arguments, fds=fds, rate_hz=rate_hz, cache=cache)
        )
        first_ns = _line(receiver, node)["first_ns"]
        result: dict[str, Any] = {"first_advice_s": (first_ns - began_ns) * 1e-9}
        if looking is not None:
            _line(looking.process, node)  # both screens were seen
        time.sleep(WARM_UP_S)
        if seconds > 0:
            result |= _used(node.pid, seconds)
        result["resident_mib"] = resident_mib(node.pid)
        if looking is not None:
            result["seen_bytes"] = looking.seen()
        told, summary = _ended(node, receiver)
        result["alerts"] = summary.get("alerts", {})
    if seconds > 0:
        begin_ns, end_ns = result.pop("window_ns")
        result |= _figures(told, begin_ns, end_ns, rate_hz)
    return result


@contextlib.contextmanager
def _far_end(wire: str) -> Iterator[tuple[dict[str, Any], list[str], list[int]]]:
    """Yield an entry of ``links:``, the receiver's arguments, and the descriptors it inherits."""
    link: dict[str, Any] = {"name": "bench", "kind": "can", "fd": True}
    if wire == "CAN FD udp_multicast":
        port = _free_port()
        link |= {"interface": "udp_multicast", "channel": MULTICAST}
        yield link | {"options": {"port": port, "hop_limit": 0}}, ["udp", MULTICAST, str(port)], []
        return
    master, path = open_pty()
    held = os.open(path, os.O_RDWR | os.O_NOCTTY)  # else reading fails until the node has opened it
    try:
        if wire == "CAN FD slcan pty":
            link |= {"interface": "slcan", "channel": path, "options": {"sleep_after_open": 0}}
            yield link, ["slcan", str(master)], [master]
        else:
            baudrate = int(wire.split()[-1])
            serial = {"name": "bench", "kind": "serial", "port": path, "baudrate": baudrate}
            yield serial, ["serial", str(master)], [master]
    finally:
        os.close(held)
        os.close(master)


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def _processes(
    command: Sequence[str],
    *,
    arguments: Sequence[str],
    fds: Sequence[int],
    rate_hz: float,
    cache: Path | None,
) -> Iterator[tuple[Any, Any, int]]:
    """Start the receiver, the bare loop, and then the node; yield node, receiver, and when."""
    reading, writing = os.pipe()
    environment = dict(os.environ)
    if cache is not None:
        environment["HRI_PREDICT_CACHE"] = environment["NUMBA_CACHE_DIR"] = str(cache)
    running: list[Any] = []
    try:
        receiver = _child("hri_sim.bench.receiver", [*arguments, str(reading)], [*fds, reading])
        running.append(receiver)
        bare = _child("hri_sim.bench.receiver", ["bare", str(writing), str(rate_hz)], [writing])
        running.append(bare)
        os.close(reading)
        os.close(writing)
        _line(receiver, receiver)
        began_ns = time.monotonic_ns()
        node = subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=environment,
        )
        running.append(node)
        yield node, receiver, began_ns
    finally:
        for process in reversed(running):
            process.kill()
            process.communicate()


def _child(module: str, arguments: Sequence[str], fds: Sequence[int]) -> Any:
    return subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        pass_fds=fds,
        text=True,
    )


def _line(receiver: Any, awaited: Any) -> dict[str, Any]:
    """The receiver's next line; it comes unless ``awaited`` ends.

    Raises:
        LinkError: it ended, or nothing came in time.
    """
    give_up = time.monotonic() + START_S
    while time.monotonic() < give_up:
        if select.select([receiver.stdout], [], [], 0.1)[0]:
            line = receiver.stdout.readline()
            if line:
                return dict(json.loads(line))
        for process in (receiver, awaited):
            if process.poll() is not None:
                said = (process.stderr.read() or "nothing").strip().splitlines()[-1:]
                raise LinkError(f"a process of the bench ended: {' '.join(said)}")
    raise LinkError(f"the node sent no advice in {START_S:g} s")


def _used(pid: int, seconds: float) -> dict[str, Any]:
    """Let the node run; what it used meanwhile."""
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


def _ended(node: Any, receiver: Any) -> tuple[dict[str, Any], dict[str, Any]]:
    """Stop the node, then the receiver; return the receiver's report, and the node's summary."""
    node.send_signal(signal.SIGTERM)
    summary, _ = node.communicate(timeout=30.0)
    told, _ = receiver.communicate(timeout=30.0)  # closes its standard input
    return dict(json.loads(told.splitlines()[-1])), dict(json.loads(summary))


def _figures(told: dict[str, Any], begin_ns: int, end_ns: int, rate_hz: float) -> dict[str, Any]:
    """Intervals of what came in the window; a Status that never came is one long interval."""
    inside = [m for m in told["messages"] if begin_ns <= m[1] <= end_ns]
    status = [(at, cycle) for kind, at, cycle in inside if kind == "Status"]
    steps = [(b[1] - a[1]) % CYCLES for a, b in itertools.pairwise(status)]
    deviations = [
        deviation
        for kind in ("Status", "Advice")
        for deviation in _deviations([at for name, at, _ in inside if name == kind], rate_hz)
    ]
    bare = [at for at in told["bare"] if begin_ns <= at <= end_ns]
    return {
        "deviation_ms": deviations,
        "bare_ms": _deviations(bare, rate_hz),
        "missing": sum(step - 1 for step in steps if step > 1),
        "stamps": told["stamps"],
        "priority": told["priority"],
    }


def _deviations(at_ns: Sequence[int], rate_hz: float) -> list[float]:
    """Milliseconds between each interval and the period, without sign."""
    at_ms = np.asarray(at_ns, np.float64) * 1e-6  # 0.1 ns of a day: floats hold it
    return [float(d) for d in np.abs(np.diff(at_ms) - 1e3 / rate_hz)]
