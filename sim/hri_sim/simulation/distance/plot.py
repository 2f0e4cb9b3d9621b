"""Plots of the working distance: permitted speed over distance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.figures import Figure, write_figure
from hri_predict.base.looks import PALETTE
from hri_predict.run.working_distance.measure import FAST
from hri_predict.run.working_distance.waterfall import TERMS, Waterfall, rest_text
from hri_sim.simulation.distance.work import Case

_STYLES, _MARKERS = ("-", "--", "-.", ":"), ("", "o", "s", "^", "x")
_DPI = 130


Found = Sequence[tuple[Case, dict[str, Any]]]


def write_plots(found: Found, terms: tuple[Case, Waterfall] | None, out: Path) -> list[Path]:
    """Write every plot into an existing folder; return the files."""
    figures = {"speed_over_distance.png": speeds(found)}
    if terms is not None and terms[1].total_m is not None:
        figures["waterfall.png"] = falling(*terms)
    return [write_figure(figure, out / name, dpi=_DPI) for name, figure in figures.items()]


def falling(case: Case, found: Waterfall) -> Figure:
    """Plot the working distance, and the contribution of each term."""
    assert found.total_m is not None
    terms = [term for term in TERMS if found.costs_m[term.key]]
    names = [
        "working distance",
        *(term.text for term in terms),
        f"rest: {rest_text(case.modes[0])}",
    ]
    figure = Figure(figsize=(9, 1 + 0.38 * len(names)), layout="constrained")
    panel = figure.subplots()
    left = found.total_m
    panel.barh(0, 100 * left, color=PALETTE[0], height=0.6)
    panel.text(100 * left, 0, f" {100 * left:.0f}", va="center", fontsize=8)
    for row, term in enumerate(terms, start=1):
        cost = found.costs_m[term.key]
        left -= cost
        panel.barh(row, 100 * cost, left=100 * left, color=PALETTE[1], height=0.6)
        panel.text(100 * (left + cost), row, f" {100 * cost:.0f}", va="center", fontsize=8)
    panel.barh(len(names) - 1, 100 * found.rest_m, color=PALETTE[2], height=0.6)
    panel.text(100 * found.rest_m, len(names) - 1, f" {100 * found.rest_m:.0f}", va="center",
               fontsize=8)  # fmt: skip
    panel.set_yticks(range(len(names)), names, fontsize=8)
    panel.invert_yaxis()
    panel.set_xlim(0, 108 * found.total_m)
    panel.set_xlabel("cm")
    panel.grid(axis="x", alpha=0.3)
    panel.set_axisbelow(True)
    seen = f"{case.activity.text}, {case.sight.name}, {case.modes[0]}"
    figure.suptitle(f"Contributions to the working distance: {seen}", fontsize=10)
    return figure


def speeds(found: Found) -> Figure:
    """Plot one panel per person, one line per predictor, mode and sight: the speed held 90 % of
    the time.
    """
    least_m = min(case.noise_m for case, _ in found)
    shown = [(case, result) for case, result in found if case.noise_m == least_m]
    people = list(dict.fromkeys(case.activity.text for case, _ in shown))
    modes = list(dict.fromkeys(mode for _, result in shown for mode in result))
    several = len({case.predictor for case, _ in shown}) > 1
    figure = Figure(figsize=(10, 1 + 2.8 * len(people)), layout="constrained")
    panels = figure.subplots(len(people), 1, sharex=True, squeeze=False)[:, 0]
    for panel, person in zip(panels, people, strict=True):
        mine = [each for each in shown if each[0].activity.text == person]
        for k, (case, result) in enumerate(mine):
            for mode, values in result.items():
                at_m, _, held = zip(*values["curve"], strict=True)
                label = mode if mode == "foreknown" else f"{mode}, {case.sight.name}"
                label += f", {case.predictor}" if several else ""
                colour = PALETTE[modes.index(mode) % len(PALETTE)]
                again, first = divmod(k, len(_STYLES))
                style = _STYLES[first] + _MARKERS[again % len(_MARKERS)]
                panel.plot(at_m, held, style, color=colour, lw=1.5, ms=4, label=label)
        panel.set_title(person, fontsize=10)
        panel.axhline(FAST * max(h for _, r in mine for v in r.values() for _, _, h in v["curve"]),
                      color="black", lw=0.6)  # fmt: skip
        panel.set_ylabel("speed, m/s")
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    panels[-1].set_xlabel("distance of the person's mean place from the robot's base, m")
    figure.suptitle("Speed permitted for 90 % of the time", fontsize=11)
    return figure
