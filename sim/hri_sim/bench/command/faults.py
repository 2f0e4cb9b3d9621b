"""``bench faults``: the reaction to each fault of the fault table."""

import json
import sys
from dataclasses import asdict
from typing import Annotated

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_sim.fault_table.outcome import FaultOutcome


def faults(
    only: Annotated[
        str | None, typer.Option(help="Run only faults whose name contains this.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Run each fault of the fault table alone, with a person near; exit status 1 if one fails.

    Example: hri-predict bench faults --only monitor
    """
    rows = []
    from hri_sim.fault_table.table import run_table

    for row in run_table(only):
        rows.append(row)
        print(f"{'ok  ' if row.fine else 'FAIL'} {row.fault}", file=sys.stderr)
    if not rows:
        raise ConfigError(
            f"--only {only}: no fault's name contains this; run without --only to see all names"
        )
    if as_json:
        print(json.dumps([asdict(row) for row in rows]))
    else:
        Console(width=None if sys.stdout.isatty() else 150).print(_fault_table(rows))
    if not all(row.fine for row in rows):
        raise typer.Exit(1)


def _fault_table(rows: list[FaultOutcome]) -> Table:
    table = Table(title="Each fault alone, with a person near", title_justify="left")
    for name in ("fault", "expected", "acted by"):
        table.add_column(name)
    for name in ("limit ms", "measured ms", "recovered ms"):
        table.add_column(name, justify="right")
    table.add_column("reason")
    table.add_column("")
    for row in rows:
        times = (row.limit_ms, row.measured_ms, row.recovered_ms)
        shown = ["-" if t is None else f"{t:.0f}" for t in times]
        verdict = "ok" if row.fine else "FAIL"
        table.add_row(row.fault, row.expected, row.acts, *shown, row.reason.lower(), verdict)
    return table
