"""Plots of a measured distance: permitted speed over distance."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.lab.evaluation.figures import COLOURS, Figure, write_png
from hri_predict.run.working_distance.measure import FAST
from hri_sim.simulation.distance.work import Case

_STYLES = ("-", "--", "-.", ":")
_DPI = 130


def write_plots(found: Sequence[tuple[Case, dict[str, Any]]], out: Path) -> list[Path]:
    """Write the plot into an existing folder; return the file."""
    return [write_png(speeds(found), out / "speed_over_distance.png", _DPI)]


def speeds(found: Sequence[tuple[Case, dict[str, Any]]]) -> Figure:
    """One panel for each person, one line for each mode and sight: the speed held 90 % of time."""
    least_m = min(case.noise_m for case, _ in found)
    shown = [(case, result) for case, result in found if case.noise_m == least_m]
    people = list(dict.fromkeys(case.activity.text for case, _ in shown))
    modes = list(dict.fromkeys(mode for _, result in shown for mode in result))
    figure = Figure(figsize=(9, 1 + 2.8 * len(people)), layout="constrained")
    panels = figure.subplots(len(people), 1, sharex=True, squeeze=False)[:, 0]
    for panel, person in zip(panels, people, strict=True):
        mine = [each for each in shown if each[0].activity.text == person]
        for k, (case, result) in enumerate(mine):
            for mode, values in result.items():
                at_m, _, held = zip(*values["curve"], strict=True)
                label = mode if mode == "foreknown" else f"{mode}, {case.sight.name}"
                colour = COLOURS[modes.index(mode) % len(COLOURS)]
                style = _STYLES[k % len(_STYLES)]
                panel.plot(at_m, held, style, color=colour, lw=1.5, label=label)
        panel.set_title(person, fontsize=10)
        panel.axhline(FAST * max(h for _, r in mine for v in r.values() for _, _, h in v["curve"]),
                      color="black", lw=0.6)  # fmt: skip
        panel.set_ylabel("speed, m/s")
        panel.set_ylim(bottom=0)
        panel.grid(alpha=0.3)
        panel.legend(fontsize=7, ncols=2)
    panels[-1].set_xlabel("distance of the person's mean place from the robot's base, m")
    figure.suptitle("Speed that is permitted for 90 % of the time", fontsize=11)
    return figure
