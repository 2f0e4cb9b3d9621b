"""Output of ``simulate``, for its three kinds of simulation."""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as ScreenTable

from hri_predict.cli.common import counting, result, show, tell
from hri_predict.lab.evaluation.table import Table
from hri_sim.simulation.request import (
    DistanceRequest,
    OcclusionRequest,
    OcclusionRow,
    SimulationReport,
)


def occluded(request: OcclusionRequest, *, as_json: bool) -> int:
    """Play the episodes and print a table; return 1 if a moving robot touched a person."""
    from hri_sim.simulation.occluded import simulate as play

    with counting("episodes") as progress:
        rows = list(play(request, progress))
    found = [_of_mode([row for row in rows if row.mode == mode]) for mode in request.modes]
    asked = asdict(request) | {"config": str(request.config)}
    result(as_json, {"request": asked, "modes": found}, [_table(request, found)])
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


def _table(request: OcclusionRequest, found: Sequence[dict[str, Any]]) -> Table:
    seen = "nothing is hidden" if not request.occlude else f"{request.cameras} camera(s)"
    free = ", free space seen" if request.free_space else ""
    rates = ", ".join(f"{rate:g}" for rate in request.rates_hz)
    return Table(
        f"{request.episodes} episodes at {rates} Hz, {seen}{free}",
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

    with counting("people") as progress:
        report = measured.run(request, progress)
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
