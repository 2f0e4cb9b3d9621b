"""Plots with matplotlib: panels, legends, scenes, files.

Without it, one line gives the remedy. Charts in HTML pages do not need matplotlib: see ``charts``.
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
        "plots need matplotlib; install it with: pip install 'hri-predict[plots]'"
    ) from error

README_INCHES = 9.0
"""Width of a figure for display at about 900 pixels: text of 8 points and more is legible."""
README_DPI = 200
_COLOURS = 128  # of a PNG file: a third of its size, and no reader sees the difference
_FRAME = "#BBBBBB"


def write_figure(
    figure: Figure, path: Path, *, dpi: int = README_DPI, option: str = "--out"
) -> Path:
    """Write a .png or .svg completely or not at all; creates the folder.

    Args:
        option: option that named the file or its folder, for the error.

    Raises:
        ConfigError: it cannot be written; an existing file is unchanged.
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
    """Return a figure with this number of equal panels (size in inches), and space for a legend
    below.
    """
    columns = min(columns, count)
    rows = -(-count // columns)
    inches = size[0] * columns + 0.6, size[1] * rows + 0.8
    figure = Figure(figsize=inches, layout="constrained")
    grid = list(figure.subplots(rows, columns, squeeze=False).flat)
    for axes in grid[count:]:
        axes.set_visible(False)
    return figure, grid[:count]


def legend_below(figure: Figure, *, most_columns: int = 4) -> None:
    """Draw one legend for all panels, with as many columns as fit."""
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
    """Return a figure of closely spaced scenes, and its (rows, columns) of axes."""
    figure = Figure(figsize=size, layout="constrained")
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=pad[0], h_pad=pad[1], wspace=0.0, hspace=0.0)
    return figure, figure.subplots(len(heights), columns, squeeze=False, height_ratios=heights)


def frame(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Set a scene's limits in metres, to scale and without tick labels."""
    axes.set_aspect("equal")
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(_FRAME)


def scale_bar(axes: Axes, at: tuple[float, float], length_m: float, fontsize: float) -> None:
    """Draw a scale bar with its length above."""
    left, low = at
    right = left + length_m
    axes.plot([left, right], [low, low], color="black", linewidth=2.2, solid_capstyle="butt")
    label = f"{length_m:g} m"
    axes.annotate(
        label, ((left + right) / 2, low), (0, 3), textcoords="offset points", ha="center",
        fontsize=fontsize,
    )  # fmt: skip


def corner_text(axes: Axes, text: str, *, line: int = 0, right: bool = False, **style: Any) -> None:
    """Write lines of text at the upper left or right corner of a scene."""
    x, align = (0.97, "right") if right else (0.03, "left")
    place: dict[str, Any] = {"va": "top", "ha": align, "transform": axes.transAxes}
    axes.text(x, 0.97 - 0.09 * line, text, **place, **style)
