"""``bench trackers``: measure what a tracker's joints and noise cost."""

import json
import sys
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import progress

_COLUMNS = {  # key of a row: head, form
    "tracker": ("tracker", "{}"),
    "noise": ("noise", "{}"),
    "unlike_percent": ("unlike %", "{:.1f}"),
    "widened_percent": ("widened %", "{:.1f}"),
    "predictive_m_s": ("predictive m/s", "{:.3f}"),
    "iso_m_s": ("iso m/s", "{:.3f}"),
    "ratio": ("ratio", "{:.2f}"),
    "clear_too_near": ("clear too close", "{}"),
    "contacts": ("contacts", "{}"),
}


def trackers(
    only: Annotated[
        str | None, typer.Option(help="Measure only trackers and noises whose name contains this.")
    ] = None,
    walks: Annotated[int, typer.Option(min=1, max=1000, help="Walks in each case and mode.")] = 4,
    predictor: Annotated[str, typer.Option(help="Name of the predictor to measure.")] = "sinn",
    as_json: Annotated[bool, typer.Option("--json", help="Print only JSON.")] = False,
) -> None:
    """Let people walk up to a robot and away, seen by several trackers with several kinds of noise.

    The whole node runs on the virtual clock, in modes predictive and iso. Exit status 1 if a robot
    was advised "clear" too close to a person, or touched a person while it moved.

    Example: hri-predict bench trackers --only "coco17 none" --walks 1
    """
    from hri_sim.bench import trackers as bench

    chosen = bench.cases(only)
    if not chosen:
        names = ", ".join(f"{tracker} {noise}" for tracker, noise in bench.cases(None))
        raise ConfigError(f"--only {only}: no case has this in its name; there are: {names}")
    with progress() as bar:
        measured = bench.rows(chosen, walks, predictor)
        rows = list(bar.track(measured, total=len(chosen), description="trackers"))
    if as_json:
        print(json.dumps(rows))
    else:
        Console(width=None if sys.stdout.isatty() else 120).print(_table(rows))
    if any(row["clear_too_near"] or row["contacts"] for row in rows):
        raise typer.Exit(1)


def _table(rows: list[dict[str, Any]]) -> Table:
    table = Table(title="People who walk up to a robot and away", title_justify="left")
    for key, (head, _) in _COLUMNS.items():
        table.add_column(head, justify="left" if key in ("tracker", "noise") else "right")
    for row in rows:
        table.add_row(*(form.format(row[key]) for key, (_, form) in _COLUMNS.items()))
    return table
