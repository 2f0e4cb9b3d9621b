"""``bench links``: measure the delay from a scene to the wire, and how much of it a link uses."""

import json
import os
from typing import Annotated, Any

import typer

from hri_predict.base.errors import ConfigError, LinkError
from hri_sim.bench.capacity import saturate
from hri_sim.bench.cell import MAX_PEOPLE
from hri_sim.bench.latency import KINDS, latency
from hri_sim.bench.table import JsonOption, figures, measure

BAUDRATES, RESERVED = (115_200, 921_600), (0.0, 0.3)  # the whole wire, and the default
_RATES_HZ = (25.0, 100.0)
_SPANS = {
    "wait for tick": "wait_ms",
    "inference": "inference_ms",
    "node": "node_ms",
    "link": "link_ms",
    "total": "total_ms",
}
_COUNTS = {"scenes": "scenes", "missed": "missed", "late ticks": "late_ticks"}
_DELAYS = {
    "link": "{link}",
    "Hz": "{rate_hz:g}",
    **{head: f"{{{key}}}" for head, key in (_SPANS | _COUNTS).items()},
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
    seconds: Annotated[
        float, typer.Option(help="Seconds to measure each kind of link at each rate.")
    ] = 20.0,
    rate: Annotated[
        list[float] | None,
        typer.Option(help="Ticks, or captures, per second; may be repeated. Default: 25 and 100."),
    ] = None,
    ticks: Annotated[
        str, typer.Option(help="fixed: ticks at a fixed rate. capture: one for each capture.")
    ] = "fixed",
    predictor: Annotated[
        str, typer.Option(help="The node's predictor; a network, to measure its inference too.")
    ] = "zero_velocity",
    people: Annotated[int, typer.Option(help="Number of people in the room.")] = 2,
    wires: Annotated[bool, typer.Option(help="Measure how full a serial wire gets, too.")] = True,
    as_json: JsonOption = False,
) -> None:
    """Measure the delay from a scene's arrival to the last byte, and the load of a serial wire.

    This runs in real time, so other programs disturb it: the machine's load is printed, too.

    Example: hri-predict bench links --only "serial pty 921600" --ticks capture --rate 25
    """
    if not 1.0 <= seconds <= 3600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 3600")
    if ticks not in ("fixed", "capture"):
        raise ConfigError(f"--ticks {ticks}: give fixed or capture")
    if not 1 <= people <= MAX_PEOPLE:
        raise ConfigError(f"--people {people}: give 1 to {MAX_PEOPLE}")
    least = 10.0 if ticks == "fixed" else 12.5  # the floor is four fifths of it
    rates = tuple(rate or _RATES_HZ)
    for each in rates:
        if not least <= each <= 100.0:
            raise ConfigError(f"--rate {each:g}: give {least:g} to 100")
    names = [name for name in KINDS if only is None or only.lower() in name.lower()]
    if not names:
        raise ConfigError(
            f"--only {only}: no kind of link has this in its name ({', '.join(KINDS)})"
        )
    load = [os.getloadavg()[0]]
    cases = [(name, rate_hz) for name in names for rate_hz in rates]
    found = (
        delay(*case, seconds, ticks=ticks, predictor=predictor, people=people) for case in cases
    )
    delays = measure(found, len(cases), "delays")
    fills = []
    if wires and any(name.startswith("serial") for name in names):
        pairs = [(baudrate, reserved) for baudrate in BAUDRATES for reserved in RESERVED]
        full = (saturate(baudrate, seconds, reserved) for baudrate, reserved in pairs)
        fills = measure(full, len(pairs), "serial wires")
    load.append(os.getloadavg()[0])
    if as_json:
        print(json.dumps({"delays": delays, "serial_wires": fills, "load_average": load}))
        return
    title = "Scene's arrival to last byte of Advice and Status, p50 / p99 ms"
    figures(title, _DELAYS, map(_shown, delays))
    for reason in dict.fromkeys(row["not_here"] for row in delays if "not_here" in row):
        print(f"not available: {reason}")
    if fills:
        figures("A serial link with more Zones and Poses than it can send", _WIRES, fills)
    print(f"{os.cpu_count()} processors, load average {load[0]:.1f} before and {load[1]:.1f} after")


def delay(kind: str, rate_hz: float, seconds: float, /, **load: Any) -> dict[str, Any]:
    """Return the result of ``latency`` on a kind of link, or why this machine has no such wire."""
    try:
        return latency(kind, rate_hz, seconds, **load)
    except LinkError as error:
        return {"link": kind, "rate_hz": rate_hz, "not_here": str(error)}


def _shown(row: dict[str, Any]) -> dict[str, Any]:
    """The row as text; without figures if this machine has no such wire."""
    if "not_here" in row:
        empty = dict.fromkeys((*_SPANS.values(), *_COUNTS.values()), "")
        return row | empty | {"wait_ms": "not available"}
    spans = {key: row.get(key) for key in _SPANS.values()}
    return row | {
        key: f"{span['p50']:.2f} / {span['p99']:.2f}" if span else "-"
        for key, span in spans.items()
    }
