"""What the zenoh link costs, on this machine: ``python -m hri_sim.fleet_cost``.

A link posts what a node with one robot and one person posts; a process of its own hears it, by a
router in a third process, or directly. Both read the machine's one monotonic clock.
"""

import argparse
import contextlib
import json
import os
import resource
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hri_drivers.zenoh_link import ZenohLink, ZenohLinkSettings
from hri_drivers.zenoh_session import ZenohSettings, open_session
from hri_drivers.zenoh_transport import ZenohTransport
from hri_predict.clock import MonotonicClock
from hri_predict.errors import LinkError
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
from hri_predict.protocol.keyed_codec import Keyed, KeyedReceiver
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.reasons import Reason

CELL = "bench"
STEPS = 3  # horizons that a node sends
CYCLES = 256  # Status counts modulo so many
_CAPSULES = tuple(ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(17))
_JOINTS = tuple((i, 0.1 * i, 0.5, 1.0) for i in range(21))
START_S = 30.0  # a loaded machine takes its time
GONE_S = 1.0
HEAR_S = 0.5  # after the last message


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure, and print a table or JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each row")
    parser.add_argument("--recovery", type=int, help="joining and healing instead, so many times")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--hear", nargs=2, help=argparse.SUPPRESS)  # mode and endpoint, as child
    parser.add_argument("--route", help=argparse.SUPPRESS)  # endpoint, as child
    options = parser.parse_args(arguments)
    if options.hear:
        _hear(*options.hear)
    elif options.route:
        _route(options.route)
    else:
        if options.recovery:
            print(json.dumps(recovery(options.recovery)))
            return
        rows = [
            measure(topology, rate_hz, options.seconds)
            for topology in ("router", "peer")
            for rate_hz in (25.0, 100.0)
        ]
        print(json.dumps(rows) if options.json else _table(rows))


def measure(topology: str, rate_hz: float, seconds: float) -> dict[str, Any]:
    """One row.

    Returns:
        ``latency_us``: from ``post`` until another process has decoded a Status, p50, p99 and max;
        ``sent`` and ``heard`` Statuses, and messages of any kind that a newer one replaced before
        they were written (``superseded``); ``cpu_percent`` of one core that posting, encoding
        and zenoh's own threads took in the sending process; ``bytes_per_s`` of payload.
    """
    end = f"tcp/127.0.0.1:{_free_port()}"
    router = [_child("--route", end)] if topology == "router" else []
    listener = _child("--hear", "client" if router else "peer", end)
    settings = ZenohLinkSettings(name="bench", cell=CELL, connect=[end])
    link = ZenohLink(settings, MonotonicClock(), rate_hz=rate_hz)
    link.start()
    try:
        while not link.connected:
            time.sleep(0.05)
        time.sleep(1.0)  # whom to send to takes a moment to become known
        posted, cpu_s, bytes_sent = _post(link, rate_hz, seconds)
    finally:
        link.stop()
        heard = json.loads(listener.communicate("end\n", timeout=30)[0].splitlines()[-1])
        for process in router:
            process.communicate("end\n", timeout=30)
    row = {"by": topology, "rate_hz": rate_hz, "superseded": link.counters.superseded}
    return row | _figures(posted, heard, seconds, cpu_s, bytes_sent)


@contextlib.contextmanager
def routed() -> Iterator[str]:
    """A router, and a listener that decodes what comes, in processes of their own.

    Yields the router's endpoint, once it answers.
    """
    port = _free_port()
    end = f"tcp/127.0.0.1:{port}"
    children = [_child("--hear", "client", end), _child("--route", end)]
    try:
        give_up_s = time.monotonic() + START_S
        while not _answers(port):
            if time.monotonic() > give_up_s:
                raise LinkError(f"the router did not start within {START_S:g} s")
            time.sleep(0.05)
        yield end
    finally:
        for child in children:
            child.communicate("end\n", timeout=START_S)


def recovery(times: int) -> dict[str, list[float]]:
    """How long until a cell is heard, seconds, each so many times.

    Returns:
        ``joins``: from a link's start, a router and a listener being there; ``heals``: from the
        moment at which a router that was gone for a second is back.
    """
    end = f"tcp/127.0.0.1:{_free_port()}"
    routing, hearing = ZenohSettings(mode="router", listen=[end]), ZenohSettings(connect=[end])
    found: dict[str, list[float]] = {"joins": [], "heals": []}
    for _ in range(times):
        router = open_session(routing)
        observer = ZenohLink.observer(hearing, None)
        observer.open()
        settings = ZenohLinkSettings(name="bench", cell=CELL, connect=[end])
        link = ZenohLink(settings, MonotonicClock())
        began = time.monotonic()
        link.start()
        found["joins"].append(_until_heard(link, observer, began))
        router.close()
        time.sleep(GONE_S)
        router = open_session(routing)
        found["heals"].append(_until_heard(link, observer, time.monotonic()))
        link.stop()
        observer.close()
        router.close()
    return {name: [round(s, 2) for s in seconds] for name, seconds in found.items()}


