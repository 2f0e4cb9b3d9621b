"""``bench links``: measure the delay from a scene to the wire, and how much of it a link uses."""

import json
import os
import sys
from collections.abc import Iterable
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from hri_predict import registry
from hri_predict.cli.common import progress
from hri_predict.errors import ConfigError

_SPANS = ("wait", "node", "link", "total")


def links(
    only: Annotated[
        str | None, typer.Option(help="Measure only the kinds of link whose name contains this.")
    ] = None,
    seconds: Annotated[
        float, typer.Option(help="Seconds to measure each kind of link at each rate.")
    ] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Measure the delay from a scene's arrival to the last byte, and the load of a serial wire.

    This runs in real time, so other programs disturb it: the machine's load is printed, too.

    Example: hri-predict bench links --only serial --seconds 5
    """
    if not 1.0 <= seconds <= 3600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 3600")
    bench = registry.load("simulations", "links")
    names = [name for name in bench.kinds() if only is None or only.lower() in name.lower()]
    if not names:
        raise ConfigError(
            f"--only {only}: no kind of link has this in its name ({', '.join(bench.kinds())})"
        )
    load = [os.getloadavg()[0]]
    delays = _told("delays", bench.delays(names, seconds), len(names) * len(bench.RATES_HZ))
    fills = []
    if any(name.startswith("serial") for name in names):
        fills = _told("serial wires", bench.capacities(seconds), 2 * len(bench.BAUDRATES))
    load.append(os.getloadavg()[0])
    if as_json:
        print(json.dumps({"delays": delays, "serial_wires": fills, "load_average": load}))
        return
    console = Console(width=None if sys.stdout.isatty() else 120)
    console.print(_delay_table(delays))
    for reason in dict.fromkeys(row["not_here"] for row in delays if "not_here" in row):
        console.print(f"not available: {reason}", markup=False, highlight=False)
    if fills:
        console.print(_wire_table(fills))
    console.print(
        f"{os.cpu_count()} processors, load average {load[0]:.1f} before and {load[1]:.1f} after"
    )


def _told(what: str, rows: Iterable[dict[str, Any]], count: int) -> list[dict[str, Any]]:
    with progress() as bar:
        return list(bar.track(rows, total=count, description=what))


def _delay_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(
        title="Scene's arrival to last byte of Advice and Status, without inference, p50 / p99 ms",
        title_justify="left",
    )
    table.add_column("link")
    heads = ("Hz", "wait for tick", "node", "link", "total", "scenes", "missed")
    for name in heads:
        table.add_column(name, justify="right")
    for row in rows:
        if "not_here" in row:
            table.add_row(row["link"], f"{row['rate_hz']:g}", "not available")
            continue
        spans = [_pair(row.get(f"{span}_ms")) for span in _SPANS]
        counts = (str(row["scenes"]), str(row["missed"]))
        table.add_row(row["link"], f"{row['rate_hz']:g}", *spans, *counts)
    return table


def _wire_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(
        title="A serial link with more Zones and Poses than it can send", title_justify="left"
    )
    for name in ("bit/s", "reserved load", "wire used", "wait in port, ms", "sent", "decimated"):
        table.add_column(name, justify="right")
    for row in rows:
        waits = row["backlog_ms"]
        table.add_row(
            str(row["baudrate"]),
            f"{row['reserved_load']:g}",
            f"{100 * row['used']:.1f} %",
            f"{_pair(waits)}, max {waits['max']:.1f}",
            str(row["sent"]),
            str(row["decimated"]),
        )
    return table


def _pair(span: dict[str, float] | None) -> str:
    return "-" if span is None else f"{span['p50']:.2f} / {span['p99']:.2f}"
