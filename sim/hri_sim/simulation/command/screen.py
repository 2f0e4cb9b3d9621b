"""A simulation's tables and notes on the screen."""

import sys

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from hri_sim.simulation.request import SimulationReport


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
