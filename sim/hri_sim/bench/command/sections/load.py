"""Section ``load``: how busy a running node keeps the cores, by group of threads."""

from collections.abc import Iterator

from hri_sim.bench.command.report.rows import Row, Scope
from hri_sim.bench.command.sections import runs

_WHY = (
    "%: of one core; the cores' own figures hold the receiver, the bare loop and all else that ran"
)


def rows(scope: Scope) -> Iterator[Row]:
    """Processor time over wall time, with a baseline and with a network."""
    for predictor in (scope.baseline, scope.network):
        run = runs.heard(runs.wires()[0], predictor, runs.seconds_of(scope.seconds))
        if isinstance(run, str):
            yield Row(part=predictor, unit="%", note=run)
            continue
        for group, percent in run["cpu_percent"].items():
            name = "whole node" if group == "all" else group
            yield Row(part=f"{predictor}: {name}", unit="%", p50=percent, why=_WHY)
        for core, percent in enumerate(run["cores_percent"]):
            yield Row(part=f"{predictor}: core {core}, whole machine", unit="%", p50=percent)
