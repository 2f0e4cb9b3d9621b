"""Output of ``simulate``, for its three kinds of simulation."""

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as ScreenTable

from hri_predict.cli.common import progress, result, show, tell
from hri_predict.lab.evaluation.table import Table
from hri_predict.run import config as configuration
from hri_sim.simulation.request import (
    DistanceRequest,
    OcclusionRequest,
    OcclusionRow,
    SimulationReport,
)


@contextlib.contextmanager
def counting(what: str, every_s: float = 5.0) -> Iterator[Callable[..., None]]:
    """Show a bar or, without a terminal, a line every few seconds.

    Yields:
        A function of the number done, the total and, optionally, the name of the last one done.
    """
    with progress() as bar:
        task = bar.add_task(what, total=None)
        ended, line = threading.Event(), [what]

        def update(done: int, total: int, name: str = "") -> None:
            last = f", last: {name}" if name else ""
            line[0] = f"{what}: {done} of {total}{last}"
            bar.update(task, completed=done, total=total, description=f"{what}{last}")

        def lines() -> None:
            started = time.monotonic()
            while not ended.wait(every_s):
                seconds = time.monotonic() - started
                print(f"{line[0]} ({seconds:.0f} s)", file=sys.stderr, flush=True)

        thread = threading.Thread(target=lines, daemon=True)
        if bar.disable:
            thread.start()
        try:
            yield update
        finally:
            ended.set()
            if bar.disable:
                thread.join()


def occluded(request: OcclusionRequest, *, as_json: bool) -> int:
    """Play the episodes and print a table; return 1 if a moving robot touched a person."""
    from hri_sim.simulation.occluded import simulate as play

    with counting("episodes") as count:
        rows = list(play(request, count))
    found = [_of_mode([row for row in rows if row.mode == mode]) for mode in request.modes]
    predictor = request.predictor or configuration.load(request.config).predictor.name
    asked = asdict(request) | {"config": str(request.config), "predictor": predictor}
    result(as_json, {"request": asked, "modes": found}, [_table(request, found, predictor)])
    for row in rows:
        if row.contacts:
            print(f"contact: episode {row.index}, mode {row.mode}", file=sys.stderr)
    return int(any(row.contacts for row in rows))


def _of_mode(rows: Sequence[OcclusionRow]) -> dict[str, Any]:
    count = max(len(rows), 1)
    return {
        "mode": rows[0].mode if rows else "",
        "episodes": len(rows),
        "contacts": sum(row.contacts for row in rows),
        "contacts_standing": sum(row.contacts_standing for row in rows),
        "permitted": sum(row.permitted for row in rows) / count,
        "lost": sum(row.lost for row in rows) / count,
    }


def _table(request: OcclusionRequest, found: Sequence[dict[str, Any]], predictor: str) -> Table:
    seen = "nothing is hidden" if not request.occlude else f"{request.cameras} camera(s)"
    free = ", free space seen" if request.free_space else ""
    rates = ", ".join(f"{rate:g}" for rate in request.rates_hz)
    return Table(
        f"{request.episodes} episodes at {rates} Hz, {seen}{free}, predictor {predictor}",
        ("mode", "contacts, moving", "contacts, standing", "speed permitted, %", "person lost, %"),
        tuple(
            (
                row["mode"],
                str(row["contacts"]),
                str(row["contacts_standing"]),
                f"{100 * row['permitted']:.1f}",
                f"{100 * row['lost']:.1f}",
            )
            for row in found
        ),
    )


def distances(request: DistanceRequest, *, as_json: bool) -> int:
    """Measure all cases of the working distance; print a table."""
    from hri_sim.simulation.distance import run as measured

    with counting("cases") as count:
        report = measured.run(request, count)
    if as_json:
        print(report.json)
    else:
        show(report.tables, report.notes)
    if report.files:
        tell(report.files)
    return 0


def show_report(report: SimulationReport) -> None:
    """Print tables and notes; rows are wider than a terminal, so each becomes a column."""
    console = Console()
    for table in report.tables:
        shown = ScreenTable(
            title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
        )
        labels = 1 + (table.columns[1] == "mode")
        shown.add_column("", overflow="fold")
        for row in table.rows:
            shown.add_column("\n".join(row[:labels]), justify="right", overflow="fold")
        for head, *cells in list(zip(table.columns, *table.rows, strict=True))[labels:]:
            shown.add_row(head, *cells)
        console.print(shown)
    show((), report.notes)
    if report.files:
        tell(report.files)
