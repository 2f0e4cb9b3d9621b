"""The report of a shift as one HTML page without scripts or external resources."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from hri_predict.base.charts import Plot, level_bars
from hri_predict.base.looks import LEVEL_COLOURS, PALETTE
from hri_predict.base.pages import render
from hri_predict.base.skeleton import in_words
from hri_predict.explaining.episodes import LEVEL_NAMES
from hri_predict.explaining.values import metres
from hri_predict.protocol.messages import LEVELS


def page(shift: Mapping[str, Any], recordings: Sequence[str]) -> str:
    """Return the page.

    Args:
        shift: result of ``tally``.
        recordings: files and folders as named by the user, for the shown commands.
    """
    return render(
        "explaining/shift/page.html",
        title=f"Shift of {shift['cell']}, {shift['from']} to {shift['to']}",
        shift=shift,
        recording=recordings[0] if recordings else "FILE",
        levels=LEVEL_NAMES,
        colours=LEVEL_COLOURS,
        level_bars=level_bars,
        hours=lambda robot: [(hour["from"][:8], hour["seconds_at"]) for hour in robot["hours"]],
        standing=lambda at: sum(at[level.name] for level in LEVELS if not level.may_move),
        separations=_separations,
        in_words=in_words,
        quote=shlex.quote,
        time=_time,
        percent=lambda share: "-" if share is None else f"{100 * share:.1f} %",
        metres=metres,
        mm=_milli("mm"),
        ms=_milli("ms"),
    )


def _separations(rows: Sequence[tuple[float, float]]) -> Markup:
    """Columns of (lower edge in metres, seconds); the last column holds all larger values."""
    step = rows[1][0] - rows[0][0] if len(rows) > 1 else 1.0
    plot = Plot(
        x_label="m; the last column holds all larger distances",
        y_label="seconds",
        xs=[edge + step for edge, _ in rows],
        ys=[seconds for _, seconds in rows if seconds] or [1.0],
        width=640.0,
        height=170.0,
    )
    for edge, seconds in rows:
        title = f"from {edge:.1f} m: {seconds:.1f} s"
        plot.bar(edge, step, seconds, PALETTE[0], title=title)
    return plot.drawn()


def _time(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    minutes, rest = divmod(seconds, 60)
    if seconds < 60:
        return f"{seconds:.1f} s"
    hours, minutes = divmod(int(minutes), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02.0f} s"


def _milli(unit: str) -> Callable[[float | None], str]:
    return lambda value: "-" if value is None else f"{value * 1e3:.0f} {unit}"
