"""The cost of the zenoh link on this machine: ``hri-predict bench fleet``.

A link posts the messages of a node with one robot and one person. Another process receives them,
directly or through a router in a third process. Both read the machine's monotonic clock.
"""

import contextlib
import json
import os
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.codec import SCHEMA_HASH, SCHEMA_VERSION
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
from hri_predict.protocol.reasons import Reason

TOPOLOGIES, RATES_HZ = ("router", "peer"), (25.0, 100.0)
CELL = "bench"
STEPS = 3  # horizons that a node sends
CYCLES = 256  # the modulus of Status.cycle on the wire
_CAPSULES = tuple(ZoneCapsule(i, (0.1 * i, 0.5, 1.0), (0.1 * i, 0.6, 1.3), 0.2) for i in range(17))
_JOINTS = tuple((i, 0.1 * i, 0.5, 1.0) for i in range(21))
START_S = 30.0  # long enough for a loaded machine
GONE_S = 1.0
HEAR_S = 0.5  # time to receive after the last message


def costs(seconds: float) -> Iterator[dict[str, Any]]:
    """Yield rows of ``measure``: through a router and directly, at 25 and 100 scenes per second."""
    for topology in TOPOLOGIES:
        for rate_hz in RATES_HZ:
            yield measure(topology, rate_hz, seconds)


def measure(topology: str, rate_hz: float, seconds: float) -> dict[str, Any]:
    """Measure one row.

    Returns:
        ``latency_us``: from ``post`` until another process has decoded a Status, p50, p99 and max;
        ``sent`` and ``heard``: numbers of Status messages; ``superseded``: messages of any kind
        that a newer one replaced before they were written; ``cpu_percent``: share of one core that
        posting, encoding and zenoh's threads took in the sending process; ``bytes_per_s``: payload.
    """
    end = f"tcp/127.0.0.1:{free_port()}"
    router = [_child("route", end)] if topology == "router" else []
    listener = _child("hear", "client" if router else "peer", end)
    settings = ZenohLinkSettings(name="bench", cell=CELL, connect=[end])
    link = ZenohLink(settings, MonotonicClock(), rate_hz=rate_hz)
    link.start()
    try:
        while not link.connected:
            time.sleep(0.05)
        time.sleep(1.0)  # zenoh needs a moment to find its subscribers
        posted, cpu_s, bytes_sent = _post(link, rate_hz, seconds)
    finally:
        link.stop()
        heard = json.loads(listener.communicate("end\n", timeout=30)[0].splitlines()[-1])
        for process in router:
            process.communicate("end\n", timeout=30)
    row = {"by": topology, "rate_hz": rate_hz, "superseded": link.counters.superseded}
    return row | _figures(posted=posted, heard=heard, seconds=seconds, cpu_s=cpu_s, size=bytes_sent)


@contextlib.contextmanager
def routed() -> Iterator[str]:
    """Start a router, and a listener that decodes all messages, in separate processes.

    Yields the router's endpoint once the router answers.
    """
    port = free_port()
    end = f"tcp/127.0.0.1:{port}"
    children = [_child("hear", "client", end), _child("route", end)]
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
    """Measure, ``times`` times each, the seconds until messages of a cell arrive.

    Returns:
        ``joins``: from a link's start, while router and listener run; ``heals``: from the return
        of a router that was gone for a second.
    """
    end = f"tcp/127.0.0.1:{free_port()}"
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
    """Post a Status every 40 ms until one that was posted after ``began`` arrives."""
    with contextlib.suppress(LinkError):  # drop earlier messages
        observer.read(0.0)
    cycle = 0
    while True:
        link.post(
            Status(
                node_state=NodeState.RUNNING, reason=Reason.NONE, people=0, predictor=0, cycle=cycle
            )
        )
        cycle += 1
        try:
            if observer.read(0.04):
                return time.monotonic() - began
        except LinkError:  # not connected yet: zenoh itself goes on trying
            time.sleep(0.04)


def _post(link: ZenohLink, rate_hz: float, seconds: float) -> tuple[list[int], float, int]:
    """Return the times of posting each Status, the processor time, and the payload bytes."""
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
    """Return the messages that a node posts in one cycle, in its order."""
    messages: list[Message] = [
        Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_NEAR, capture_ns=now_ns),
        Status(
            node_state=NodeState.RUNNING,
            reason=Reason.NONE,
            people=1,
            predictor=0,
            cycle=cycle,
            capture_ns=now_ns,
        ),
    ]
    if cycle % 25 == 0:
        messages.append(Schema(SCHEMA_VERSION, SCHEMA_HASH))
    for step in range(STEPS):
        messages.append(
            Zone(person=1, step=step, horizon_s=0.4 * step, capsules=_CAPSULES, capture_ns=now_ns)
        )
        messages.append(
            Pose(person=1, step=step, horizon_s=0.4 * step, joints=_JOINTS, capture_ns=now_ns)
        )
    return messages


def _figures(
    *, posted: list[int], heard: list[list[int]], seconds: float, cpu_s: float, size: int
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
        [sys.executable, "-m", "hri_sim.bench.fleet_far_end", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=os.environ | {"OMP_NUM_THREADS": "1"},
        text=True,
    )


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def free_port() -> int:
    """Return a free TCP port of this machine."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
