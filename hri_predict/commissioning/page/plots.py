"""Plots of the report as SVG: the walk's grid, stops against the table, the echo's histogram."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hri_predict.base.markup import Markup, join, tag
from hri_predict.commissioning.report import Curve, GridResult, LinkEcho, Stop

_WIDTH, _HEIGHT = 330.0, 205.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 46.0, 10.0, 12.0, 36.0
_GRID_WIDTH = 460.0
INK, LINE, PASSED, FAILED, SEEN = "#222", "#bbb", "#1b7837", "#b2182b", "#2166ac"


@dataclass(frozen=True, slots=True)
class _Axes:
    """Scales from values to the plot; both axes begin at 0."""

    x_max: float
    y_max: float

    def x(self, value: float) -> float:
        """Place of a value across."""
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * value / self.x_max

    def y(self, value: float) -> float:
        """Place of a value from the top."""
        return _HEIGHT - _BOTTOM - (_HEIGHT - _TOP - _BOTTOM) * value / self.y_max


def stopping_plot(curve: Curve, stops: Sequence[Stop], distance: bool) -> Markup:
    """Braking time (ms) or distance (mm) over speed: the table as a line, stops as points."""
    table = curve.distance_m if distance else curve.time_s
    braking = [(s.speed_m_s, s.braking_m if distance else s.braking_s, s) for s in stops]
    axes = _axes(
        [*curve.speed_m_s, *(speed for speed, _, _ in braking)],
        [1e3 * v for v in (*table, *(value for _, value, _ in braking))],
    )
    line = _path(axes, [0.0, *curve.speed_m_s], [0.0, *(1e3 * v for v in table)])
    points = [
        tag(
            "circle",
            cx=_n(axes.x(speed)),
            cy=_n(axes.y(1e3 * value)),
            r=3.2,
            fill=PASSED if stop.passed else FAILED,
            fill_opacity=0.75,
        )
        for speed, value, stop in braking
    ]
    unit = "braking distance, mm" if distance else "braking time, ms"
    return _framed(axes, "speed of the fastest point, m/s", unit, line, *points)


def echo_plot(link: LinkEcho) -> Markup:
    """Draw the distribution of round trips (or, if not measured, of the time in the node)."""
    times = link.round_trip if link.round_trip and link.round_trip.bins else link.in_node
    bins = times.bins if times is not None else []
    what = "round trip" if link.round_trip and link.round_trip.bins else "time in the node"
    axes = _axes([float(len(bins))], [float(max(bins, default=1))])
    bars = [
        tag(
            "rect",
            x=_n(axes.x(k)),
            y=_n(axes.y(count)),
            width=_n(max(0.6, axes.x(1) - axes.x(0) - 0.4)),
            height=_n(axes.y(0) - axes.y(count)),
            fill=SEEN,
        )
        for k, count in enumerate(bins)
        if count
    ]
    return _framed(axes, f"{what}, ms", "number", *bars)


def grid_plot(grid: GridResult) -> Markup:
    """The floor from above: x to the right, y up, one square for each cell."""
    side = min(_GRID_WIDTH / grid.columns, 620.0 / grid.rows)
    width, height = side * grid.columns, side * grid.rows

    def square(cell: int, **look: str | float) -> Markup:
        row, column = divmod(cell, grid.columns)
        return tag(
            "rect",
            x=_n(column * side),
            y=_n(height - (row + 1) * side),
            width=_n(side),
            height=_n(side),
            **look,
        )

    most = max(grid.seen.values(), default=1)
    area = set(grid.area)
    parts = [square(cell, fill="#fff", stroke=LINE, stroke_width=0.4) for cell in grid.area]
    parts += [square(c, fill="#ddd", stroke=LINE, stroke_width=0.4) for c in grid.outside]
    parts += [
        square(cell, fill=SEEN, fill_opacity=_n(_shade(count, most)))
        for cell, count in grid.seen.items()
        if cell in area
    ]
    parts += [
        square(cell, fill="none", stroke=SEEN, stroke_width=0.5, stroke_dasharray="1 1")
        for cell in grid.seen
        if cell not in area and 0 <= cell < grid.columns * grid.rows
    ]
    parts += [_cross(grid, cell, side, height) for cell in grid.lost]
    parts += _scale(grid, side, width, height)
    return tag(
        "svg",
        *parts,
        viewBox=f"-30 -4 {_n(width + 34)} {_n(height + 34)}",
        width=_n(width + 34),
        role="img",
        aria_label="walk test: where people were seen",
    )


def _shade(count: int, most: int) -> float:
    """Opacity: a cell in which one person was once is visible next to one where many stood."""
    return 0.25 + 0.75 * math.log1p(count) / math.log1p(most)


def _cross(grid: GridResult, cell: int, side: float, height: float) -> Markup:
    row, column = divmod(cell, grid.columns)
    x, y = column * side, height - (row + 1) * side
    lines = ((x, y, x + side, y + side), (x, y + side, x + side, y))
    return join(
        tag("line", x1=_n(a), y1=_n(b), x2=_n(c), y2=_n(d), stroke=FAILED, stroke_width=2)
        for a, b, c, d in lines
    )


def _scale(grid: GridResult, side: float, width: float, height: float) -> list[Markup]:
    """Metres along both sides, and the room's origin."""
    x0, y0 = grid.origin
    per_m = side / grid.cell_m
    parts = []
    for metre in range(math.ceil(x0), math.floor(x0 + grid.columns * grid.cell_m) + 1):
        at = (metre - x0) * per_m
        parts.append(_text(at, height + 14, f"{metre}", "middle"))
        parts.append(_tick(at, height, at, height + 3))
    for metre in range(math.ceil(y0), math.floor(y0 + grid.rows * grid.cell_m) + 1):
        at = height - (metre - y0) * per_m
        parts.append(_text(-6, at + 3, f"{metre}", "end"))
        parts.append(_tick(-3, at, 0, at))
    parts.append(_text(width / 2, height + 27, "x, m (y upwards)", "middle"))
    return parts


