"""Plots of the bench: lines over a growing quantity, otherwise medians with their tails."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.looks import PALETTE
from hri_predict.cli.common import need_plots
from hri_sim.bench.rows import Row
from hri_sim.bench.saved import Sections

ENDINGS = (".png", ".svg")
MOST_ROWS = 14  # of a panel of medians; the largest ones
_WIDTH, _LINE_IN, _ROW_IN, _HEAD_IN = 8.0, 2.6, 0.22, 0.9
Panel = tuple[str, list[Row]]


def check(path: Path) -> None:
    """Check that the plot can be made, before anything is measured.

    Raises:
        ConfigError: unsupported file type, or matplotlib is not installed.
    """
    if path.suffix.lower() not in ENDINGS:
        raise ConfigError(f"--plot {path}: give a file name that ends in {' or '.join(ENDINGS)}")
    need_plots()


def plot(path: Path, sections: Sections, caption: str) -> None:
    """Draw all sections, in two columns of panels.

    Raises:
        ConfigError: it cannot be written.
    """
    from hri_predict.base.figures import Figure, write_figure  # needs matplotlib

    panels = [panel for name, rows in sections.items() for panel in _panels(name, rows)]
    columns = _columns(panels)
    tallest = max((_total(column) for column in columns), default=1.0)
    figure = Figure(figsize=(_WIDTH * max(1, len(columns)), tallest + 0.6), layout="constrained")
    parts = figure.subfigures(1, max(1, len(columns)), squeeze=False)[0]
    for column, part in zip(columns, parts, strict=False):
        _draw(part, column, tallest)
    figure.suptitle(caption, fontsize=9)
    write_figure(figure, path, dpi=110, option="--plot")


def _columns(panels: Sequence[Panel]) -> list[list[Panel]]:
    """Return two columns of about the same height, in order; one column for a single panel."""
    half, first = _total(panels) / 2.0, list[Panel]()
    for panel in panels:
        if first and _total(first) + 0.5 * _height(panel[1]) > half:
            break
        first.append(panel)
    return [column for column in (first, list(panels[len(first) :])) if column]


def _total(panels: Sequence[Panel]) -> float:
    return sum(_height(rows) for _, rows in panels)


def _draw(part: Any, panels: Sequence[Panel], tallest: float) -> None:
    """Draw panels below each other, leaving the rest of the column's height empty."""
    heights = [_height(rows) for _, rows in panels]
    left = tallest - sum(heights)
    ratios = [*heights, left] if left > 0.1 else heights
    axes = part.subplots(len(ratios), squeeze=False, height_ratios=ratios)[:, 0]
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    for (title, rows), ax in zip(panels, axes, strict=False):
        (_lines if rows[0].axis else _spans)(ax, rows)
        ax.set_title(title, loc="left", fontsize=10, fontweight="bold")


def _panels(name: str, rows: Sequence[Row]) -> list[Panel]:
    """Group rows of a section that can share a scale, by axis or by unit."""
    found: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        if row.p50 is not None and row.drawn:
            found.setdefault((row.axis, row.unit), []).append(row)
    panels = []
    for (axis, unit), members in found.items():
        title = f"{name}: {unit} by {axis}" if axis else f"{name}, {unit}"
        if not axis and len(members) > MOST_ROWS:
            title += f" (the {MOST_ROWS} largest of {len(members)})"
            largest = sorted(members, key=lambda row: row.p50 or 0.0)[-MOST_ROWS:]
            members = [row for row in members if row in largest]
        panels.append((title, members))
    return panels


def _height(rows: Sequence[Row]) -> float:
    return _LINE_IN if rows[0].axis else _HEAD_IN + _ROW_IN * len(rows)


def _lines(ax: Any, rows: Sequence[Row]) -> None:
    """Draw lines for each series: the median solid, the 99th percentile dashed."""
    names = list(dict.fromkeys(row.series for row in rows))
    for k, name in enumerate(names):
        line = sorted((r for r in rows if r.series == name), key=lambda r: r.size or 0.0)
        sizes = [row.size for row in line]
        colour = PALETTE[k % len(PALETTE)]
        style = "o" if k < len(PALETTE) else "s"
        ax.plot(sizes, [row.p50 for row in line], f"-{style}", color=colour, ms=4, label=name)
        if all(row.p99 is not None for row in line):
            ax.plot(sizes, [row.p99 for row in line], "--", color=colour, lw=0.8)
        if all(row.floor is not None for row in line):
            ax.plot(sizes, [row.floor for row in line], ":", color=colour, lw=1.2)
    ticks = sorted({row.size for row in rows if row.size is not None})
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    ax.minorticks_off()
    _plain(ax.yaxis)
    ax.set_xlabel(f"{rows[0].axis} (dashed: p99; dotted: floor)", fontsize=8)
    ax.set_ylabel(rows[0].unit, fontsize=8)
    ax.tick_params(labelsize=8)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)


def _spans(ax: Any, rows: Sequence[Row]) -> None:
    """Draw one line for each row: median (dot), p99 (end of bar), largest (tick), limit."""
    for k, row in enumerate(rows):
        high = row.p99 if row.p99 is not None else row.p50
        ax.plot([row.p50, high], [k, k], "-", color="#56B4E9", lw=4, solid_capstyle="butt")
        ax.plot([row.p50], [k], "o", color="#0072B2", ms=5)
        if row.max is not None:
            ax.plot([row.max], [k], "|", color="#0072B2", ms=9)
        for limit, mark in ((row.floor, "#000000"), (row.aim, "#D55E00")):
            if limit:
                ax.plot([limit], [k], "d", color=mark, ms=5)
    ax.set_yticks(range(len(rows)), [row.part for row in rows], fontsize=8)
    ax.set_ylim(len(rows) - 0.5, -0.5)
    if all(row.p50 and row.p50 > 0 for row in rows):
        ax.set_xscale("log")
        ax.minorticks_off()
        _plain(ax.xaxis)
    ax.set_xlabel(
        "dot: p50; bar: to p99; tick: largest; black diamond: floor; orange: aim", fontsize=8
    )
    ax.tick_params(axis="x", labelsize=8)
    ax.grid(axis="x", alpha=0.3)


def _plain(axis: Any) -> None:
    """Label the axis with plain numbers, with enough of them on a short logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator

    low, high = axis.get_view_interval()
    wide = high > 300.0 * low  # numbers of 2 and 5 would overlap
    axis.set_major_locator(LogLocator(base=10, subs=(1.0,) if wide else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
