"""Charts as SVG within a page: shapes in pixels, y downwards, and plots with axes from 0."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from markupsafe import Markup

from hri_predict.base.looks import LEVEL_COLOURS
from hri_predict.base.pages import render

INK, LINE = "#222", "#bbb"
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 12.0, 36.0
_BAR, _GAP, _NAMES = 18.0, 4.0, 64.0

Look = Mapping[str, str | float]
_STROKE: Look = {"stroke": INK, "stroke_width": 0.6}


def _n(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:.2f}".rstrip("0").rstrip(".")


@dataclass(frozen=True, slots=True)
class _Shape:
    kind: str
    look: Mapping[str, str]
    title: str
    words: str


class Drawing:
    """Shapes, in drawing order. ``stroke_width`` becomes ``stroke-width``."""

    def __init__(self) -> None:
        self._shapes: list[_Shape] = []

    def add(self, kind: str, look: Look, *, title: str = "", words: str = "") -> None:
        """Draw an SVG shape; ``title`` is its tooltip."""
        named = {key.replace("_", "-"): _n(value) for key, value in look.items()}
        self._shapes.append(_Shape(kind, named, title, words))

    def rect(
        self,
        x: float,
        y: float,
        width: float,
        height: float,
        *,
        title: str = "",
        **look: str | float,
    ) -> None:
        """Draw a rectangle, given its upper left corner."""
        self.add("rect", {"x": x, "y": y, "width": width, "height": height, **look}, title=title)

    def line(self, x1: float, y1: float, x2: float, y2: float, **look: str | float) -> None:
        """Draw a line, thin unless ``look`` sets another width."""
        self.add("line", {"x1": x1, "y1": y1, "x2": x2, "y2": y2, **_STROKE, **look})

    def text(
        self, x: float, y: float, words: str, anchor: str = "middle", **look: str | float
    ) -> None:
        """Write text at a position."""
        shown: Look = {"x": x, "y": y, "text_anchor": anchor, "font_size": 9, "fill": INK}
        self.add("text", {**shown, **look}, words=words)

    def svg(self, *, left: float, top: float, width: float, height: float, label: str) -> Markup:
        """Return the drawing with its visible area and a text alternative."""
        frame = {
            "viewBox": " ".join(map(_n, (left, top, width, height))),
            "width": _n(width),
            "aria-label": label,
        }
        return render("base/charts.html", frame=frame, shapes=self._shapes)


class Plot(Drawing):
    """A plot; both axes start at 0 and extend beyond the largest values.

    Args:
        x_label, y_label: labels of the axes.
        xs, ys: values that must fit.
        width, height: in pixels.
    """

    def __init__(
        self,
        *,
        x_label: str,
        y_label: str,
        xs: Sequence[float],
        ys: Sequence[float],
        width: float = 330.0,
        height: float = 205.0,
    ) -> None:
        super().__init__()
        self._width, self._height = width, height
        self._label = f"{y_label} over {x_label}"
        self._x_max, self._y_max = max(1e-6, *xs) * 1.05, max(1e-6, *ys) * 1.08
        self._axes(x_label, y_label)

    def x(self, value: float) -> float:
        """Return the horizontal position of a value."""
        return _LEFT + (self._width - _LEFT - _RIGHT) * value / self._x_max

    def y(self, value: float) -> float:
        """Return the vertical position of a value, from the top."""
        bottom = self._height - _BOTTOM
        return bottom - (bottom - _TOP) * value / self._y_max

    def _axes(self, x_label: str, y_label: str) -> None:
        bottom, right = self.y(0), self._width - _RIGHT
        for value in _round_numbers(self._x_max):
            at = self.x(value)
            self.line(at, bottom, at, bottom + 3)
            self.text(at, bottom + 14, f"{value:g}")
        for value in _round_numbers(self._y_max):
            at = self.y(value)
            self.line(_LEFT - 3, at, right, at, stroke=LINE)
            self.text(_LEFT - 6, at + 3, f"{value:g}", "end")
        self.line(_LEFT, bottom, right, bottom)
        self.line(_LEFT, _TOP, _LEFT, bottom)
        self.text((_LEFT + right) / 2, self._height - 6, x_label)
        upwards = f"translate(10 {_n((_TOP + bottom) / 2)}) rotate(-90)"
        self.text(0, 0, y_label, transform=upwards)

    def curve(self, xs: Sequence[float], ys: Sequence[float]) -> None:
        """Draw a line through points."""
        pairs = zip(xs, ys, strict=True)
        places = " ".join(f"{_n(self.x(x))},{_n(self.y(y))}" for x, y in pairs)
        look: Look = {"points": places, "fill": "none", "stroke": INK, "stroke_width": 1.4}
        self.add("polyline", look)

    def point(self, x: float, y: float, colour: str) -> None:
        """Draw a dot."""
        at: Look = {"cx": self.x(x), "cy": self.y(y), "r": 3.2}
        self.add("circle", {**at, "fill": colour, "fill_opacity": 0.75})

    def bar(self, x: float, width: float, y: float, colour: str, *, title: str = "") -> None:
        """Draw a column that starts at ``x``; nothing for 0."""
        if y > 0:
            left, top = self.x(x), self.y(y)
            wide = max(0.5, self.x(x + width) - left - 0.4)
            self.rect(left, top, wide, self.y(0) - top, title=title, fill=colour)

    def drawn(self) -> Markup:
        """Return the whole plot."""
        return self.svg(left=0, top=0, width=self._width, height=self._height, label=self._label)


def _round_numbers(most: float) -> list[float]:
    """Return four to eight marks for an axis."""
    step = 10.0 ** math.floor(math.log10(most))
    step = next(s for s in (step, step / 2, step / 5, step / 10) if most / s >= 4)
    return [round(k * step, 9) for k in range(int(most / step) + 1)]


def level_bars(rows: Sequence[tuple[str, Mapping[str, float]]], width: float = 640.0) -> Markup:
    """Draw a bar for each row, divided by the seconds at each level; its length is proportional to
    the total.
    """
    drawing = Drawing()
    most = max((sum(seconds.values()) for _, seconds in rows), default=0.0) or 1.0
    for k, (name, seconds) in enumerate(rows):
        top, left = k * (_BAR + _GAP), _NAMES
        drawing.text(_NAMES - 6, top + 13, name, "end", font_size=11)
        for level, colour in LEVEL_COLOURS.items():
            wide = (width - _NAMES) * seconds.get(level, 0.0) / most
            if wide > 0:
                title = f"{name} {level}: {seconds[level]:.1f} s"
                drawing.rect(left, top, wide, _BAR, title=title, fill=colour)
            left += wide
    tall = len(rows) * (_BAR + _GAP)
    return drawing.svg(left=0, top=0, width=width, height=tall, label="time at each level")
