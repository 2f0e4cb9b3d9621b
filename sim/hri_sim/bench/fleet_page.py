"""The cost of the page of many cells: ``hri-predict bench fleet --cells 40``.

Real processes over real loopback sockets: ``hri-predict fleet --operator`` as the router, its
page's process, one process that plays all cells, each with its own link and zenoh session, and, in
this process, a client that reads the page's events as a browser does. All processes read the
machine's monotonic clock.
"""

import contextlib
import http.client
import json
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing.connection import Connection
from typing import Any

from hri_drivers.links.zenoh.link import ZenohLink, ZenohLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.machine.orphans import command_of
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_sim.bench.processes import processor_time, resident_mib
from hri_sim.bench.rows import spread
from hri_sim.wires.child import child
from hri_sim.wires.ports import free_tcp_port
from hri_sim.wires.samples import ADVICE, CYCLES, SCHEMA, STATUS

RATE_HZ = 25
CHANGES_S = 5  # each cell's level changes so often
WARM_S = 3  # schemas, and the page's first events
START_S = 60.0
MODULUS = 60_000  # of the number of a cycle that goes as a separation in millimetres


def page(cells: int, seconds: float) -> dict[str, Any]:
    """Measure the page with this many cells, each sending 25 times a second.

    Returns:
        ``cpu_s_per_s``: seconds of processor time per second, for ``hri-predict fleet``, its page's
        process, and the process that plays all cells; ``memory_mib``: memory of the first two, at
        the end;
        ``number_ms``: time from a link's ``post`` of an Advice until an event that shows it, or a
        newer one, has arrived: p50, p99 and max; ``change_ms``: the same time for Advice that
        changes the level, ``None`` without any; ``unshown``: Advice messages that no event showed;
        ``gone``: how often a tile showed no level although its cell was sending; ``load``: the load
            average before the measurement.
    """
    load = os.getloadavg()[0]
    with (
        _fleet() as (fleet, end, port),
        child(speak, cells, end, seconds + WARM_S) as speakers,
    ):
        speakers.receive()  # all cells are connected
        events: list[tuple[int, bytes]] = []
        threading.Thread(target=_listen, args=(port, events), daemon=True).start()
        speakers.send("go")
        time.sleep(WARM_S)
        before, began_s = _used_s(fleet.pid, speakers.pid), time.monotonic()
        time.sleep(seconds - 0.5)
        after, took_s = _used_s(fleet.pid, speakers.pid), time.monotonic() - began_s
        memory_mib = resident_mib(fleet.pid)
        time.sleep(1.5)  # what was posted last is shown, or never
        told = speakers.report()
    row: dict[str, Any] = {"cells": cells, "rate_hz": RATE_HZ, "load": round(load, 2)}
    row |= {"cpu_s_per_s": {who: round((after[who] - before[who]) / took_s, 3) for who in after}}
    row["memory_mib"] = round(memory_mib, 1)
    return row | {"superseded": told["superseded"]} | _figures(told["posted"], events)


def _figures(posted: list[list[int]], events: list[tuple[int, bytes]]) -> dict[str, Any]:
    """Return the delays of messages that each cell posted after the warm-up."""
    shown: list[tuple[int, list[int]]] = []  # time, and each cell's newest number; -1: no level
    size = 0
    for now_ns, line in events:
        told = json.loads(line.removeprefix(b"data: "))
        size += len(line)
        cells = sorted(told.get("cells", []), key=lambda cell: cell["name"])
        if len(cells) == len(posted):
            shown.append((now_ns, [_number(cell) for cell in cells]))
    first = WARM_S * RATE_HZ
    numbers_ms, changes_ms, unshown = list[float](), list[float](), 0
    for index, times_ns in enumerate(posted):
        at = 0
        for cycle, then_ns in enumerate(times_ns):
            while at < len(shown) and not (shown[at][0] > then_ns and shown[at][1][index] >= cycle):
                at += 1
            if cycle < first:
                continue
            if at == len(shown):
                unshown += 1
                continue
            delay_ms = (shown[at][0] - then_ns) * 1e-6
            (changes_ms if is_change(index, cycle) else numbers_ms).append(delay_ms)
    start_ns, end_ns = posted[0][first], posted[0][-1]
    lasting = [row for now_ns, row in shown if start_ns < now_ns < end_ns]
    return {
        "events_per_s": round(len(lasting) / ((end_ns - start_ns) * 1e-9), 1),
        "bytes_per_event": round(size / max(1, len(events))),
        "number_ms": spread(numbers_ms, 1) if numbers_ms else None,
        "change_ms": spread(changes_ms, 1) if changes_ms else None,
        "changes": len(changes_ms),
        "unshown": unshown,
        "gone": sum(number < 0 for row in lasting for number in row),
    }


