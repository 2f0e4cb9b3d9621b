"""Plot of a benchmark as PNG: error by horizon, a panel per action, printed numbers as marks."""

import itertools
from typing import Any

import numpy as np

from hri_predict.base.figures import Figure, legend_below, panels
from hri_predict.base.looks import PALETTE
from hri_predict.lab.evaluation.benchmark import mean_over
from hri_predict.lab.evaluation.benchmark_result import MEAN, BenchmarkResult, printed_at

# baselines are grey
_BASELINES = {"zero_velocity": "-", "constant_velocity": "--"}


def error_by_horizon(result: BenchmarkResult) -> Figure:
    """Measured errors as lines, errors that papers print for the same protocol as marks."""
    actions = (MEAN, *result.actions)
    figure, grid = panels(len(actions), 3, (4.2, 3.2))
    for axes, action in zip(grid, actions, strict=True):
        _measured(axes, result, action)
        _printed(axes, result, action)
        axes.set_title(action, fontsize=10)
        axes.set_xlabel("frames ahead", fontsize=8)
        axes.set_ylabel(result.protocol.unit, fontsize=8)
        axes.grid(alpha=0.3)
    legend_below(figure, most_columns=5)
    return figure


def _measured(axes: Any, result: BenchmarkResult, action: str) -> None:
    top, colours = 0.0, _colours(result)
    for name, scores in result.scores.items():
        errors = mean_over(result.protocol, scores) if action == MEAN else scores[action].errors
        line, colour = _BASELINES.get(name, "-"), colours.get(_key(name), "#888888")
        axes.plot(np.arange(1, len(errors) + 1), errors, line, color=colour, label=name)
        if name == "zero_velocity" and np.isfinite(errors).all():
            top = float(errors.max())
    if top > 0:
        axes.set_ylim(0, 1.15 * top)  # a runaway forecast leaves the picture


def _printed(axes: Any, result: BenchmarkResult, action: str) -> None:
    colours = _colours(result)
    for entry in result.printed:
        values = [printed_at(entry, action, frame, result.averaged) for frame in entry.columns]
        known = [(f + 1, v) for f, v in zip(entry.columns, values, strict=True) if v is not None]
        if known:
            colour, label = colours[_key(entry.method)], f"{entry.method}, printed"
            axes.plot(*zip(*known, strict=True), "o", markersize=4, color=colour, label=label)


def _colours(result: BenchmarkResult) -> dict[str, str]:
    """Colour of each method, the same for measured and printed errors."""
    measured = (name for name in result.scores if name not in _BASELINES)
    methods = dict.fromkeys(_key(n) for n in (*measured, *(e.method for e in result.printed)))
    return dict(zip(methods, itertools.cycle(PALETTE), strict=False))


def _key(method: str) -> str:
    """A method's name as the registry spells it: papers print "KD-Former"."""
    return method.lower().replace("-", "")
