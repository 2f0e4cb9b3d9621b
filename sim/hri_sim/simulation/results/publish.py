"""Publishes the results of a simulation as tables, notes, JSON and files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.files import atomic_write
from hri_predict.base.looks import can_plot
from hri_predict.cli.common import writing
from hri_predict.run.zone_basis import ZoneBasis
from hri_sim.simulation.request import SimulationReport
from hri_sim.simulation.results.report import (
    Judged,
    Row,
    notes,
    predicted,
    recordings_table,
    tables,
)
from hri_sim.simulation.results.statistics import Estimate
from hri_sim.simulation.whole_node import TOLERANCE_M, TOLERANCE_S

NAMED = 3
"""Maximum number of recordings named in the notes; beyond it, only their number is given."""


@dataclass(frozen=True, kw_only=True)
class Result:
    """The results of a simulation.

    Attributes:
        results: one for each predictor and variant.
        alone: the same approaches without protection.
        predictions: predictor -> its predictions of a touch.
        checks: number of episodes repeated through the whole node.
        disagreements: one line for each of them whose result differs.
        asked: everything that determines the results, by name.
        left_out: one line for each recording that could not be played.
        bases: basis of each predictor's zones.
    """

    results: Sequence[Judged]
    alone: Judged
    predictions: Mapping[str, Sequence[Row]]
    checks: int
    disagreements: Sequence[str]
    asked: Mapping[str, Any]
    left_out: Sequence[str] = ()
    bases: Sequence[ZoneBasis] = ()


def report(result: Result, out: Path | None) -> SimulationReport:
    """Return tables and notes; with a folder, also write files and, with matplotlib, plots.

    Raises:
        ConfigError: the folder cannot be written.
    """
    shown = tables(result.results, result.alone, result.predictions)
    said = [*(basis.line for basis in result.bases), *notes(result.results)]
    agree = result.checks - len(result.disagreements)
    said.append(
        f"Repeated through the whole node: {result.checks} episodes, {agree} agree (same contacts, "
        f"stops within {TOLERANCE_S:g} s, smallest separation within {TOLERANCE_M:g} m)."
    )
    said.append(asked_for(result.asked))
    if result.left_out:
        said.append(f"Recordings left out: {len(result.left_out)}.")
        said += [f"Left out: {line}." for line in result.left_out]
    said += [f"Disagrees: {line}" for line in result.disagreements]
    text = json.dumps(_data(result, said), indent=1)
    files = []
    if out is not None:
        written = [*shown, recordings_table(result.results)]
        notes_text = "\n".join(f"- {n}" for n in said)
        markdown = "\n".join(["# Closed loop\n", *(t.markdown() for t in written), notes_text])
        with writing(f"--out {out}", "free some space, then give --resume"):
            for name, content in (("simulate.md", markdown), ("simulate.json", text)):
                atomic_write(out / name, (content + "\n").encode())
                files.append(out / name)
            if can_plot():
                from hri_sim.simulation.results.plot import write_plots

                files += write_plots(result.results, out)
    return SimulationReport(
        tables=shown, notes=said, json=text, files=files, disagreements=result.disagreements
    )


def asked_for(asked: Mapping[str, Any]) -> str:
    """Return one sentence on the settings of the results; many recordings are only counted."""
    names, folders = asked["recordings"], asked["folders"]
    recordings = f"recordings {', '.join(names)}"
    if len(names) > NAMED:
        where = f" from {' and '.join(folders)}" if folders else f" ({names[0]} and so on)"
        recordings = f"{len(names)} recordings{where}; simulate.json and --json name them"
    rest = (f"{k} {v}" for k, v in asked.items() if k not in ("recordings", "folders"))
    return f"Settings: {'; '.join(rest)}; {recordings}."


def _data(result: Result, said: Sequence[str]) -> dict[str, Any]:
    return {
        "asked": dict(result.asked),
        "zones": [basis.as_json() for basis in result.bases],
        "results": [_judged(r) for r in (*result.results, result.alone)],
        "touch_within_1s": {
            name: plain(predicted(rows)) for name, rows in result.predictions.items()
        },
        "whole_node": {"episodes": result.checks, "disagreements": list(result.disagreements)},
        "left_out": list(result.left_out),
        "notes": list(said),
    }


def plain(estimates: Mapping[str, Estimate]) -> dict[str, Any]:
    """Return values and intervals as plain, unscaled data."""
    return {key: asdict(estimate) for key, estimate in estimates.items()}


def _judged(result: Judged) -> dict[str, Any]:
    return {
        "predictor": result.predictor,
        "mode": result.variant,
        "estimates": plain(result.estimates),
        "totals": dict(result.totals),
        "by_recording": dict(result.by_recording),
    }
