"""The folder of a validation: the report, and the state from which it can be resumed later."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup
from pydantic import Field, ValidationError

from hri_predict.base.charts import LINE, Drawing, Look, Plot
from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write, read_text
from hri_predict.base.pages import render
from hri_predict.base.settings import Settings
from hri_predict.commissioning.identity import identity_of
from hri_predict.commissioning.report import (
    PAGE,
    Curve,
    GridResult,
    Lines,
    LinkEcho,
    Report,
    Signature,
    Step,
    Steps,
    Stop,
    Stopping,
    Times,
    write_report,
)
from hri_predict.commissioning.walk import less_safe_walk
from hri_predict.run.config import Config
from hri_predict.run.review.less_safe import less_safe_settings

STATE = "state.json"


class State(Settings):
    """Steps done so far."""

    cell: str = Field(description="name of the configuration's file")
    steps: Steps = Steps()
    notes: Lines = []
    signatures: list[Signature] = []

    def with_step(self, name: str, step: Any) -> "State":
        """Return the state after a step was done, for the first time or again.

        A step that failed in this cell stays failed if it is skipped: the note is kept with it.
        """
        before: Step[Any] | None = getattr(self.steps, name)
        if (
            before is not None
            and (before.outcome, step.outcome) == ("failed", "skipped")
            and before.identity == step.identity
        ):
            step = before.model_copy(update={"note": step.note})
        return self.model_copy(update={"steps": self.steps.model_copy(update={name: step})})


def load_state(folder: Path, config: Config) -> State:
    """Return the state of a folder, or a new state if it has none.

    Raises:
        ConfigError: the state cannot be read, or belongs to another cell.
    """
    path = folder / STATE
    if not path.exists():
        return State(cell=config.path.name)
    try:
        state = State.model_validate(json.loads(read_text(path, "state")))
    except (ValidationError, ValueError, RecursionError) as error:
        raise ConfigError(
            f"state {path}: cannot be used ({type(error).__name__}); give another --out"
        ) from error
    if state.cell != config.path.name:
        raise ConfigError(
            f"--out {folder}: holds the validation of {state.cell}, not of {config.path.name}; "
            f"give another folder"
        )
    return state


def save(folder: Path, config: Config, state: State) -> tuple[Report, str]:
    """Write the state, and the report as JSON and HTML; return the report and its hash.

    Raises:
        ConfigError: the folder cannot be written.
    """
    walk = state.steps.walk.result if state.steps.walk is not None else None
    report = Report(
        cell=config.path.name,
        config_path=os.path.relpath(config.path.absolute(), folder.absolute()),
        made=datetime.now(UTC).replace(microsecond=0),
        identity=identity_of(config),
        steps=state.steps,
        less_safe=[
            *(str(each) for each in less_safe_settings(config)),
            *(less_safe_walk(walk) if walk is not None else ()),
        ],
        notes=state.notes,
        signatures=state.signatures,
    )
    with OsErrorAs(ConfigError, f"--out {folder}: cannot be written", "name another folder"):
        atomic_write(folder / STATE, (state.model_dump_json(indent=1) + "\n").encode())
        digest = write_report(report, folder)
        atomic_write(folder / PAGE, page_of(report, digest).encode("utf-8", "replace"))
    return report, digest


def page_of(report: Report, digest: str) -> str:
    """Return the whole page; it loads no other files and runs no script."""
    return render(
        "commissioning/page.html",
        title=f"Commissioning of {report.cell}",
        report=report,
        digest=digest,
        worst=worst,
        echo_plot=echo_plot,
        grid_plot=grid_plot,
        stopping_plot=stopping_plot,
        date=_date,
        xyz=_xyz,
        milli=_milli,
        of=_of,
        times=_times,
        plain=lambda value: json.dumps(value, ensure_ascii=False),
    )


def worst(stopping: Stopping) -> Mapping[tuple[str, float], Stop]:
    """Return by robot and given speed the stop that used most of its allowed time or distance."""
    found: dict[tuple[str, float], Stop] = {}
    for stop in stopping.stops:
        key = stop.robot, stop.stated_m_s
        if key not in found or _share(stop) > _share(found[key]):
            found[key] = stop
    return found


def _share(stop: Stop) -> float:
    took = stop.total_s if stop.total_s is not None else stop.braking_s
    went = stop.total_m if stop.total_m is not None else stop.braking_m
    return max(took / max(stop.allowed_s, 1e-6), went / max(stop.allowed_m, 1e-6))


def _date(at: datetime) -> str:
    return f"{at:%Y-%m-%d %H:%M} UTC"


def _xyz(point: Sequence[float]) -> str:
    return ", ".join(f"{v:.3f}" for v in point)


def _milli(value: float) -> str:
    return f"{1e3 * value:.0f}"


def _of(value: float | None, allowed: float) -> str:
    return "-" if value is None else f"{_milli(value)} / {_milli(allowed)}"


def _times(times: Times | None) -> str:
    if times is None:
        return "-"
    return f"{times.p50_ms:.1f} / {times.p99_ms:.1f} / {times.max_ms:.1f}"


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
