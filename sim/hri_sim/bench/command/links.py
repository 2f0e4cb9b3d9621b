"""``bench links``: measure the delay from a scene to the wire, and how much of it a link uses."""

import json
import os
import sys
from collections.abc import Iterable
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import progress

_SPANS = ("wait", "inference", "node", "link", "total")
_RATES_HZ = (25.0, 100.0)
_MOST_PEOPLE = 16
_COUNTS = ("scenes", "missed", "late_ticks")


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
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Measure the delay from a scene's arrival to the last byte, and the load of a serial wire.

    This runs in real time, so other programs disturb it: the machine's load is printed, too.

    Example: hri-predict bench links --only "serial pty 921600" --ticks capture --rate 25
    """
    if not 1.0 <= seconds <= 3600.0:
        raise ConfigError(f"--seconds {seconds:g}: give 1 to 3600")
    if ticks not in ("fixed", "capture"):
        raise ConfigError(f"--ticks {ticks}: give fixed or capture")
    if not 1 <= people <= _MOST_PEOPLE:
        raise ConfigError(f"--people {people}: give 1 to {_MOST_PEOPLE}")
    least = 10.0 if ticks == "fixed" else 12.5  # the floor is four fifths of it
    rates = tuple(rate or _RATES_HZ)
    for each in rates:
        if not least <= each <= 100.0:
            raise ConfigError(f"--rate {each:g}: give {least:g} to 100")
    from hri_sim.bench import links as bench

    names = [name for name in bench.kinds() if only is None or only.lower() in name.lower()]
    if not names:
        raise ConfigError(
            f"--only {only}: no kind of link has this in its name ({', '.join(bench.kinds())})"
        )
    load = [os.getloadavg()[0]]
    rows = bench.delays(names, rates, seconds, ticks=ticks, predictor=predictor, people=people)
    delays = _told("delays", rows, len(names) * len(rates))
    fills = []
    if wires and any(name.startswith("serial") for name in names):
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
        title="Scene's arrival to last byte of Advice and Status, p50 / p99 ms",
        title_justify="left",
    )
    table.add_column("link", no_wrap=True)
    heads = ("Hz", "wait for tick", "inference", "node", "link", "total", *_COUNTS)
    for name in heads:
        table.add_column(name.replace("_", " "), justify="right")
    for row in rows:
        if "not_here" in row:
            table.add_row(row["link"], f"{row['rate_hz']:g}", "not available")
            continue
        spans = [_pair(row.get(f"{span}_ms")) for span in _SPANS]
        counts = [str(row[count]) for count in _COUNTS]
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
