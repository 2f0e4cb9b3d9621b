"""Tables of a benchmark: measured errors next to those that papers print for its protocol."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write
from hri_predict.base.looks import can_plot
from hri_predict.lab.evaluation.benchmark import Protocol, Score, mean_over, nominal_ms
from hri_predict.lab.evaluation.benchmark_result import MEAN, BenchmarkResult, printed_at
from hri_predict.lab.evaluation.table import Table


def tables(result: BenchmarkResult) -> list[Table]:
    """The mean over the actions, then each action; once for each of ``Protocol.readings``."""
    found = []
    for frames in result.protocol.readings:
        columns = ("method", *(f"{ms} ms" for ms in _headings(result.protocol, frames)))
        for action in (MEAN, *result.actions):
            rows = [
                (name, *(_cell(v, result.protocol) for v in values))
                for name, values in _rows(result, action, frames)
            ]
            found.append(Table(_title(result, action, frames), columns, tuple(rows)))
    return found


def _headings(protocol: Protocol, frames: Sequence[int]) -> list[int]:
    """Nominal milliseconds as papers print them; KD-Former's belong to one frame later."""
    early = protocol.error == "euler" and frames[0] == 0
    return [nominal_ms(f + 1 if early else f) for f in frames]


def _title(result: BenchmarkResult, action: str, frames: Sequence[int]) -> str:
    what = action
    if action == MEAN:
        what = "mean over " + ", ".join(result.averaged)
    else:
        what += f" ({next(iter(result.scores.values()))[action].windows} windows)"
        if action in result.protocol.of.zero_shot:
            what += ": no train recording, zero-shot; the printed methods trained on it"
    read = ""
    if len(result.protocol.readings) > 1:
        read = f", read at future frames {', '.join(map(str, frames))}"
    return f"{what}{read}, {result.protocol.unit}"


def _rows(
    result: BenchmarkResult, action: str, frames: Sequence[int]
) -> list[tuple[str, list[float | None]]]:
    """Name and errors of every method; printed methods only if they have any of these frames."""
    rows: list[tuple[str, list[float | None]]] = []
    for name, scores in result.scores.items():
        errors = mean_over(result.protocol, scores) if action == MEAN else scores[action].errors
        rows.append((name, [_number(errors[f]) for f in frames]))
    for entry in result.printed:
        printed = [printed_at(entry, action, f, result.averaged) for f in frames]
        if any(value is not None for value in printed):
            rows.append((f"{entry.method}, printed", printed))
    return rows


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None


def _cell(value: float | None, protocol: Protocol) -> str:
    if value is None:
        return "–"
    return f"{value:.2f}"


def notes(result: BenchmarkResult) -> list[str]:
    """Return notes for a reader of the tables, one sentence each."""
    protocol = result.protocol
    found = [
        f"{protocol.n_in} frames observed, {protocol.n_out} predicted; windows: {protocol.windows}."
    ]
    found += protocol.of.notes.get(protocol.error, ())
    if protocol.windows == "all":
        found.append("10 and 25 predicted frames are scored on different sets of windows.")
    for entry in result.printed:
        note = f" ({entry.note})" if entry.note else ""
        found.append(f"{entry.method}: {entry.paper}, {entry.table}{note}.")
    return found


def as_markdown(result: BenchmarkResult, command: str) -> str:
    """All tables, their explanation, and the command that creates them."""
    name = result.protocol.of.title
    lines = [f"# {', '.join(result.asked)} on the {name} benchmark", "", f"`{command}`", ""]
    lines += [f"- {note}" for note in notes(result)]
    return "\n".join([*lines, "", *(table.markdown() for table in tables(result))])


def as_json(result: BenchmarkResult) -> dict[str, Any]:
    """Every future frame of every action, and the errors printed for this protocol."""
    protocol = result.protocol
    return {
        "benchmark": protocol.benchmark,
        "windows": protocol.windows,
        "n_in": protocol.n_in,
        "n_out": protocol.n_out,
        "error": protocol.error,
        "unit": protocol.unit,
        "read_at_future_frames": [list(frames) for frames in protocol.readings],
        "joints": list(protocol.skeleton.joints),
        "mean_over": list(result.averaged),
        "results": [
            {
                "method": name,
                "mean": _numbers(mean_over(protocol, scores)),
                "actions": {action: _score(score) for action, score in scores.items()},
            }
            for name, scores in result.scores.items()
        ],
        "printed": [entry.model_dump() for entry in result.printed],
        "cards": {method: dict(card) for method, card in result.cards.items()},
    }


def _score(score: Score) -> dict[str, Any]:
    joints = None if score.joints is None else [_numbers(row) for row in score.joints]
    return {"windows": score.windows, "errors": _numbers(score.errors), "joints": joints}


def _numbers(values: Any) -> list[float | None]:
    return [_number(v) for v in values]


def as_csv(result: BenchmarkResult) -> str:
    """One line per method, action and column of the tables."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    unit = result.protocol.unit.replace(" ", "_")
    writer.writerow(["method", "action", "future_frame", "nominal_ms", f"error_{unit}"])
    for frames in result.protocol.readings:
        for action in (MEAN, *result.actions):
            for name, values in _rows(result, action, frames):
                for frame, value in zip(frames, values, strict=True):
                    shown = "" if value is None else f"{value:.4f}"
                    writer.writerow([name, action, frame, nominal_ms(frame), shown])
    return out.getvalue()


def write_report(result: BenchmarkResult, out: Path, command: str) -> list[Path]:
    """Write Markdown, CSV, JSON and, with matplotlib, a plot below ``out``; returns the files.

    Raises:
        ConfigError: they cannot be written.
    """
    protocol = result.protocol
    lengths = f"{protocol.n_in}to{protocol.n_out}"
    asked = "_".join(result.asked).replace("/", "_")  # labels may hold parts of paths
    stem = f"{asked}_{protocol.benchmark}_{protocol.windows}_{lengths}"
    texts = {
        ".md": as_markdown(result, command),
        ".csv": as_csv(result),
        ".json": json.dumps(as_json(result), indent=1) + "\n",
    }
    with OsErrorAs(ConfigError, f"--out {out}: cannot be written", "name another folder"):
        for ending, text in texts.items():
            atomic_write(out / f"{stem}{ending}", text.encode())
        written = [out / f"{stem}{ending}" for ending in texts]
        if can_plot():
            from hri_predict.base.figures import write_figure
            from hri_predict.lab.evaluation.benchmark_plot import error_by_horizon

            figure = error_by_horizon(result)
            written.append(write_figure(figure, out / f"{stem}.png", dpi=130))
    return written
