"""Plots of the evaluation on recordings, PNG files: error by horizon, by action and by joint."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.figures import Figure, legend_below, panels, write_figure
from hri_predict.base.looks import PALETTE
from hri_predict.lab.evaluation.recordings import MEAN_ACTIONS, RecordingResult
from hri_predict.lab.evaluation.windows import RATE_HZ, scored_joints
from hri_predict.predictors.neural.body import BODY

# baselines are grey
_BASELINES = {
    "zero_velocity": ("#555555", "-"),
    "constant_velocity 120 ms": ("#777777", "--"),
    "constant_velocity 40 ms": ("#AAAAAA", "--"),
    "kalman": ("#999999", ":"),
}
_MARKERS = dict(zip(_BASELINES, "|x+1", strict=True))
_DPI = 130


def write_plots(results: Sequence[RecordingResult], out_dir: Path) -> list[Path]:
    """Write every plot of undisturbed results into a folder that exists; returns the files."""
    clean = [r for r in results if r.corruption is None]
    if not clean or not clean[0].actions:
        return []
    figures = {
        "error_by_action.png": error_by_action(clean),
        "error_by_horizon.png": error_by_horizon(clean),
        "error_by_joint.png": error_by_joint(clean),
    }
    return [write_figure(f, out_dir / name, dpi=_DPI) for name, f in figures.items()]


def error_by_horizon(results: Sequence[RecordingResult]) -> Figure:
    """Mean error over the five actions by horizon, one line per predictor."""
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    averaged = results[0].averaged
    curves = [r.mean_by_step() for r in results]
    _lines(axes, results, curves)
    what = "five actions" if averaged == MEAN_ACTIONS else ", ".join(averaged)
    axes.set_title(f"Mean joint error in the room, mean over {what}")
    _name_lines(axes, results, curves)
    return figure


def error_by_action(results: Sequence[RecordingResult]) -> Figure:
    """One panel per action: error by horizon, one line per predictor."""
    actions = list(results[0].actions)
    figure, grid = panels(len(actions), 3, (4.2, 3.1))
    for axes, action in zip(grid, actions, strict=True):
        _lines(axes, results, [r.actions[action].by_step() for r in results])
        axes.set_title(f"{action} ({results[0].actions[action].windows} windows)", fontsize=10)
    legend_below(figure)
    return figure


def error_by_joint(results: Sequence[RecordingResult]) -> Figure:
    """One row per joint, one mark per predictor; mean over the five actions, two horizons."""
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    joints, horizons_ms = scored_joints(), results[0].joint_horizons_ms
    (panels_of_row,) = figure.subplots(1, len(horizons_ms), sharey=True, squeeze=False)
    for axes, ms in zip(panels_of_row, horizons_ms, strict=True):
        step = round(ms * RATE_HZ / 1000) - 1
        values = [r.mean_by_joint()[step, joints] for r in results]
        for result, (colour, _), row in zip(results, _styles(results), values, strict=True):
            marker = _MARKERS.get(result.predictor, "o")
            axes.plot(
                row, range(len(joints)), marker, color=colour, label=result.predictor, alpha=0.85
            )
        axes.set_yticks(range(len(joints)), [BODY.joints[j] for j in joints])
        axes.set_xlim(0, _limit(results, values))
        axes.grid(alpha=0.3)
        axes.set_xlabel("mean error, mm")
        axes.set_title(f"{ms} ms ahead")
    figure.axes[0].invert_yaxis()
    legend_below(figure)
    return figure


def _lines(axes: Any, results: Sequence[RecordingResult], curves: Sequence[Floats]) -> None:
    ms = 1000.0 / RATE_HZ * np.arange(1, results[0].steps + 1)
    for result, (colour, line), curve in zip(results, _styles(results), curves, strict=True):
        width = 1.4 if result.predictor in _BASELINES else 1.9
        axes.plot(ms, curve, line, color=colour, label=result.predictor, linewidth=width)
    axes.set_xlim(0, ms[-1])
    axes.set_ylim(0, _limit(results, curves))
    axes.set_xlabel("ms ahead")
    axes.set_ylabel("mean error, mm")
    axes.grid(alpha=0.3)


def _limit(results: Sequence[RecordingResult], curves: Sequence[Floats]) -> float:
    """End of an axis: it fits zero velocity, and trained predictors up to three times its error.

    A runaway forecast leaves the picture; the tables give its error.
    """
    tops = {
        r.predictor: float(np.nanmax(c, initial=0.0)) for r, c in zip(results, curves, strict=True)
    }
    scale = tops.get("zero_velocity", max(tops.values()))
    trained = [top for name, top in tops.items() if name not in _BASELINES]
    return 1.1 * min(3 * scale, max([scale, *trained])) or 1.0  # where nothing is known


def _name_lines(axes: Any, results: Sequence[RecordingResult], curves: Sequence[Floats]) -> None:
    """Label the lines in the order of their last values."""
    handles, labels = axes.get_legend_handles_labels()
    order = np.argsort([-np.nan_to_num(c[-1], nan=np.inf) for c in curves])
    ends = [f"{c[-1]:.0f} mm" if np.isfinite(c[-1]) else "–" for c in curves]
    names = [f"{labels[i]}  {ends[i]}" for i in order]
    axes.legend(
        [handles[i] for i in order],
        names,
        title=f"at {results[0].steps / RATE_HZ:g} s",
        fontsize=9,
        loc="upper left",
    )


def _styles(results: Sequence[RecordingResult]) -> list[tuple[str, str]]:
    """Colour and line of each predictor: baselines are grey."""
    free = itertools.cycle(PALETTE)
    return [_BASELINES.get(r.predictor) or (next(free), "-") for r in results]
