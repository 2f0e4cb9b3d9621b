"""``bench links``: measure the delay from a scene to the wire, and the load of the wire."""

import contextlib
import itertools
import json
import os
import sys
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, get_args

import typer

from hri_drivers.links.serial.link import SerialLink, SerialLinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import ConfigError, LinkError
from hri_predict.cli.common import JsonOption
from hri_predict.run.config import NodeSettings
from hri_predict.run.runtime import SWITCH_INTERVAL_S
from hri_sim.bench.cell import MAX_PEOPLE
from hri_sim.bench.latency import KINDS, latency
from hri_sim.bench.rows import Row, Scope, rows_of, spread
from hri_sim.bench.running import WIRES, short_name
from hri_sim.bench.table import Columns, SecondsOption, demand, figures, measure
from hri_sim.wires.child import child
from hri_sim.wires.far_end import serial_line
from hri_sim.wires.samples import of_a_cycle

BAUDRATES, RESERVED = (115_200, 921_600), (0.0, 0.3)  # the whole wire, and the default
_RATES_HZ = (25.0, 100.0)


def _span(row: Mapping[str, Any], key: str) -> str:
    if "not_here" in row:
        return "not available" if key == "wait_ms" else ""
    return "{p50:.2f} / {p99:.2f}".format(**row[key]) if key in row else "-"


_DELAYS: Columns = {
    "link": "{link}",
    "Hz": "{rate_hz:g}",
    "wait for tick": lambda row: _span(row, "wait_ms"),
    "inference": lambda row: _span(row, "inference_ms"),
    "node": lambda row: _span(row, "node_ms"),
    "in the link": lambda row: _span(row, "link_ms"),
    "total": lambda row: _span(row, "total_ms"),
    "scenes": lambda row: str(row.get("scenes", "")),
    "missed": lambda row: str(row.get("missed", "")),
    "late ticks": lambda row: str(row.get("late_ticks", "")),
}
_WIRES = {
    "bit/s": "{baudrate}",
    "reserved load": "{reserved_load:g}",
    "wire used": "{used:.1%}",
    "wait in port, ms": "{backlog_ms[p50]:.2f} / {backlog_ms[p99]:.2f}, max {backlog_ms[max]:.1f}",
    "sent": "{sent}",
    "decimated": "{decimated}",
}


def links(
    *,
    only: Annotated[
        str | None, typer.Option(help="Measure only the kinds of link whose name contains this.")
    ] = None,
    seconds: SecondsOption = 20.0,
    rate: Annotated[
        list[float] | None,
        typer.Option(help="Ticks, or captures, per second; may be repeated. Default: 25 and 100."),
    ] = None,
    ticks: Annotated[
        str, typer.Option(help="fixed: ticks at a fixed rate. capture: one for each capture.")
    ] = "fixed",
    predictor: Annotated[
        str, typer.Option(help="The node's predictor; name a network to include its inference.")
    ] = "zero_velocity",
    people: Annotated[int, typer.Option(help="Number of people in the room.")] = 2,
    wires: Annotated[bool, typer.Option(help="Also measure the load of a serial wire.")] = True,
    as_json: JsonOption = False,
) -> None:
    """Measure the delay from a scene's arrival to the last byte, and the load of a serial wire.

    This runs in real time, so other programs disturb it; the machine's load is also printed.

    Example: hri-predict bench links --only "serial pty 921600" --ticks capture --rate 25
    """
    if ticks not in ("fixed", "capture"):
        raise ConfigError(f"--ticks {ticks}: give fixed or capture")
    demand("--people", people, 1, MAX_PEOPLE)
    least = 10.0 if ticks == "fixed" else 12.5  # the floor is four fifths of it
    rates = tuple(rate or _RATES_HZ)
    for each in rates:
        demand("--rate", each, least, 100.0)
    names = [name for name in KINDS if only is None or only.lower() in name.lower()]
    if not names:
        raise ConfigError(
            f"--only {only}: no kind of link contains this in its name ({', '.join(KINDS)})"
        )
    load = [os.getloadavg()[0]]
    cases = list(itertools.product(names, rates))
    found = (
        delay(*case, seconds, ticks=ticks, predictor=predictor, people=people) for case in cases
    )
    delays = measure(found, len(cases), "delays")
    fills = []
    if wires and any(name.startswith("serial") for name in names):
        pairs = list(itertools.product(BAUDRATES, RESERVED))
        full = (saturate(baudrate, seconds, reserved) for baudrate, reserved in pairs)
        fills = measure(full, len(pairs), "serial wires")
    load.append(os.getloadavg()[0])
    if as_json:
        print(json.dumps({"delays": delays, "serial_wires": fills, "load_average": load}))
        return
    title = "From a scene's arrival to the last byte of Advice and Status, p50 / p99 ms"
    figures(title, _DELAYS, delays)
    for reason in dict.fromkeys(row["not_here"] for row in delays if "not_here" in row):
        print(f"not available: {reason}")
    if fills:
        figures("A serial link with more Zones and Poses than it can send", _WIRES, fills)
    print(f"{os.cpu_count()} processors, load average {load[0]:.1f} before and {load[1]:.1f} after")


