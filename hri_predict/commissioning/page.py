"""The report as HTML: tests done, their results, open points, and the person responsible."""

import json
from collections.abc import Sequence
from datetime import datetime

from hri_predict.base.pages import render
from hri_predict.commissioning.page_plots import echo_plot, grid_plot, stopping_plot
from hri_predict.commissioning.report import Report, Times
from hri_predict.commissioning.stopping import worst


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