def is_change(index: int, cycle: int) -> bool:
    """Return whether a cell's level changes in this cycle; cells take turns."""
    return (cycle + 3 * index) % (CHANGES_S * RATE_HZ) == 0


def _number(cell: dict[str, Any]) -> int:
    """The cycle that a tile shows; -1 if it shows no level."""
    robots = cell["robots"]
    if cell["level"] not in ("CLEAR", "SLOW") or not robots or robots[0]["separation_m"] is None:
        return -1
    return round(robots[0]["separation_m"] * 1e3)


@contextlib.contextmanager
def _fleet() -> Iterator[tuple["subprocess.Popen[str]", str, int]]:
    """Run ``hri-predict fleet``; yield its process, its endpoint, and its page's port."""
    end = f"tcp/127.0.0.1:{free_tcp_port()}"
    command = command_of("hri_predict", "fleet", "--listen", end, "--operator", "0")
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    try:
        said = []
        for line in process.stderr:
            said.append(line)
            if found := re.match(r"operator: http://.*:(\d+)$", line.strip()):
                break
        else:
            raise LinkError(f"hri-predict fleet exited: {' '.join(said).strip()}")
        threading.Thread(target=process.stderr.read, daemon=True).start()
        yield process, end, int(found[1])
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(START_S)


def _listen(port: int, events: list[tuple[int, bytes]]) -> None:
    """Read events as a browser does, until the page closes the connection."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=START_S)
    connection.request("GET", "/events")
    answer = connection.getresponse()
    with contextlib.suppress(OSError):
        events.extend((time.monotonic_ns(), line) for line in answer if len(line) > 1)


def _used_s(fleet: int, speakers: int) -> dict[str, float]:
    """Processor time so far: of ``hri-predict fleet``, of its page, and of the cells."""
    used = processor_time(fleet)
    page_s = used["helper processes"]
    return {"fleet": used["all"] - page_s, "page": page_s, "cells": processor_time(speakers)["all"]}


def speak(pipe: Connection, cells: int, end: str, seconds: float) -> dict[str, Any]:
    """Play all cells; for ``child``. Reports when each Advice was posted, by cell.

    The process sends a message when all cells are connected, and starts when it receives a message.
    """
    links = [
        ZenohLink(
            ZenohLinkSettings(name="bench", site="plant", cell=f"cell-{i:03}", connect=[end]),
            MonotonicClock(),
            rate_hz=RATE_HZ,
        )
        for i in range(cells)
    ]
    for link in links:
        link.start()
    give_up_s = time.monotonic() + START_S
    while not all(link.connected for link in links):
        if time.monotonic() > give_up_s:
            raise LinkError("the cells did not connect")
        time.sleep(0.05)
    pipe.send("ready")
    pipe.recv()
    posted: list[list[int]] = [[] for _ in links]
    start_ns, period_ns = time.monotonic_ns(), 1_000_000_000 // RATE_HZ
    slow = [False for _ in links]
    for cycle in range(round(seconds * RATE_HZ)):
        for index, link in enumerate(links):  # spread over the period, as cells are
            due_ns = start_ns + cycle * period_ns + index * period_ns // cells
            time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
            slow[index] ^= is_change(index, cycle)
            posted[index].append(_post(link, cycle, slow[index]))
    pipe.poll(None)
    for link in links:
        link.stop()
    return {"posted": posted, "superseded": sum(link.counters.superseded for link in links)}


def _post(link: ZenohLink, cycle: int, slow: bool) -> int:
    """Post a cycle's Advice and Status, and the Schema once a second; return the time."""
    now_ns = time.monotonic_ns()
    advice = replace(
        ADVICE,
        level=Level.SLOW if slow else Level.CLEAR,
        reason=Reason.PERSON_NEAR if slow else Reason.NONE,
        speed_limit_m_s=0.25 if slow else 1.0,
        separation_m=cycle % MODULUS * 1e-3 + 5e-4,  # it rounds down
        capture_ns=now_ns,
    )
    link.post(advice)
    link.post(replace(STATUS, cycle=cycle % CYCLES, capture_ns=now_ns))
    if cycle % RATE_HZ == 0:
        link.post(SCHEMA)
    return now_ns