def delay(kind: str, rate_hz: float, seconds: float, /, **load: Any) -> dict[str, Any]:
    """Return the result of ``latency`` for a kind of link, or the reason why it cannot run here."""
    try:
        return latency(kind, rate_hz, seconds, **load)
    except LinkError as error:
        return {"link": kind, "rate_hz": rate_hz, "not_here": str(error)}


def rows(scope: Scope) -> Iterator[Row]:
    """Yield latency by stage for each kind of link, in ms, then the wait in a full serial port."""
    for name, rate_hz in itertools.product(KINDS, scope.age_rates_hz):
        yield from rows_of([delay(name, rate_hz, scope.seconds)], "link", "rate_hz")
    for baudrate, reserved in itertools.product(BAUDRATES, RESERVED):
        full = saturate(baudrate, scope.seconds, reserved)
        name = f"serial {baudrate}, reserved {reserved:g}"
        yield from rows_of([{"wire": name, "used_percent": 100 * full["used"]} | full], "wire")


# -- share of a serial wire that an overloaded link uses, and bytes that wait in the port ----------

RATE_HZ = 25.0
PEOPLE = 6
"""Zones and poses of six people at 25 Hz are 1.9 times the capacity of 921600 bit/s."""


@contextlib.contextmanager
def _prompt_threads() -> Iterator[None]:
    """Let threads switch as quickly as in the running node."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(interval)


def saturate(baudrate: int, seconds: float, reserved_load: float = 0.0) -> dict[str, Any]:
    """Post more Zones and Poses than the wire can carry, and measure what the wire carried.

    Returns:
        ``used``: bytes carried, divided by the wire's capacity in that time; ``backlog_ms``: time
            to drain the bytes that wait in the port (p50, p99, max); and the link's counters.
    """
    with child(serial_line, baudrate / 10) as line, _prompt_threads():
        settings = SerialLinkSettings(
            name="bench",
            port=line.receive(),
            baudrate=baudrate,
            reserved_load=reserved_load,
            robot_state_rate_hz=0.0,
        )
        clock = MonotonicClock()
        link = SerialLink(settings, clock, rate_hz=RATE_HZ)
        link.start()
        posted = 0
        start_ns = clock.now_ns()
        for cycle in range(int(seconds * RATE_HZ)):
            clock.wait_until(start_ns + round(cycle * 1e9 / RATE_HZ))
            for message in of_a_cycle(cycle, clock.now_ns(), PEOPLE):
                link.post(message)
                posted += 1
        link.stop()
        report = line.report()
    counters = link.counters
    backlog_ms = [bytes_ * 1e4 / baudrate for bytes_ in report.backlog_bytes or [0]]
    return {
        "baudrate": baudrate,
        "reserved_load": reserved_load,
        "seconds": round(report.busy_s, 3),
        "bytes": report.received,
        "used": round(report.received / (report.busy_s * baudrate / 10), 4),
        "backlog_ms": spread(backlog_ms, 2),
        "posted": posted,
        "sent": counters.messages_sent,
        "decimated": counters.decimated,
        "superseded": counters.superseded,
        "write_errors": counters.write_errors,
    }


# -- section age: from a capture to the last byte of its Advice and Status, by stage ---------------

_STAGES = {"wait": "wait", "inference": "inference", "node": "node", "link": "link", "total": "age"}
_AIM_MS = 15.0  # p99 of what the node adds, from capture to last byte
_WAIT = "floor of wait: at a fixed rate, a capture waits at least half a period on average"
_AGE = "aim for age: 15 ms, plus one period at a fixed rate"


def age(scope: Scope) -> Iterator[Row]:
    """Yield latency by stage, in ms: wait for the tick, node, predictor, link."""
    modes = get_args(NodeSettings.model_fields["ticks"].annotation)
    predictors = (scope.baseline, scope.network)
    for wire, rate_hz, predictor, ticks in itertools.product(
        WIRES[: scope.wires], scope.age_rates_hz, predictors, modes
    ):
        name = f"{short_name(wire)}, {rate_hz:g} Hz, {predictor}"
        if ticks != "fixed":
            name += f", ticks: {ticks}"
        found = delay(wire, rate_hz, scope.seconds, ticks=ticks, predictor=predictor)
        if "not_here" in found:
            yield Row(part=name, unit="ms", note=str(found["not_here"]))
            continue
        period_ms = 1e3 / rate_hz if ticks == "fixed" else 0.0
        for stage, told in _STAGES.items():
            yield _row(f"{name}: {told}", stage, found, period_ms)


def _row(part: str, stage: str, found: dict[str, Any], period_ms: float) -> Row:
    spread = found.get(f"{stage}_ms")
    if spread is None:
        return Row(part=part, unit="ms", note="no scene was measured")
    beside: dict[str, Any] = {}
    if stage == "wait" and period_ms:
        beside = {"floor": 0.5 * period_ms, "why": _WAIT}
    if stage == "total":
        beside = {"aim": _AIM_MS + period_ms, "aim_of": "p99", "why": _AGE}
        beside["more"] = {"scenes": found["scenes"], "missed": found["missed"]}
        if found["missed"]:
            beside["note"] = f"{found['missed']} Statuses were replaced by newer ones"
    return Row(part=part, unit="ms", **spread, **beside)
