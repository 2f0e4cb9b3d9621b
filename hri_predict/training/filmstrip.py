"""Predicted against true motion, drawn so that a person can judge it by eye."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.errors import ConfigError
from hri_predict.predictors.base import Predictor
from hri_predict.predictors.body import BODY
from hri_predict.scene import Bools, Floats
from hri_predict.training.real import forecast
from hri_predict.training.real_windows import (
    FUTURE_STEPS,
    ORIGIN_STEPS,
    RATE_HZ,
    Motion,
    batches,
    scored_joints,
)

try:
    from matplotlib.figure import Figure
except ImportError as error:  # an extra of its own
    raise ConfigError(
        "plots need matplotlib; install it with pip install 'hri-predict[train]'"
    ) from error

SHOWN_MS = (200, 400, 600, 800, 1000)
_BEFORE = (13, 9, 5)  # steps of the history that are drawn: 0.48, 0.32 and 0.16 s ago
_TRUE = "#444444"
_COLOURS = ("#D55E00", "#0072B2", "#009E73", "#CC79A7")
_AZIMUTH, _ELEVATION = np.radians(35.0), np.radians(12.0)  # from the person's right, from above
_SCORED = np.array(scored_joints())
_BONES = tuple((i, p) for i, p in enumerate(BODY.parents) if p >= 0)


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One window and what was forecast from it.

    Attributes:
        action: what the person does.
        history: (T, 28, 3) metres.
        observed: (T, 28).
        future: (25, 28, 3).
        known: (25, 28).
        forecasts: by predictor (H, 28, 3).
    """

    action: str
    history: Floats
    observed: Bools
    future: Floats
    known: Bools
    forecasts: Mapping[str, Floats]


