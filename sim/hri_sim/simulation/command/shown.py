"""Results of ``simulate`` on the screen, in its three forms."""

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from hri_predict.cli.common import counting, tell
from hri_predict.cli.common import show as show_tables
from hri_predict.lab.evaluation import table as evaluation
from hri_sim.simulation.request import (
    DistanceRequest,
    OcclusionRequest,
    OcclusionRow,
    SimulationReport,
)


def occluded(request: OcclusionRequest, *, as_json: bool) -> int:
    """Play the episodes and print a table; 1 if a moving robot touched a person."""
    from hri_sim.simulation.occluded import simulate as play

    with counting("episodes") as progress:
        rows = list(play(request, progress))
    found = [_of_mode([row for row in rows if row.mode == mode]) for mode in request.modes]
    if as_json:
        print(
            json.dumps(
                {"request": asdict(request) | {"config": str(request.config)}, "modes": found}
            )
        )
    else:
        _show(request, found)
    for row in rows:
        if row.contacts:
            print(f"contact: episode {row.index}, mode {row.mode}", file=sys.stderr)
    return int(any(row.contacts for row in rows))


def _of_mode(rows: Sequence[OcclusionRow]) -> dict[str, object]:
    count = max(len(rows), 1)
    return {
        "mode": rows[0].mode if rows else "",
        "episodes": len(rows),
        "contacts": sum(row.contacts for row in rows),
        "contacts_standing": sum(row.contacts_standing for row in rows),
        "permitted": sum(row.permitted for row in rows) / count,
        "lost": sum(row.lost for row in rows) / count,
    }


def _show(request: OcclusionRequest, found: Sequence[dict[str, object]]) -> None:
    seen = "nothing is hidden" if not request.occlude else f"{request.cameras} camera(s)"
    free = ", free space seen" if request.free_space else ""
    rates = ", ".join(f"{rate:g}" for rate in request.rates_hz)
    table = Table(title=f"{request.episodes} episodes at {rates} Hz, {seen}{free}")
    for column in (
        "mode", "contacts, moving", "contacts, standing", "speed permitted, %", "person lost, %"
    ):  # fmt: skip
        table.add_column(column, justify="left" if column == "mode" else "right")
    for row in found:
        table.add_row(
            str(row["mode"]),
            str(row["contacts"]),
            str(row["contacts_standing"]),
            f"{100 * float(str(row['permitted'])):.1f}",
            f"{100 * float(str(row['lost'])):.1f}",
        )
    Console().print(table)


# -- simulate --distance: how near people may work while the robot runs ----------------------------


def distances(request: DistanceRequest, *, as_json: bool) -> int:
    """Measure all cases and print a table."""
    from hri_sim.simulation.distance import run as measured

    with counting("people") as progress:
        report = measured.run(request, progress)
    if as_json:
        print(report.json)
    else:
        show_tables(
            [table for table in report.tables if isinstance(table, evaluation.Table)], report.notes
        )
    if report.files:
        tell(report.files)
    return 0


# -- a simulation's tables and notes on the screen -------------------------------------------------


def show(report: SimulationReport) -> None:
    """Print them, one column for each row, because rows are wider than a terminal."""
    console = Console()
    for table in report.tables:
        shown = Table(
            title=table.title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
        )
        # one column per variant: a row of intervals is wider than a terminal
        labels = 1 + (table.columns[1] == "mode")
        shown.add_column("", overflow="fold")
        for row in table.rows:
            shown.add_column("\n".join(row[:labels]), justify="right", overflow="fold")
        for k, column in enumerate(table.columns[labels:], labels):
            shown.add_row(column, *(row[k] for row in table.rows))
        console.print(shown)
    for note in report.notes:
        console.print(f"- {note}", markup=False, highlight=False)
    for path in report.files:
        print(f"written: {path}", file=sys.stderr)
