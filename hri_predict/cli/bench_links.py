"""``bench links``: how long a scene takes onto a wire, and how much of a wire a link uses."""

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
        str | None, typer.Option(help="Only kinds of link whose name contains this.")
    ] = None,
    seconds: Annotated[float, typer.Option(help="For each kind of link and rate.")] = 20.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON alone.")] = False,
) -> None:
    """From a scene's arrival to the last byte written; and how full a serial wire gets.

    In real time, on this machine as it is now: the load is printed too.

    Example: hri-predict bench links --only serial --seconds 5
    """
    if not 1.0 <= seconds <= 3600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 3600")
    bench = registry.load("simulations", "links")
    names = [name for name in bench.kinds() if only is None or only.lower() in name.lower()]
    if not names:
        raise ConfigError(f"--only {only}: no such kind of link ({', '.join(bench.kinds())})")
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
        console.print(f"not here: {reason}", markup=False, highlight=False)
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
            table.add_row(row["link"], f"{row['rate_hz']:g}", "not here")
            continue
        spans = [_pair(row.get(f"{span}_ms")) for span in _SPANS]
        counts = (str(row["scenes"]), str(row["missed"]))
        table.add_row(row["link"], f"{row['rate_hz']:g}", *spans, *counts)
    return table


def _wire_table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="A link with more Zones and Poses than fit", title_justify="left")
    for name in ("bit/s", "reserved load", "wire used", "waits in port ms", "sent", "decimated"):
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
