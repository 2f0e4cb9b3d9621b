"""A node in its own process, measured in real time by a receiver in another process.

``hri-predict run`` runs the cell of ``cell.settings`` on a real wire. A receiver at the wire's
other end stamps each unit on arrival, as well as the bytes of a bare loop: a process that only
sleeps until absolute deadlines at the node's rate. At that moment, no node on this machine can be
more punctual than the bare loop.
"""

import contextlib
import itertools
import json
import multiprocessing
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from hri_predict.base.machine.orphans import command_of
from hri_sim.bench import cell
from hri_sim.bench.onlookers import onlookers
from hri_sim.bench.processes import cores_busy, processor_time, resident_mib
from hri_sim.bench.receiver import bare_loop, hear
from hri_sim.wires.child import Child, child

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
            runs; it sends a message when it is ready.

    Returns:
        ``summary``: the node's output on exit; ``partner``: the other process's report;
        ``window_ns``: start and end of the measured time;
        ``first_advice_s``: time from starting the process to the first Advice of a running node;
        ``resident_mib``: memory of the node's processes at the end; ``cpu_percent``: share of one
        core, by group of threads; ``cores_percent``: load of each core; ``deviation_ms``: deviation
        from the period of the intervals between its Status and Advice messages, and ``bare_ms`` the
        same for the bare loop; ``missing``: number of cycles without a Status; ``stamps``,
        ``priority``: the clock that stamped the messages, and the receiver's scheduling.

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
    """Start the receiver at a wire's end, and the bare loop, whose bytes it receives as well."""
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
    """Let the node run; return the resources it used in that time."""
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
