"""Plots of the report: the walk's grid, stops against the table, the echo's histogram."""

import math
from collections.abc import Sequence

from markupsafe import Markup

from hri_predict.base.charts import LINE, Drawing, Look, Plot
from hri_predict.commissioning.report import Curve, GridResult, LinkEcho, Stop

PASSED, FAILED, SEEN = "#1b7837", "#b2182b", "#2166ac"
_GRID_WIDTH, _GRID_HEIGHT = 460.0, 620.0


def stopping_plot(curve: Curve, stops: Sequence[Stop], distance: bool) -> Markup:
    """Draw braking time (ms) or distance (mm) over speed: the table as a line, stops as points."""
    table = [1e3 * value for value in (curve.distance_m if distance else curve.time_s)]
    braking = [1e3 * (stop.braking_m if distance else stop.braking_s) for stop in stops]
    plot = Plot(
        x_label="speed of the fastest point, m/s",
        y_label="braking distance, mm" if distance else "braking time, ms",
        xs=[*curve.speed_m_s, *(stop.speed_m_s for stop in stops)],
        ys=[*table, *braking],
    )
    plot.curve([0.0, *curve.speed_m_s], [0.0, *table])
    for stop, value in zip(stops, braking, strict=True):
        plot.point(stop.speed_m_s, value, PASSED if stop.passed else FAILED)
    return plot.drawn()


def echo_plot(link: LinkEcho) -> Markup:
    """Draw the distribution of round trips or, if not measured, of the time in the node."""
    is_round_trip = link.round_trip is not None and bool(link.round_trip.bins)
    times = link.round_trip if is_round_trip else link.in_node
    bins = times.bins if times is not None else []
    plot = Plot(
        x_label="round trip, ms" if is_round_trip else "time in the node, ms",
        y_label="number",
        xs=[len(bins)],
        ys=bins or [1],
    )
    for k, count in enumerate(bins):
        plot.bar(k, 1, count, SEEN)
    return plot.drawn()


def grid_plot(grid: GridResult) -> Markup:
    """Draw the floor from above: x to the right, y up, one square for each cell."""
    side = min(_GRID_WIDTH / grid.columns, _GRID_HEIGHT / grid.rows)
    width, height = side * grid.columns, side * grid.rows
    drawing = Drawing()

    def corner(cell: int) -> tuple[float, float]:
        row, column = divmod(cell, grid.columns)
        return column * side, height - (row + 1) * side

    def square(cell: int, **look: str | float) -> None:
        x, y = corner(cell)
        at: Look = {"x": x, "y": y, "width": side, "height": side}
        drawing.add("rect", {**at, **look})

    most = max(grid.seen.values(), default=1)
    area = set(grid.area)
    for cell in grid.area:
        square(cell, fill="#fff", stroke=LINE, stroke_width=0.4)
    for cell in grid.outside:
        square(cell, fill="#ddd", stroke=LINE, stroke_width=0.4)
    for cell, count in grid.seen.items():
        if cell in area:
            square(cell, fill=SEEN, fill_opacity=_shade(count, most))
        elif 0 <= cell < grid.columns * grid.rows:
            square(cell, fill="none", stroke=SEEN, stroke_width=0.5, stroke_dasharray="1 1")
    for cell in grid.lost:
        x, y = corner(cell)
        drawing.line(x, y, x + side, y + side, stroke=FAILED, stroke_width=2)
        drawing.line(x, y + side, x + side, y, stroke=FAILED, stroke_width=2)
    _metres(drawing, grid, side)
    label = "walk test: where people were seen"
    return drawing.svg(left=-30, top=-4, width=width + 34, height=height + 34, label=label)


def _shade(count: int, most: int) -> float:
    """Opacity: a cell visited once stays visible next to a cell where many people stood."""
    return 0.25 + 0.75 * math.log1p(count) / math.log1p(most)


def _metres(drawing: Drawing, grid: GridResult, side: float) -> None:
    """Label both axes in metres from the room's origin."""
    width, height = side * grid.columns, side * grid.rows
    x0, y0 = grid.origin
    per_m = side / grid.cell_m
    for metre in range(math.ceil(x0), math.floor(x0 + grid.columns * grid.cell_m) + 1):
        at = (metre - x0) * per_m
        drawing.text(at, height + 14, f"{metre}")
        drawing.line(at, height, at, height + 3)
    for metre in range(math.ceil(y0), math.floor(y0 + grid.rows * grid.cell_m) + 1):
        at = height - (metre - y0) * per_m
        drawing.text(-6, at + 3, f"{metre}", "end")
        drawing.line(-3, at, 0, at)
    drawing.text(width / 2, height + 27, "x, m (y upwards)")