def _axes(xs: Sequence[float], ys: Sequence[float]) -> _Axes:
    return _Axes(max(1e-6, *xs) * 1.05, max(1e-6, *ys) * 1.08)


def _framed(axes: _Axes, x_label: str, y_label: str, *content: Markup) -> Markup:
    """A plot with its axes, ticks and labels."""
    bottom, right = _HEIGHT - _BOTTOM, _WIDTH - _RIGHT
    ticks = [
        *_ticks(axes.x_max, lambda v: (_tick(axes.x(v), bottom, axes.x(v), bottom + 3),
                                       _text(axes.x(v), bottom + 14, f"{v:g}", "middle"))),
        *_ticks(axes.y_max, lambda v: (_tick(_LEFT - 3, axes.y(v), right, axes.y(v), stroke=LINE),
                                       _text(_LEFT - 6, axes.y(v) + 3, f"{v:g}", "end"))),
    ]  # fmt: skip
    frame = [
        _tick(_LEFT, bottom, right, bottom),
        _tick(_LEFT, _TOP, _LEFT, bottom),
        _text((_LEFT + right) / 2, _HEIGHT - 6, x_label, "middle"),
        tag(
            "text",
            y_label,
            x=0,
            y=0,
            transform=f"translate(10 {_n((_TOP + bottom) / 2)}) rotate(-90)",
            text_anchor="middle",
            font_size=9,
            fill=INK,
        ),
    ]
    return tag(
        "svg",
        *ticks,
        *content,
        *frame,
        viewBox=f"0 0 {_n(_WIDTH)} {_n(_HEIGHT)}",
        width=_n(_WIDTH),
        role="img",
        aria_label=f"{y_label} over {x_label}",
    )


def _ticks(most: float, make: Callable[[float], tuple[Markup, Markup]]) -> list[Markup]:
    """Marks at round numbers, four to eight of them."""
    step = 10.0 ** math.floor(math.log10(most))
    step = next(s for s in (step, step / 2, step / 5, step / 10) if most / s >= 4)
    return [part for k in range(int(most / step) + 1) for part in make(round(k * step, 9))]


def _path(axes: _Axes, xs: Sequence[float], ys: Sequence[float]) -> Markup:
    places = " ".join(f"{_n(axes.x(x))},{_n(axes.y(y))}" for x, y in zip(xs, ys, strict=True))
    return tag("polyline", points=places, fill="none", stroke=INK, stroke_width=1.4)


def _tick(x1: float, y1: float, x2: float, y2: float, *, stroke: str = INK) -> Markup:
    return tag("line", x1=_n(x1), y1=_n(y1), x2=_n(x2), y2=_n(y2), stroke=stroke, stroke_width=0.6)


def _text(x: float, y: float, content: str, anchor: str) -> Markup:
    return tag("text", content, x=_n(x), y=_n(y), text_anchor=anchor, font_size=9, fill=INK)


def _n(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")
