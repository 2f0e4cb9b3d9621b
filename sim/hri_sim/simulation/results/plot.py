"""Plots of a simulation as PNG files: every measure as bars, and productivity over risk."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.figures import Figure, write_figure
from hri_predict.base.looks import PALETTE
from hri_sim.simulation.results.report import METRICS, Judged, Metric

_MARKERS = "osD^vP*h"  # hollow, so that markers at the same place stay visible
_DPI = 130


def write_plots(results: Sequence[Judged], out: Path) -> list[Path]:
    """Write every plot into an existing folder; return the files."""
    figures = {"simulate.png": bars(results), "risk_productivity.png": risk(results)}
    return [write_figure(f, out / name, dpi=_DPI) for name, f in figures.items()]


def bars(results: Sequence[Judged]) -> Figure:
    """Plot one panel per measure, one bar per predictor and mode, with 95 % intervals."""
    names = [_name(r, results) for r in results]
    figure = Figure(figsize=(13, 1.8 + 3 * (0.8 + 0.3 * len(results))), layout="constrained")
    panels = figure.subplots(3, 3, sharey=True)
    for panel, metric in zip(panels.flat, METRICS, strict=True):
        shown = [_bar(panel, k, result, metric) for k, result in enumerate(results)]
        better = f" ({metric.better} is better)" if metric.better else ""
        panel.set_title(metric.title + better, fontsize=9)
        panel.set_xlim(0, 1.25 * max(shown) or 1.0)  # a panel of zeros needs a scale, too
        panel.grid(axis="x", alpha=0.3)
        panel.set_axisbelow(True)
        panel.set_yticks(range(len(names)), names)
    panels[0, 0].invert_yaxis()
    first = results[0].totals
    figure.suptitle(
        f"Closed loop, {first['approaches']} approaches of {first['recordings']} recordings; "
        "black lines: 95 % interval, resampled by recording",
        fontsize=11,
    )
    return figure


def _bar(panel: Any, k: int, result: Judged, metric: Metric) -> float:
    """Draw one bar; return its extent including the interval."""
    estimate = result.estimates[metric.key]
    if estimate.value is None or estimate.low is None or estimate.high is None:
        panel.text(0, k, " –", va="center")
        return 0.0
    value, low, high = (metric.factor * v for v in (estimate.value, estimate.low, estimate.high))
    panel.barh(k, value, color=PALETTE[k % len(PALETTE)], height=0.6)
    panel.plot([low, high], [k, k], color="black", lw=1.5)
    panel.text(max(high, value), k, f" {value:.{metric.digits}f}", va="center", fontsize=8)
    return max(high, value)


def risk(results: Sequence[Judged]) -> Figure:
    """Plot productivity over the nearest distance of a moving robot: up and right is better."""
    figure = Figure(figsize=(8, 5.5), layout="constrained")
    panel = figure.subplots()
    for k, result in enumerate(results):
        work, near = result.estimates["productivity"], result.estimates["moving_separation"]
        if work.value is None or near.value is None:
            continue
        colour = PALETTE[k % len(PALETTE)]
        x, y = near.value, 100 * work.value
        panel.plot([near.low or 0, near.high or 0], [y, y], color=colour, lw=1)
        panel.plot([x, x], [100 * (work.low or 0), 100 * (work.high or 0)], color=colour, lw=1)
        panel.plot(result.totals["moving_separation_m"], y, "x", color=colour)
        panel.plot(
            x, y, _MARKERS[k % len(_MARKERS)], color=colour, ms=9, mfc="none", mew=1.8,
            label=_said(result, results),
        )  # fmt: skip
    panel.plot([], [], "x", color="grey", label="smallest over all approaches")
    panel.axvline(0, color="black", lw=0.8)
    panel.set_xlabel(
        "less risk →  smallest distance of a moving robot from a person, m (mean of approaches)"
    )
    panel.set_ylabel("productivity, % of an empty cell")
    panel.set_ylim(bottom=0)
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
    panel.set_title(
        "Productivity against risk; lines: 95 % intervals, resampled by recording", fontsize=10
    )
    return figure


def _said(result: Judged, results: Sequence[Judged]) -> str:
    contacts = result.totals["contacts"]
    near = result.estimates["violation_share"].value or 0.0
    touched = f"{contacts} contact{'' if contacts == 1 else 's'}"
    return f"{_name(result, results)}: {touched}, too close {100 * near:.2g} % of time"


def _name(result: Judged, results: Sequence[Judged]) -> str:
    """Return the variant's name, preceded by the predictor's if there are several."""
    several = len({r.predictor for r in results}) > 1
    return f"{result.predictor}, {result.variant}" if several else result.variant
