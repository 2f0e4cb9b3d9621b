"""What came of a simulation as tables, notes, JSON and files."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.whole_file import write_whole
from hri_sim.simulation.report import (
    Judged,
    Row,
    Table,
    as_json,
    notes,
    predicted,
    recordings_table,
    tables,
)
from hri_sim.simulation.whole_node import TOLERANCE_M, TOLERANCE_S


@dataclass(frozen=True)
class Result:
    """What came of a simulation.

    Attributes:
        results: one for each predictor and variant.
        alone: the same approaches without protection.
        predictions: predictor -> its predictions of a touch.
        checks: how many episodes ran again through the whole node.
        disagreements: one line for each that came out otherwise.
        asked: what decides the numbers, by name.
    """

    results: Sequence[Judged]
    alone: Judged
    predictions: Mapping[str, Sequence[Row]]
    checks: int
    disagreements: Sequence[str]
    asked: Mapping[str, Any]


@dataclass(frozen=True)
class Report:
    """As shown and written."""

    tables: Sequence[Table]
    notes: Sequence[str]
    json: str
    files: Sequence[Path]


def report(result: Result, out: Path | None) -> Report:
    """Tables and notes; with a folder, files and plots in it as well."""
    shown = tables(result.results, result.alone, result.predictions)
    said = notes(result.results)
    agree = result.checks - len(result.disagreements)
    said.append(
        f"Run again through the whole node: {result.checks} episodes, {agree} agree (the same "
        f"contacts, stops to {TOLERANCE_S:g} s, smallest separation to {TOLERANCE_M:g} m)."
    )
    said.append("Asked for: " + "; ".join(f"{k} {v}" for k, v in result.asked.items()) + ".")
    said += [f"Disagrees: {line}" for line in result.disagreements]
    text = json.dumps(_data(result, said), indent=1)
    files = []
    if out is not None:
        from hri_sim.simulation.plot import write_plots  # wants matplotlib

        written = [*shown, recordings_table(result.results)]
        markdown = "\n\n".join(
            ["# Closed loop", *[t.markdown() for t in written], "\n".join(f"- {n}" for n in said)]
        )
        for name, content in (("simulate.md", markdown + "\n"), ("simulate.json", text + "\n")):
            write_whole(out / name, content.encode())
            files.append(out / name)
        files += write_plots(result.results, out)
    return Report(shown, said, text, files)


def _data(result: Result, said: Sequence[str]) -> dict[str, Any]:
    return {
        "asked": dict(result.asked),
        "results": [_judged(r) for r in (*result.results, result.alone)],
        "touch_within_1s": {
            name: as_json(predicted(rows)) for name, rows in result.predictions.items()
        },
        "whole_node": {"episodes": result.checks, "disagreements": list(result.disagreements)},
        "notes": list(said),
    }


def _judged(result: Judged) -> dict[str, Any]:
    return {
        "predictor": result.predictor,
        "mode": result.variant,
        "estimates": as_json(result.estimates),
        "totals": dict(result.totals),
        "by_recording": dict(result.by_recording),
    }