def typical(predictors: Mapping[str, Predictor], motions: Sequence[Motion]) -> Scene | None:
    """The window of these motions in which the first predictor's 1 s error is its median.

    So the picture shows neither its best moment nor its worst. ``None`` if no window has 1 s of
    known future.
    """
    first = next(iter(predictors.values()))
    ranked: list[tuple[float, Motion, int, int]] = []
    for motion in motions:
        for batch in batches(motion, max(ORIGIN_STEPS, first.history_steps)):
            predicted = forecast(first, batch)
            for k in range(len(predicted)):
                error = _error_mm(predicted[k], batch.future[k], batch.known[k], FUTURE_STEPS)
                if np.isfinite(error):
                    ranked.append((error, motion, batch.index, k))
    if not ranked:
        return None
    ranked.sort(key=lambda entry: entry[0])
    _, motion, index, k = ranked[len(ranked) // 2]
    longest = max([ORIGIN_STEPS, *(p.history_steps for p in predictors.values())])
    batch = next(b for b in batches(motion, longest) if b.index == index)
    made = {name: forecast(p, batch)[k] for name, p in predictors.items()}
    parts = batch.history[k], batch.observed[k], batch.future[k], batch.known[k]
    return Scene(motion.action, *parts, made)


def _error_mm(predicted: Floats, future: Floats, known: Bools, step: int) -> float:
    """Mean error at one step, from 1; NaN where nothing is known or predicted."""
    if step > len(predicted) or not known[step - 1, _SCORED].any():
        return float("nan")
    error = np.linalg.norm(predicted[step - 1] - future[step - 1], axis=-1)[_SCORED]
    return float(1000 * error[known[step - 1, _SCORED]].mean())


def draw(scenes: Sequence[Scene]) -> Figure:
    """A row per scene, a column per horizon; the truth grey, forecasts in colour."""
    views = [_View(scene) for scene in scenes]
    width = 2.6 * (1 + len(SHOWN_MS))
    heights = [view.height / view.width for view in views]
    figure = Figure(figsize=(width, 2.6 * sum(heights) + 0.9), layout="constrained")
    grid = figure.subplots(len(scenes), 1 + len(SHOWN_MS), squeeze=False, height_ratios=heights)
    for row, (scene, view) in enumerate(zip(scenes, views, strict=True)):
        for axes, ms in zip(grid[row], (0, *SHOWN_MS), strict=True):
            _cell(axes, scene, view, ms)
        grid[row, 0].set_ylabel(scene.action, fontsize=11)
    for axes, ms in zip(grid[0], (0, *SHOWN_MS), strict=True):
        axes.set_title(f"{ms} ms ahead" if ms else "now, and 0.5 s before", fontsize=11)
    names = {"what happened": _TRUE, **_colours(scenes[0].forecasts)}
    handles = [grid[0, 0].plot([], [], color=c, linewidth=2.5)[0] for c in names.values()]
    figure.legend(handles, list(names), loc="outside lower center", ncols=len(names), fontsize=11)
    return figure


def write_filmstrip(
    predictors: Mapping[str, Predictor],
    motions: Sequence[Motion],
    path: Path,
    actions: Sequence[str] | None = None,
) -> Path | None:
    """Draw the typical window of each action into a PNG file.

    Args:
        predictors: at most four; the first one chooses the windows.
        motions: see ``real_windows.read_motions``.
        path: the file.
        actions: those to draw, in this order; default all.

    Returns:
        The file, or ``None`` if no recording has 1 s of known future.

    Raises:
        ConfigError: the file cannot be written.
    """
    wanted = actions or list(dict.fromkeys(m.action for m in motions))
    found = (typical(predictors, [m for m in motions if m.action == a]) for a in wanted)
    chosen = [scene for scene in found if scene is not None]
    if not chosen:
        return None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        draw(chosen).savefig(path, dpi=110)
    except OSError as error:
        raise ConfigError(
            f"--out {path.parent}: cannot be written: {error.strerror}; name another folder"
        ) from error
    return path


class _View:
    """A camera that looks at the person from the right and somewhat from ahead and above.

    It is level, stands still over a scene, and shows lengths unshortened across the picture.
    """

    def __init__(self, scene: Scene) -> None:
        now, seen = scene.history[-1], scene.observed[-1]
        left, right = (_middle(now, seen, side) for side in ("l_", "r_"))
        across = left - right
        self._heading = float(np.arctan2(-across[0], across[1]))
        self._origin = now[seen].mean(axis=0)
        steps = [0, *(round(ms * RATE_HZ / 1000) for ms in SHOWN_MS)]
        shown = [now[seen], *(scene.future[s - 1][scene.known[s - 1]] for s in steps[1:])]
        shown += [scene.history[-b][scene.observed[-b]] for b in _BEFORE]
        points = self.project(np.concatenate(shown))  # a forecast that runs away leaves the picture
        self.low, self.high = points.min(axis=0) - 0.15, points.max(axis=0) + 0.15
        self.high[1] += 0.1  # room for the text
        lacking = 0.85 * (self.high - self.low)[1] - (self.high - self.low)[0]
        self.low[0] -= max(0.0, lacking) / 2  # no picture narrower than that
        self.high[0] += max(0.0, lacking) / 2
        self.width, self.height = (float(x) for x in self.high - self.low)

    def project(self, points: Floats) -> Floats:
        """(..., 3) metres in the room to (..., 2) metres in the picture."""
        angle = self._heading - np.pi / 2 + _AZIMUTH  # where the camera stands, as seen from above
        right = np.array([-np.sin(angle), np.cos(angle), 0.0])
        toward = np.array([np.cos(angle), np.sin(angle), 0.0])
        up = np.cos(_ELEVATION) * np.array([0.0, 0.0, 1.0]) - np.sin(_ELEVATION) * toward
        moved = points - self._origin
        return np.stack([moved @ right, moved @ up], axis=-1)


def _middle(positions: Floats, seen: Bools, side: str) -> Floats:
    own = np.array([j.startswith(side) for j in BODY.joints]) & seen
    return positions[own].mean(axis=0) if own.any() else np.zeros(3)


def _cell(axes: Any, scene: Scene, view: _View, ms: int) -> None:
    """One picture: the body now and its past, or a moment of the future."""
    axes.set_aspect("equal")
    axes.set_xlim(view.low[0], view.high[0])
    axes.set_ylim(view.low[1], view.high[1])
    axes.set_xticks([])
    axes.set_yticks([])
    if ms == 0:
        for back, shade in zip(_BEFORE, (0.15, 0.25, 0.4), strict=True):
            _body(axes, view, scene.history[-back], scene.observed[-back], _TRUE, shade)
        _body(axes, view, scene.history[-1], scene.observed[-1], _TRUE, 1.0)
        return
    step = round(ms * RATE_HZ / 1000)
    _body(axes, view, scene.future[step - 1], scene.known[step - 1], _TRUE, 1.0)
    texts = []
    for name, colour in _colours(scene.forecasts).items():
        predicted = scene.forecasts[name]
        if step <= len(predicted):
            _body(axes, view, predicted[step - 1], scene.known[step - 1], colour, 0.85)
            error = _error_mm(predicted, scene.future, scene.known, step)
            texts.append((f"{error:.0f} mm", colour))
    for place, (text, colour) in enumerate(texts):
        at = (place + 0.5) / len(texts)
        axes.text(
            at, 0.99, text, color=colour, fontsize=9, va="top", ha="center",
            transform=axes.transAxes,
        )  # fmt: skip


def _body(
    axes: Any, view: _View, positions: Floats, seen: Bools, colour: str, alpha: float
) -> None:
    """A stick figure; the right side of the body is drawn thinner."""
    points = view.project(positions)
    for joint, parent in _BONES:
        if seen[joint] and seen[parent]:
            width = 1.1 if BODY.joints[joint].startswith("r_") else 2.2
            axes.plot(
                points[[joint, parent], 0],
                points[[joint, parent], 1],
                color=colour,
                alpha=alpha,
                linewidth=width,
                solid_capstyle="round",
            )


def _colours(forecasts: Mapping[str, Floats]) -> dict[str, str]:
    return dict(zip(forecasts, _COLOURS, strict=False))
