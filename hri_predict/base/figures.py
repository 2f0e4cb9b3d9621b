"""Plots by matplotlib (or one line that says how to get it): panels, legends, scenes, files.

Charts within a page of HTML need no matplotlib: see ``charts``.
"""

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write

try:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from PIL import Image  # matplotlib writes its PNG by Pillow, so it is there
except ImportError as error:  # an extra of its own
    raise ConfigError(
        "plots need matplotlib; install it with pip install 'hri-predict[train]'"
    ) from error

README_INCHES = 9.0
"""Width of a figure that is read at 900 pixels or so: text of 8 points and more is legible."""
README_DPI = 200
_COLOURS = 128  # of a PNG file: a third of its size, and no reader sees the difference
_FRAME = "#BBBBBB"


def write_figure(
    figure: Figure, path: Path, *, dpi: int = README_DPI, option: str = "--out"
) -> Path:
    """Write a .png or .svg whole or not at all; makes the folder.

    Args:
        option: that named the file or its folder, for the error.

    Raises:
        ConfigError: it cannot be written; a file that was there is as it was.
    """
    drawn, kind = io.BytesIO(), path.suffix.lower().removeprefix(".")
    figure.savefig(drawn, dpi=dpi, format=kind, metadata={"Date": None} if kind == "svg" else None)
    if kind == "png":
        image = Image.open(drawn).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
        drawn = io.BytesIO()
        image.save(drawn, "PNG", optimize=True)
    remedy = "name another file or folder"
    with OsErrorAs(ConfigError, f"{option} {path}: cannot be written", remedy):
        path.parent.mkdir(parents=True, exist_ok=True)
        atomic_write(path, drawn.getvalue())
    return path


def panels(count: int, columns: int, size: tuple[float, float]) -> tuple[Figure, list[Axes]]:
    """A figure with this number of panels of equal size (inches), and room for a legend below."""
    columns = min(columns, count)
    rows = -(-count // columns)
    inches = size[0] * columns + 0.6, size[1] * rows + 0.8
    figure = Figure(figsize=inches, layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def legend_below(figure: Figure, *, most_columns: int = 4) -> None:
    """Name the lines of all panels once, in as many columns as the figure is wide."""
    named: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            named.setdefault(label, handle)
    each = 0.6 + 0.075 * max(map(len, named), default=0)  # inches: the line, and 9 points a letter
    columns = max(1, min(most_columns, int(figure.get_figwidth() / each)))
    shown: dict[str, Any] = {"ncols": columns, "fontsize": 9}
    figure.legend(list(named.values()), list(named), loc="outside lower center", **shown)


def scene_grid(
    *, size: tuple[float, float], heights: Sequence[float], columns: int, pad: tuple[float, float]
) -> tuple[Figure, Any]:
    """A figure of scenes side by side, close together, and its (rows, columns) of axes."""
    figure = Figure(figsize=size, layout="constrained")
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=pad[0], h_pad=pad[1], wspace=0.0, hspace=0.0)
    return figure, figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)


def frame(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Set a scene's limits in metres; it is true to scale and has no numbers."""
    axes.set_aspect("equal")
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(_FRAME)


def scale_bar(axes: Axes, at: tuple[float, float], length_m: float, fontsize: float) -> None:
    """A bar of this length, and the length above it."""
    left, low = at
    right = left + length_m
    axes.plot([left, right], [low, low], color="black", linewidth=2.2, solid_capstyle="butt")
    label = f"{length_m:g} m"
    axes.annotate(
        label, ((left + right) / 2, low), (0, 3), textcoords="offset points", ha="center",
        fontsize=fontsize,
    )  # fmt: skip


def corner_text(axes: Axes, text: str, *, line: int = 0, right: bool = False, **style: Any) -> None:
    """Write at the upper left corner of a scene, or the right one; lines below each other."""
    x, align = (0.97, "right") if right else (0.03, "left")
    place: dict[str, Any] = {"va": "top", "ha": align, "transform": axes.transAxes}
    axes.text(x, 0.97 - 0.09 * line, text, **place, **style)
