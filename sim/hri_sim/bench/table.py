"""Output of the bench: a table for each section, legible at 80 columns, or JSON."""

import json
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import progress
from hri_sim.bench.rows import Row
from hri_sim.bench.saved import Change

_WIDTH = 150  # where no terminal says
Columns = Mapping[str, str | Callable[[Mapping[str, Any]], str]]
"""Column heading -> format of its cells: a string for ``str.format``, or a function of the row."""


def demand(flag: str, value: float, low: float, high: float) -> float:
    """Return a number given on the command line.

    Raises:
        ConfigError: the number is not between ``low`` and ``high``.
    """
    if not low <= value <= high:
        raise ConfigError(f"{flag} {value:g}: give {low:g} to {high:g}")
    return value


SecondsOption = Annotated[
    float,
    typer.Option(
        callback=lambda seconds: demand("--seconds", seconds, 1.0, 3600.0),
        help="Seconds to measure each row.",
    ),
]


def console() -> Console:
    """Return the console for standard output, wide if it is not a terminal."""
    return Console(width=None if sys.stdout.isatty() else _WIDTH)


def measure(rows: Iterable[dict[str, Any]], count: int, description: str) -> list[dict[str, Any]]:
    """Collect rows as they are measured, with a progress bar."""
    with progress() as bar:
        return list(bar.track(rows, total=count, description=description))


def figures(
    title: str,
    columns: Columns,
    rows: Iterable[Mapping[str, Any]],
    texts: Collection[str] = (),
) -> None:
    """Print a table of figures.

    Args:
        title: title of the table.
        columns: columns of the table.
        rows: key -> figure.
        texts: headings of text columns other than the first.
    """
    table = Table(title=title, title_justify="left")
    for index, head in enumerate(columns):
        text = index == 0 or head in texts
        table.add_column(head, justify="left" if text else "right", no_wrap=index == 0)
    for row in rows:
        cells = (c.format_map(row) if isinstance(c, str) else c(row) for c in columns.values())
        table.add_row(*cells)
    console().print(table)


def report(
    rows: Sequence[Mapping[str, Any]],
    as_json: bool,
    title: str,
    columns: Columns,
    *,
    texts: Collection[str] = (),
) -> None:
    """Print rows of figures as JSON or as a table; see ``figures``."""
    if as_json:
        print(json.dumps(rows))
    else:
        figures(title, columns, rows, texts)


def facts(result: Mapping[str, Any], as_json: bool) -> None:
    """Print a single result: a line for each fact, or JSON."""
    if as_json:
        print(json.dumps(result))
        return
    for name, value in result.items():
        print(f"{name.replace('_', ' ')}: {value}")


def show(console: Console, about: str, rows: Sequence[Row]) -> None:
    """Print a section: its table, then its floors, aims and notes."""
    beside = any(row.floor is not None or row.aim is not None for row in rows)
    table = _table(about, ("p50", "p99", "max", *(("beside", "times") if beside else ())), True)
    for row in rows:
        cells = [number(row.p50), number(row.p99), number(row.max)]
        if beside:
            cells += [_beside(row), _times(row)]
        table.add_row(row.part, row.unit, *cells)
    console.print(table)
    for why in dict.fromkeys(row.why for row in rows if row.why):
        console.print(f"- {why}", markup=False, highlight=False)
    for note in dict.fromkeys(f"{row.part}: {row.note}" for row in rows if row.note):
        console.print(f"- {note}", markup=False, highlight=False)


def show_changes(console: Console, changes: Sequence[Change], factor: float) -> None:
    """Print the ratios of a comparison, what got worse, and what was not compared."""
    table = _table("Ratio of new to old", ("p50", "p99"), False)
    for change in changes:
        ratios = ("" if r is None else f"{r:.2f}" for r in (change.p50, change.p99))
        table.add_row(f"{change.section}: {change.part}", change.verdict, *ratios)
    console.print(table)
    compared = [c for c in changes if c.compares]
    worse = [_with_ratios(c) for c in changes if c.verdict == "worse"]
    if worse:
        told = f"{len(worse)} of {len(compared)} got worse by more than {factor:g} times:"
        console.print("\n  ".join((told, *worse)), markup=False, highlight=False)
    elif compared:
        told = f"nothing of {len(compared)} got worse by more than {factor:g} times"
        console.print(told, markup=False, highlight=False)
    left = [f"{c.section}: {c.part}: {c.why or c.verdict}" for c in changes if not c.compares]
    if left:
        told = f"{len(left)} of {len(changes)} were not compared:"
        console.print("\n  ".join((told, *left)), markup=False, highlight=False)


def _with_ratios(change: Change) -> str:
    ratios = {"p50": change.p50, "p99": change.p99}
    told = ", ".join(f"{name} {ratio:.2f}" for name, ratio in ratios.items() if ratio is not None)
    return f"{change.section}: {change.part} ({told})"


def number(value: float | None) -> str:
    """Format with three digits, without an exponent; "" for none."""
    if value is None:
        return ""
    size = abs(value)
    if size == 0.0:
        return "0"
    if size < 0.01:
        return f"{value:.1g}"
    return f"{value:.0f}" if size >= 100 else f"{value:.1f}" if size >= 10 else f"{value:.2f}"


def _beside(row: Row) -> str:
    """Return the aim with the name of its figure, or the floor."""
    if row.aim is None:
        return "" if row.floor is None else f"floor {number(row.floor)}"
    of = "" if row.aim_of == "p50" else f"{row.aim_of} "
    return f"{of}{'>' if row.more_is_better else '<'} {number(row.aim)}"


def _times(row: Row) -> str:
    """Return the figure as a multiple of the aim or the floor."""
    limit, of = (row.floor, "p50") if row.aim is None else (row.aim, row.aim_of)
    value = getattr(row, of)
    return f"{value / limit:.2f}" if limit and value is not None else ""


def _table(title: str, heads: Sequence[str], unit: bool) -> Table:
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("part", overflow="fold", min_width=22)
    table.add_column("" if not unit else "unit", no_wrap=True)
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    return table
