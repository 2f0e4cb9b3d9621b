"""The cost of the zenoh link on this machine: ``hri-predict bench fleet``.

A link posts the messages of a node with one robot and one person. Another process receives them,
directly or through a router in a third process. Both processes read the machine's monotonic clock.
"""

import contextlib
import itertools
import resource
import socket
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_drivers.wires.zenoh import ZenohTransport
from hri_drivers.wires.zenoh_session import ZenohSettings, open_session
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.keyed import Keyed, KeyedReceiver
from hri_predict.protocol.messages import Status
from hri_sim.bench.rows import spread
from hri_sim.wires.child import child
from hri_sim.wires.ports import free_tcp_port
from hri_sim.wires.samples import CYCLES, STATUS, of_a_cycle

TOPOLOGIES, RATES_HZ = ("router", "peer"), (25.0, 100.0)
CELL = "bench"
START_S = 30.0  # long enough for a loaded machine
GONE_S = 1.0
HEAR_S = 0.5  # time to receive after the last message


def costs(seconds: float) -> Iterator[dict[str, Any]]:
    """Yield rows of ``measure``: through a router and directly, at 25 and 100 scenes per second."""
    for topology, rate_hz in itertools.product(TOPOLOGIES, RATES_HZ):
        yield measure(topology, rate_hz, seconds)


def measure(topology: str, rate_hz: float, seconds: float) -> dict[str, Any]:
    """Measure one row.

    Returns:
        ``latency_us``: time from ``post`` until another process has decoded a Status: p50, p99 and
            max;
        ``sent`` and ``heard``: numbers of Status messages; ``superseded``: messages of any kind
        that a newer one replaced before they were written; ``cpu_percent``: share of one core that
        posting, encoding and zenoh's threads took in the sending process; ``bytes_per_s``: payload.
    """
    end = f"tcp/127.0.0.1:{free_tcp_port()}"
    settings = ZenohLinkSettings(name="bench", cell=CELL, connect=[end])
    link = ZenohLink(settings, MonotonicClock(), rate_hz=rate_hz)
    with contextlib.ExitStack() as stack:
        if topology == "router":
            stack.enter_context(child(route, end))
        listener = stack.enter_context(child(hear, topology == "peer", end))
        link.start()
        try:
            while not link.connected:
                time.sleep(0.05)
            time.sleep(1.0)  # zenoh needs a moment to find its subscribers
            posted, cpu_s, bytes_sent = _post(link, rate_hz, seconds)
        finally:
            link.stop()
        heard = listener.report()
    spans_us, at = [], 0
    for cycle, heard_ns in heard:  # in order, some missing
        while at < len(posted) and at % CYCLES != cycle:
            at += 1
        if at < len(posted):
            spans_us.append((heard_ns - posted[at]) * 1e-3)
            at += 1
    return {
        "by": topology,
        "rate_hz": rate_hz,
        "superseded": link.counters.superseded,
        "sent": len(posted),
        "heard": len(spans_us),
        "latency_us": spread(spans_us, 1),
        "cpu_percent": round(100 * cpu_s / (seconds + HEAR_S), 2),
        "bytes_per_s": round(bytes_sent / seconds),
    }


@contextlib.contextmanager
def routed() -> Iterator[str]:
    """Start a router, and a listener that decodes all messages, in separate processes.

    Yields the router's endpoint once the router answers.
    """
    port = free_tcp_port()
    end = f"tcp/127.0.0.1:{port}"
    with child(hear, False, end), child(route, end):
        give_up_s = time.monotonic() + START_S
        while not _answers(port):
            if time.monotonic() > give_up_s:
                raise LinkError(f"the router did not start within {START_S:g} s")
            time.sleep(0.05)
        yield end


def recovery(times: int) -> dict[str, list[float]]:
    """Measure, ``times`` times each, the time until messages of a cell arrive, in seconds.

    Returns:
        ``joins``: time from the start of a link, while router and listener run; ``heals``: time
            from the return of a router after one second of absence.
    """
    end = f"tcp/127.0.0.1:{free_tcp_port()}"
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
        link.post(replace(STATUS, people=0, cycle=cycle))
        cycle += 1
        try:
            if observer.read(0.04):
                return time.monotonic() - began
        except LinkError:  # not connected yet: zenoh itself continues trying
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
        for message in of_a_cycle(cycle, time.monotonic_ns()):
            if isinstance(message, Status):
                posted.append(time.monotonic_ns())
            link.post(message)
    time.sleep(HEAR_S)
    return posted, _cpu_s() - cpu, link.counters.bytes_sent - size


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def _answers(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def hear(pipe: Connection, as_peer: bool, end: str) -> list[tuple[int, int]]:
    """Receive a cell; for ``child``. Reports when each Status was decoded: (cycle, ns)."""
    settings = (
        ZenohSettings(mode="peer", listen=[end], connect=[])
        if as_peer
        else ZenohSettings(connect=[end])
    )
    observer = ZenohLink.observer(settings, None)
    while True:
        try:
            observer.open()
            break
        except LinkError:  # the router is not there yet
            if pipe.poll(0.05):
                return []
    receiver, heard = KeyedReceiver(), list[tuple[int, int]]()
    while not pipe.poll():
        for unit in observer.read(0.1):
            messages = receiver.feed(Keyed(unit.key.split("/", 2)[2], unit.data))
            now_ns = time.monotonic_ns()
            heard += [(m.cycle, now_ns) for m in messages if isinstance(m, Status)]
    observer.close()
    return heard


def route(pipe: Connection, end: str) -> None:
    """Run a router at this endpoint; for ``child``."""
    session = open_session(ZenohSettings(mode="router", listen=[end]))
    pipe.poll(None)
    session.close()
