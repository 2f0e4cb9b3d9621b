"""Measure the node. Compare only runs on one quiet machine, one after the other (--baseline)."""

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from hri_predict.base.errors import HriPredictError
from hri_predict.cli.common import JsonOption, one_of, progress, tell, warn, without_effect
from hri_sim.bench import (
    faults,
    fleet,
    forecasts,
    joint_maps,
    links,
    parts,
    plants,
    ports,
    running,
    saved,
    scaling,
    speed,
    table,
    trackers,
)
from hri_sim.bench import plot as plots
from hri_sim.bench.rows import QUICK, Row, Scope, Section

SECTIONS = {
    "parts": Section("Parts of the node, one call", parts.rows),
    "predictors": Section("A forecast, by predictor and engine", forecasts.rows),
    "age": Section("From a capture to the last byte, two people", links.age),
    "jitter": Section(
        "Interval between messages less the period, as another process sees it", running.jitter
    ),
    "load": Section("Processor time of a running node, 25 ticks a second", running.load),
    "scaling": Section("A tick, as the cell grows", scaling.rows),
    "start": Section("Start of a node, and its memory", running.start),
    "speed": Section("Faster than real time", speed.rows),
    "links": Section("From a scene to the last byte, by kind of link", links.rows, detail=True),
    "plants": Section("To the registers of another process", plants.rows, detail=True),
    "ports": Section("Messages of one node at each receiver", ports.rows, detail=True),
    "fleet": Section("From posting to decoding, over zenoh", fleet.rows, detail=True),
    "trackers": Section("Walks up to a robot and away", trackers.rows, detail=True),
    "joint-maps": Section("Zones around a standing body", joint_maps.rows, detail=True),
}
"""All measurements, in order. Each receives a ``Scope`` and yields rows as they are measured.
Variants that a measurement compares must take turns, and part names must not change, so that runs
stay comparable.
"""

app = typer.Typer(invoke_without_command=True, add_completion=False)
for command in (
    forecasts.predictors,
    links.links,
    fleet.fleet,
    plants.plants,
    ports.ports,
    joint_maps.joint_maps,
    trackers.trackers,
    faults.faults,
    faults.memory,
    faults.soak,
):
    app.command()(command)


@app.callback()
def bench(
    *,
    context: typer.Context,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="Finish in one or two minutes instead of a quarter of an hour."
        ),
    ] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            help=f"Measure only this section. Repeatable: {', '.join(SECTIONS)}. Sections listed "
            "after speed are measured only if named."
        ),
    ] = None,
    save: Annotated[
        Path | None, typer.Option(help="Write all figures into this file, as JSON.")
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Plot the figures into this file (.png or .svg).")
    ] = None,
    baseline: Annotated[
        Path | None,
        typer.Option(help="Also print ratios to the figures in this file, which --save wrote."),
    ] = None,
    worse_than: Annotated[
        float | None,
        typer.Option(
            help="With --baseline: ratio from which a figure got worse.", show_default="1.5"
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure the node: its parts, forecasts, age, jitter, load, scaling, start and speed.

    Exit status 1: with --baseline, something got worse by more than --worse-than times; 2: nothing
    could be compared.

    Example: hri-predict bench --quick --save before.json
    """
    if context.invoked_subcommand is not None:
        flags: dict[str, Any] = {
            "--quick": quick or None,
            "--only": only,
            "--save": save,
            "--plot": plot,
        }
        flags |= {"--baseline": baseline, "--worse-than": worse_than, "--json": as_json or None}
        without_effect(flags, f"before {context.invoked_subcommand}")
        return
    factor = _factor(baseline, worse_than)
    for name in only or ():
        one_of("--only", name, tuple(SECTIONS))
    if plot is not None:
        plots.check(plot)
    for flag, path in (("--save", save), ("--plot", plot)):
        if path is not None:
            saved.check(flag, path)
    whole = [name for name, section in SECTIONS.items() if not section.detail]
    chosen = [name for name in SECTIONS if name in (only or whole)]
    before = None
    if baseline is not None:
        before = saved.read(baseline)
        saved.demand_comparable(baseline, before[1], chosen)
    machine = saved.machine()
    if busy := saved.busy(machine["load_average"]):
        warn(busy)
    told = _measured(chosen, QUICK if quick else Scope(), machine, save)
    if plot is not None:
        plots.plot(plot, told, saved.described(machine))
    changes = [] if before is None else saved.compare(before[1], told, factor)
    if as_json:
        print(json.dumps(saved.as_json(machine, told) | saved.changes_json(changes)))
    else:
        console = table.console()
        for name, found in told.items():
            table.show(console, f"{name}: {SECTIONS[name].about}", found)
        if before is not None:
            for line in saved.other_machine(before[0], machine):
                console.print(f"- {line}", markup=False, highlight=False)
            table.show_changes(console, changes, factor)
        console.print(saved.described(machine), markup=False, highlight=False)
    if written := [path for path in (save, plot) if path is not None]:
        tell(written)
    if any(change.verdict == "worse" for change in changes):
        raise typer.Exit(1)
    if before is not None and not any(change.compares for change in changes):
        warn(f"--baseline {baseline}: nothing could be compared; create another with bench --save")
        raise typer.Exit(2)


def _factor(baseline: Path | None, worse_than: float | None) -> float:
    if baseline is None:
        without_effect({"--worse-than": worse_than}, "without --baseline")
    return table.demand("--worse-than", 1.5 if worse_than is None else worse_than, 1.0, 100.0)


def _measured(
    chosen: list[str], scope: Scope, machine: dict[str, Any], save: Path | None
) -> dict[str, list[Row]]:
    """Measure the chosen sections, and save each section as soon as it is finished."""
    told: dict[str, list[Row]] = {}
    with progress() as bar:
        task = bar.add_task("", total=len(chosen))
        for name in chosen:
            told[name] = []
            bar.update(task, description=name)
            try:
                for row in SECTIONS[name].rows(scope):
                    told[name].append(row)
                    bar.update(task, description=f"{name}: {row.part}"[:50])
            except HriPredictError as error:  # the other sections are worth their while
                told[name].append(Row(part="ended early", unit="", note=str(error)))
            bar.advance(task)
            machine["load_average_end"] = round(os.getloadavg()[0], 2)
            if save is not None:
                saved.save(save, saved.as_json(machine, told))
    return told
