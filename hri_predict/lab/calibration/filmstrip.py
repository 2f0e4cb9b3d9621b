"""Zones around recorded people beside a robot, drawn to scale from the right and from above."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.figures import (
    README_INCHES,
    Figure,
    corner_text,
    frame,
    scale_bar,
    scene_grid,
)
from hri_predict.base.geometry import Capsules
from hri_predict.base.looks import PALETTE
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.scene import (
    BALL_M_S,
    SHOWN_MS,
    Projection,
    ZoneScene,
    outside,
    robot_beside,
    views,
)

_ZONE, _ZONE_FILL, _TRUE, _PREDICTED = PALETTE[0], "#CDE2F0", "#8A8A8A", PALETTE[1]
_ROBOT, _TABLE = PALETTE[2], "#E9E4DC"
_GRID_M = 0.02
_WIDE_M, _TALL_M, _DEEP_M = (-1.3, 2.4), (-0.12, 2.6), (-1.1, 1.95)
"""Extent of the pictures, metres: ahead of the person, above the floor, and to the left."""


def zone_filmstrip(
    scenes: Sequence[ZoneScene], skeleton: Skeleton, predictor: str, what: str
) -> Figure:
    """Draw scenes, two rows each (from the side, from above), a column per moment.

    Args:
        scenes: see ``scene.zone_scene``; at least one.
        skeleton: skeleton of the scenes.
        predictor: name of the predictor, for the title.
        what: kind of zones, for the title ("99 % of the whole body, estimated").
    """
    heights = [np.ptp(_TALL_M), np.ptp(_DEEP_M)] * len(scenes)
    cell = (README_INCHES - 0.4) / len(SHOWN_MS)
    tall = sum(heights) * cell / float(np.ptp(_WIDE_M)) + 1.35
    figure, grid = scene_grid(
        size=(README_INCHES, tall), heights=heights, columns=len(SHOWN_MS), pad=(0.015, 0.025)
    )
    for index, scene in enumerate(scenes):
        rows = grid[2 * index : 2 * index + 2]
        side, above = views(scene, skeleton)
        robot = robot_beside(scene, side, above)
        for axes, view, name in zip(
            rows, (side, above), ("from the right", "from above"), strict=True
        ):
            axes[0].set_ylabel(name, fontsize=9.5)
            for column, ms in enumerate(SHOWN_MS):
                frame(axes[column], _WIDE_M, _TALL_M if view is side else _DEEP_M)
                if ms not in scene.shown_ms:
                    axes[column].text(0.0, 0.3, "beyond its horizon", fontsize=8.5)
                    continue
                _cell(
                    axes=axes[column],
                    view=view,
                    scene=scene,
                    robot=robot,
                    skeleton=skeleton,
                    at=scene.shown_ms.index(ms),
                )
        _where(rows[0][0], scene)
    for axes, ms in zip(grid[0], SHOWN_MS, strict=True):
        axes.set_title(f"+{ms} ms" if ms else "now", fontsize=10.5)
    _explain(figure, grid[0, 0], predictor, what)
    return figure


def _where(axes: Any, scene: ZoneScene) -> None:
    """Which recording, when, and a scale bar of 1 m."""
    corner_text(axes, f"{scene.recording}, {scene.time_s:.1f} s", fontsize=8.5)
    if scene.widened:
        corner_text(axes, "widened", line=1, fontsize=8.5)
    scale_bar(axes, (_WIDE_M[1] - 1.1, 0.18), 1.0, 8.5)


def _cell(
    *, axes: Any, view: Projection, scene: ZoneScene, robot: Capsules, skeleton: Skeleton, at: int
) -> None:
    """One moment from one side."""
    low, high = axes.get_ylim()
    points = np.stack(
        np.meshgrid(np.arange(*_WIDE_M, _GRID_M), np.arange(low, high, _GRID_M)), axis=-1
    )
    level = view.up[2] > 0
    if level:
        axes.axhline(0.0, color="#BBBBBB", linewidth=0.8, zorder=0)
    body = _body(skeleton, scene.true[at], scene.known[at])
    now = _body(skeleton, scene.true[0], scene.known[0])
    ball = Capsules(now.a, now.b, now.radius + BALL_M_S * scene.shown_ms[at] / 1000)
    arm = robot[at]
    zone = scene.zones[at]
    _table(axes, view, arm, level)
    _shape(axes, points, outside(points, view, arm), _ROBOT, fill=_ROBOT, alpha=0.4, zorder=4)
    _shape(axes, points, outside(points, view, zone), _ZONE, fill=_ZONE_FILL, alpha=0.75, zorder=3)
    if scene.shown_ms[at]:
        field = outside(points, view, ball)
        _shape(axes, points, field, "black", zorder=4.5, line="--", width=0.8)
    _shape(axes, points, outside(points, view, body), None, fill=_TRUE, alpha=0.8, zorder=5)
    _bones(
        axes=axes, view=view, positions=scene.forecast[at], seen=scene.known[0], skeleton=skeleton
    )


def _shape(
    axes: Any,
    points: Floats,
    field: Floats,
    colour: str | None,
    *,
    fill: str | None = None,
    alpha: float = 1.0,
    zorder: float = 1,
    line: str = "-",
    width: float = 1.0,
) -> None:
    """A silhouette: where the field is below 0."""
    if not (field < 0).any():
        return
    x, y = points[..., 0], points[..., 1]
    if fill is not None:
        axes.contourf(x, y, field, [-np.inf, 0.0], colors=[fill], alpha=alpha, zorder=zorder)
    if colour is not None and (field > 0).any():
        axes.contour(
            x, y, field, [0.0], colors=[colour], linewidths=width, linestyles=line, zorder=zorder
        )


def _body(skeleton: Skeleton, positions: Floats, known: Bools) -> Capsules:
    """(S',) capsules of the known segments; a segment with an unknown far end is shortened."""
    own = []
    for segment in skeleton.segments:
        far = segment.joint_b if known[segment.joint_b] else skeleton.parents[segment.joint_b]
        if far >= 0 and known[far] and known[segment.joint_a]:
            own.append((segment.joint_a, far, segment.radius))
    a, b = (np.array([s[end] for s in own], dtype=np.intp) for end in (0, 1))
    return Capsules(positions[a], positions[b], np.array([s[2] for s in own]))


def _table(axes: Any, view: Projection, arm: Capsules, level: bool) -> None:
    """The table that the robot stands on."""
    base = view.project(arm.a[:1])[0]
    bottom = 0.0 if level else base[1] - 0.2
    height = (view.project(arm.a[:1])[0][1] if level else base[1] + 0.2) - bottom
    axes.bar(base[0], height, 0.4, bottom, color=_TABLE, zorder=1)


def _bones(
    *, axes: Any, view: Projection, positions: Floats, seen: Bools, skeleton: Skeleton
) -> None:
    points = view.project(positions)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0 and seen[joint] and seen[parent]:
            axes.plot(*points[[joint, parent]].T, color=_PREDICTED, linewidth=1.3, zorder=6)


def _explain(figure: Figure, axes: Any, predictor: str, what: str) -> None:
    names = ["person, as recorded", f"forecast by {predictor}", "zone", "robot, as planned"]
    names.append(f"body growing at {BALL_M_S:g} m/s")
    handles = [
        axes.fill_between([], [], [], color=_TRUE),
        axes.plot([], [], color=_PREDICTED, linewidth=1.5)[0],
        axes.fill_between([], [], [], facecolor=_ZONE_FILL, edgecolor=_ZONE),
        axes.fill_between([], [], [], facecolor=_ROBOT, edgecolor=_ROBOT, alpha=0.5),
        axes.plot([], [], "--", color="black", linewidth=1.0)[0],
    ]
    figure.legend(
        handles,
        names,
        title=f"Zones of {predictor}: {what}",
        title_fontsize=12,
        loc="outside upper center",
        ncols=len(names),
        columnspacing=1.2,
        fontsize=9,
        frameon=False,
    )
    figure.supxlabel(
        "A zone holds the body during the whole step that ends at its time after the capture; "
        "larger zones are cut off.\nAll to one scale, with a fixed view of the room. Windows: the "
        "middle of each action's longest recording, independent of the errors.\nThe robot was "
        "placed to the person's left (seen from the right: behind). Unmeasured joints (often the "
        "crown) widen a zone.",
        fontsize=8,
    )
