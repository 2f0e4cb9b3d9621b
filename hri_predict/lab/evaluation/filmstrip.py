"""Predicted over true motion, drawn so that a person can judge it by eye.

A row is one window, a column a time ahead. The choice of windows does not depend on any forecast:
the middle forecast origin of each action's longest recording.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.figures import (
    Figure,
    corner_text,
    frame,
    scale_bar,
    scene_grid,
    write_figure,
)
from hri_predict.contracts.predictor import Predictor
from hri_predict.lab.evaluation.recordings import forecast
from hri_predict.lab.evaluation.windows import (
    FUTURE_STEPS,
    ORIGIN_STEPS,
    RATE_HZ,
    Batch,
    Motion,
    batches,
    origins,
    scored_joints,
)
from hri_predict.predictors.neural.body import BODY

SHOWN_MS = (200, 400, 600, 800, 1000)
_AGO_MS = (480, 320, 160)
_TRUE, _PREDICTED, _GRID = "#9A9A9A", "#D55E00", "#E4E4E4"
_GRID_M = 0.5
_AZIMUTH, _ELEVATION = np.radians(35.0), np.radians(12.0)  # from the person's right, from above
_MARGIN_M, _BAR_M, _TEXT_M = 0.12, 0.2, 0.3  # around the body, below it, above it
_FARTHEST_M = 0.9  # from the middle of a picture to its side: a runaway forecast leaves it
_INCHES = 2.9  # width of a picture
_SCORED = np.array(scored_joints())
_TRUNK = BODY.joints.index("torso")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """One window.

    Attributes:
        recording: name of the recording.
        action: action of the person.
        time_s: time of the forecast origin, seconds after the recording's first capture.
        window: that one window, as a batch.
    """

    recording: str
    action: str
    time_s: float
    window: Batch

    def true(self, ms: int) -> tuple[Floats, Bools]:
        """(28, 3) metres and (28,) whether known, ``ms`` after now; before now if negative."""
        step = round(ms * RATE_HZ / 1000)
        if step > 0:
            return self.window.future[0, step - 1], self.window.known[0, step - 1]
        return self.window.history[0, step - 1], self.window.observed[0, step - 1]


def middle(motions: Sequence[Motion], history_steps: int) -> Scene | None:
    """The middle forecast origin of the longest of these motions.

    The choice favours neither good nor bad moments. ``None`` if no motion has 1 s of known future.

    Args:
        motions: motions of one action; see ``windows.read_motions``.
        history_steps: T of the window.
    """
    found = [(origins(m), m) for m in motions]
    whole = [(times, m) for (times, reach), m in found if reach == FUTURE_STEPS]
    if not whole:
        return None
    times, motion = max(whole, key=lambda entry: len(entry[0]))
    left = len(times) // 2
    time_s = float(times[left] - motion.stamps_ns[0]) * 1e-9
    for batch in batches(motion, history_steps):
        if left < len(batch.history):
            one = slice(left, left + 1)
            arrays: tuple[Any, ...] = batch.history, batch.observed, batch.future, batch.known
            window = Batch(motion, batch.index, *(array[one] for array in arrays))
            return Scene(motion.name, motion.action, time_s, window)
        left -= len(batch.history)
    return None


def write_filmstrips(
    predictors: Mapping[str, Predictor],
    motions: Sequence[Motion],
    out_dir: Path,
    actions: Sequence[str],
) -> list[Path]:
    """Draw the same windows, one of each action, for each predictor: ``filmstrip_NAME.png``.

    Returns:
        The files; none if no recording of the actions has 1 s of known future.

    Raises:
        ConfigError: a file cannot be written.
    """
    steps = max([ORIGIN_STEPS, *(p.history_steps for p in predictors.values())])
    found = (middle([m for m in motions if m.action == action], steps) for action in actions)
    scenes = [scene for scene in found if scene is not None]
    if not scenes:
        return []
    files = []
    for name, predictor in predictors.items():
        forecasts = [forecast(predictor, scene.window)[0] for scene in scenes]
        file = out_dir / f"filmstrip_{name.replace('/', '_')}.png"
        files.append(write_figure(draw(name, scenes, forecasts), file, dpi=100))
    return files


def draw(name: str, scenes: Sequence[Scene], forecasts: Sequence[Floats]) -> Figure:
    """One row per scene, one column per time, one scale; forecasts (H, 28, 3) metres."""
    views = [_View(scene, predicted) for scene, predicted in zip(scenes, forecasts, strict=True)]
    half = max(view.half_width for view in views)
    heights = [view.high - view.low for view in views]
    columns, inches_per_m = 1 + len(SHOWN_MS), _INCHES / (2 * half)
    size = _INCHES * columns + 0.6, inches_per_m * sum(heights) + 1.7
    figure, grid = scene_grid(size=size, heights=heights, columns=columns, pad=(0.02, 0.03))
    for row, (scene, predicted, view) in enumerate(zip(scenes, forecasts, views, strict=True)):
        for axes, ms in zip(grid[row], (0, *SHOWN_MS), strict=True):
            _frame(axes=axes, view=view, scene=scene, ms=ms, half=half)
            _cell(axes=axes, view=view, scene=scene, predicted=predicted, ms=ms)
        grid[row, 0].set_ylabel(scene.action, fontsize=13)
        _where(grid[row, 0], scene)
    for axes, ms in zip(grid[0], (0, *SHOWN_MS), strict=True):
        axes.set_title(f"+{ms} ms" if ms else "now (pale: past 0.5 s)", fontsize=13)
    _explain(figure, grid[0, 0], name)
    return figure


def _explain(figure: Figure, axes: Any, name: str) -> None:
    names = {"true pose": (_TRUE, 5.0), f"predicted by {name}": (_PREDICTED, 2.0)}
    handles = [axes.plot([], [], color=c, linewidth=w)[0] for c, w in names.values()]
    figure.legend(handles, list(names), loc="outside upper center", ncols=2, fontsize=13)
    figure.supxlabel(
        "mm: mean error of the scored joints; still: error if the pose stayed. Thin: the person's "
        "right side. Dotted: joints between are not observed.\n"
        f"Lines: the room, every {_GRID_M:g} m; pictures follow the body. Windows chosen without "
        "regard to the error: the middle forecast origin of each action's longest recording.",
        fontsize=10.5,
    )


class _View:
    """A camera that looks at the person from the right and somewhat from ahead and above.

    It is level, keeps its direction over a scene, and does not foreshorten lengths across the
    picture.
    """

    def __init__(self, scene: Scene, predicted: Floats) -> None:
        now, seen = scene.true(0)
        left, right = (_middle(now, seen, side) for side in ("l_", "r_"))
        across = left - right
        heading = float(np.arctan2(-across[0], across[1]))
        self._angle = heading - np.pi / 2 + _AZIMUTH  # direction to the camera, seen from above
        self._origin = now[seen].mean(axis=0)
        wide, tall = [], []
        for ms in (*(-ago for ago in _AGO_MS), 0, *SHOWN_MS):
            positions, known = scene.true(ms)
            shown = [positions[known]]
            step = round(ms * RATE_HZ / 1000)
            if 0 < step <= len(predicted):
                shown.append(predicted[step - 1][known])
            points = self.project(np.concatenate(shown))
            tall.append(points[:, 1])
            if known.any() and ms >= 0:  # the past may leave the picture
                wide.append(np.abs(points[:, 0] - self.centre(scene, ms)))
        self.half_width = min(_FARTHEST_M, float(np.concatenate(wide).max()) + _MARGIN_M)
        heights = np.concatenate(tall)
        self.low = max(float(heights.min()), -2 * _FARTHEST_M) - _BAR_M
        self.high = min(float(heights.max()), 2 * _FARTHEST_M) + _TEXT_M

    def project(self, points: Floats) -> Floats:
        """(..., 3) metres in the room to (..., 2) metres in the picture."""
        right = np.array([-np.sin(self._angle), np.cos(self._angle), 0.0])
        toward = np.array([np.cos(self._angle), np.sin(self._angle), 0.0])
        up = np.cos(_ELEVATION) * np.array([0.0, 0.0, 1.0]) - np.sin(_ELEVATION) * toward
        moved = points - self._origin
        return np.stack([moved @ right, moved @ up], axis=-1)

    def centre(self, scene: Scene, ms: int) -> float:
        """Middle of the true pose across the picture; 0 if the pose is not known."""
        positions, known = scene.true(ms)
        if not known.any():
            return 0.0
        across = self.project(positions[known])[:, 0]
        return float(across.min() + across.max()) / 2


def _middle(positions: Floats, seen: Bools, side: str) -> Floats:
    own = np.array([j.startswith(side) for j in BODY.joints]) & seen
    return positions[own].mean(axis=0) if own.any() else np.zeros(3)


def _frame(*, axes: Any, view: _View, scene: Scene, ms: int, half: float) -> None:
    """Limits of the picture, and the lines of the room behind it."""
    centre = view.centre(scene, ms)
    frame(axes, (centre - half, centre + half), (view.low, view.high))
    for low, high, line in (
        (centre - half, centre + half, axes.axvline),
        (view.low, view.high, axes.axhline),
    ):
        for k in range(int(np.ceil(low / _GRID_M)), int(np.floor(high / _GRID_M)) + 1):
            line(k * _GRID_M, color=_GRID, linewidth=0.9, zorder=0)


def _where(axes: Any, scene: Scene) -> None:
    """Which recording, when, and a scale bar."""
    corner_text(axes, f"{scene.recording}, {scene.time_s:.1f} s", fontsize=10)
    scale_bar(axes, (axes.get_xlim()[0] + 0.05, axes.get_ylim()[0] + 0.04), _GRID_M, 10)


def _cell(*, axes: Any, view: _View, scene: Scene, predicted: Floats, ms: int) -> None:
    """One picture: the body now and its past, or a moment of the future."""
    true, known = scene.true(ms)
    if ms == 0:
        for ago, shade in zip(_AGO_MS, (0.12, 0.2, 0.3), strict=True):
            _body(axes, view, *scene.true(-ago), color=_TRUE, linewidth=2.5, alpha=shade)
    _body(axes, view, true, known, color=_TRUE, linewidth=5.0)
    step = round(ms * RATE_HZ / 1000)
    if step > len(predicted):
        corner_text(axes, "beyond its horizon")
    if not 0 < step <= len(predicted):
        return
    _body(axes, view, predicted[step - 1], known, color=_PREDICTED, linewidth=2.0)
    error = _error_mm(predicted[step - 1], true, known)
    still = _error_mm(scene.true(0)[0], true, known & scene.true(0)[1])
    corner_text(axes, f"{error:.0f} mm", color=_PREDICTED, fontsize=13)
    corner_text(axes, f"still: {still:.0f}", right=True, color="#555555", fontsize=11)


def _error_mm(positions: Floats, true: Floats, known: Bools) -> float:
    """Mean distance over the scored joints that are known; NaN if none is."""
    scored = _SCORED[known[_SCORED]]
    distance = np.linalg.norm(positions[scored] - true[scored], axis=-1)
    return 1000 * float(distance.mean()) if scored.size else float("nan")


def _body(
    axes: Any, view: _View, positions: Floats, seen: Bools, *, linewidth: float, **style: Any
) -> None:
    """A stick figure; the right side of the body is drawn thinner."""
    points = view.project(positions)
    for joint, other, bridged in bones(seen):
        right = BODY.joints[joint].startswith("r_")
        width = linewidth * (0.6 if right else 1.0) * (0.5 if bridged else 1.0)
        line = ":" if bridged else "-"
        ends = points[[joint, other]].T
        axes.plot(*ends, line, linewidth=width, solid_capstyle="round", **style)


def bones(seen: Bools) -> list[tuple[int, int, bool]]:
    """Pairs of seen joints to connect by a line, and whether joints between them are unseen.

    Trackers lack some of the 28 joints: without these lines a person would be drawn as loose limbs.

    Args:
        seen: (28,).
    """
    found, tops = [], []
    for joint in np.flatnonzero(seen).tolist():
        above = BODY.parents[joint]
        while above >= 0 and not seen[above]:
            above = BODY.parents[above]
        if above >= 0:
            found.append((joint, above, above != BODY.parents[joint]))
        else:
            tops.append(joint)
    hub = _TRUNK if _TRUNK in tops else tops[0] if tops else -1
    return found + [(joint, hub, True) for joint in tops if joint != hub]