def _until_heard(link: ZenohLink, observer: ZenohTransport, began: float) -> float:
    """Post a Status every 40 ms until one is heard that was posted after ``began``."""
    with contextlib.suppress(LinkError):  # what had come before
        observer.read(0.0)
    cycle = 0
    while True:
        link.post(Status(NodeState.RUNNING, Reason.NONE, 0, 0, cycle))
        cycle += 1
        try:
            if observer.read(0.04):
                return time.monotonic() - began
        except LinkError:  # not connected yet: zenoh itself goes on trying
            time.sleep(0.04)


def _post(link: ZenohLink, rate_hz: float, seconds: float) -> tuple[list[int], float, int]:
    """Times of posting each Status, processor time, and payload bytes."""
    period_ns = round(1e9 / rate_hz)
    cpu, size = _cpu_s(), link.counters.bytes_sent
    due_ns = time.monotonic_ns()
    posted: list[int] = []
    for cycle in range(round(seconds * rate_hz)):
        time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
        due_ns += period_ns
        for message in _messages(cycle, time.monotonic_ns()):
            if isinstance(message, Status):
                posted.append(time.monotonic_ns())
            link.post(message)
    time.sleep(HEAR_S)
    return posted, _cpu_s() - cpu, link.counters.bytes_sent - size


def _messages(cycle: int, now_ns: int) -> list[Message]:
    """What a node posts in one cycle, in its order."""
    messages: list[Message] = [
        Advice(0, Level.SLOW, Reason.PERSON_NEAR, capture_ns=now_ns),
        Status(NodeState.RUNNING, Reason.NONE, 1, 0, cycle, capture_ns=now_ns),
    ]
    if cycle % 25 == 0:
        messages.append(Schema(SCHEMA_VERSION, SCHEMA_HASH))
    for step in range(STEPS):
        messages.append(Zone(1, step, 0.4 * step, _CAPSULES, capture_ns=now_ns))
        messages.append(Pose(1, step, 0.4 * step, _JOINTS, capture_ns=now_ns))
    return messages


def _hear(mode: str, end: str) -> None:
    """The listening process: prints when each Status was decoded, after a line on its input."""
    settings = (
        ZenohSettings(connect=[end])
        if mode == "client"
        else ZenohSettings(mode="peer", listen=[end], connect=[])
    )
    observer = ZenohLink.observer(settings, None)
    while True:
        try:
            observer.open()
            break
        except Exception:
            time.sleep(0.05)
    end_asked = threading.Event()

    def ask() -> None:
        sys.stdin.readline()
        end_asked.set()

    threading.Thread(target=ask, daemon=True).start()
    receiver, heard = KeyedReceiver(), list[tuple[int, int]]()
    while not end_asked.is_set():
        for unit in observer.read(0.1):
            messages = receiver.feed(Keyed(unit.key.split("/", 2)[2], unit.data))
            now_ns = time.monotonic_ns()
            heard += [(m.cycle, now_ns) for m in messages if isinstance(m, Status)]
    observer.close()
    print(json.dumps(heard))


def _route(end: str) -> None:
    """The routing process."""
    session = open_session(ZenohSettings(mode="router", listen=[end]))
    sys.stdin.readline()
    session.close()


def _figures(
    posted: list[int], heard: list[list[int]], seconds: float, cpu_s: float, size: int
) -> dict[str, Any]:
    spans_us, at = [], 0
    for cycle, heard_ns in heard:  # in order, some missing
        while at < len(posted) and at % CYCLES != cycle:
            at += 1
        if at < len(posted):
            spans_us.append((heard_ns - posted[at]) * 1e-3)
            at += 1
    latency = {f"p{q}": round(float(np.percentile(spans_us, q)), 1) for q in (50, 99)}
    return {
        "sent": len(posted),
        "heard": len(spans_us),
        "latency_us": latency | {"max": round(max(spans_us), 1)},
        "cpu_percent": round(100 * cpu_s / (seconds + HEAR_S), 2),
        "bytes_per_s": round(size / seconds),
    }


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _child(*arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-m", "hri_sim.fleet_cost", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        text=True,
    )


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _table(rows: Sequence[dict[str, Any]]) -> str:
    lines = [
        "| by | rate | Status heard | superseded | p50 | p99 | max | CPU of one core | payload |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        us = row["latency_us"]
        lines.append(
            f"| {row['by']} | {row['rate_hz']:g} Hz | {row['heard']} of {row['sent']} | "
            f"{row['superseded']} | "
            f"{us['p50']:.0f} µs | {us['p99']:.0f} µs | {us['max']:.0f} µs | "
            f"{row['cpu_percent']:.1f} % | {row['bytes_per_s'] / 1e3:.1f} kB/s |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
