"""``bench fleet``: measure the zenoh link: latency, processor time and payload."""

import json
from collections.abc import Iterator
from typing import Annotated

import typer

from hri_predict.cli.common import JsonOption, need_extra, progress, without_effect
from hri_sim.bench.rows import Row, Scope, rows_of
from hri_sim.bench.table import Columns, SecondsOption, measure, report

_COLUMNS: Columns = {
    "by": "{by}",
    "Hz": "{rate_hz:g}",
    "received": "{heard} of {sent}",
    "superseded": "{superseded}",
    "p50 µs": "{latency_us[p50]:.0f}",
    "p99 µs": "{latency_us[p99]:.0f}",
    "max µs": "{latency_us[max]:.0f}",
    "CPU of one core": "{cpu_percent:.1f} %",
    "kB/s": lambda row: f"{row['bytes_per_s'] / 1e3:.1f}",
}


def fleet(
    seconds: SecondsOption = 20.0,
    recovery: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1000,
            help="Measure instead how soon a cell joins and recovers, repeating each this many "
            "times.",
        ),
    ] = None,
    cells: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=256,
            help="Measure instead the page of 'fleet --operator', showing this many cells at 25 "
            "Hz.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the zenoh link: time from posting a message to its decoding in another process.

    The table also shows processor time and payload. This runs in real time, so other programs
    disturb it. With --recovery: the time until messages of a cell arrive. With --cells:
    processor time of 'fleet --operator' and of its page, and the delay from posting a message until
    a browser has it.

    Example: hri-predict bench fleet --seconds 5
    """
    need_extra("zenoh", "fleet")
    if cells is not None:
        without_effect({"--recovery": recovery}, "with --cells")
        _page(cells, seconds, as_json)
        return
    from hri_sim.bench import fleet_cost as bench

    if recovery is not None:
        print(json.dumps(bench.recovery(recovery)))
        return
    count = len(bench.TOPOLOGIES) * len(bench.RATES_HZ)
    rows = measure(bench.costs(seconds), count, "zenoh")
    report(rows, as_json, "From posting to decoding in another process, over zenoh", _COLUMNS)


def rows(scope: Scope) -> Iterator[Row]:
    """Figures of the link, by topology and rate."""
    need_extra("zenoh", "fleet")
    from hri_sim.bench.fleet_cost import costs

    return rows_of(costs(scope.seconds), "by", "rate_hz")


def _page(cells: int, seconds: float, as_json: bool) -> None:
    from hri_sim.bench.fleet_page import page

    with progress() as bar:
        bar.add_task(f"{cells} cells on one page", total=None)
        row = page(cells, seconds)
    if as_json:
        print(json.dumps(row))
        return
    cpu = row["cpu_s_per_s"]
    print(f"{cells} cells at {row['rate_hz']} Hz; load average before: {row['load']}")
    print(
        f"processor time, s/s: hri-predict fleet {cpu['fleet']}, its page {cpu['page']}; "
        f"the cells {cpu['cells']}; memory {row['memory_mib']} MiB"
    )
    for name, what in (("change_ms", "a change of level"), ("number_ms", "another message")):
        ms = row[name]
        said = f"p50 {ms['p50']}, p99 {ms['p99']}, max {ms['max']} ms" if ms else "there was none"
        print(f"delay of {what}: {said}")
    print(
        f"{row['events_per_s']} events/s of {row['bytes_per_event'] / 1e3:.1f} kB; "
        f"superseded {row['superseded']}, never shown {row['unshown']}, "
        f"shown as no level {row['gone']}"
    )
