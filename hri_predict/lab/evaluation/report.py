"""Tables of the evaluation on recordings: Markdown for people, CSV and JSON for programs."""

import csv
import io
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import atomic_write
from hri_predict.base.looks import can_plot
from hri_predict.lab.evaluation.recordings import (
    MEAN_ACTIONS,
    RecordingResult,
    at_horizons,
    relative_loss,
)
from hri_predict.lab.evaluation.table import HORIZONS_MS, Table
from hri_predict.lab.evaluation.windows import HORIZON_STEPS, scored_joints
from hri_predict.predictors.neural.body import BODY
from hri_predict.run.zone_basis import ZoneBasis


def judge_table(results: Sequence[RecordingResult]) -> Table:
    """The headline: each predictor's mean over the five actions (or those that occur), mm."""
    clean = undisturbed(results)
    averaged = clean[0].averaged if clean else ()
    title = "Mean over " + ("the five actions" if averaged == MEAN_ACTIONS else _and(averaged))
    rows = tuple((r.predictor, *_cells(r.mean_mm())) for r in clean)
    return Table(f"{title}, mm", _columns(clean), rows)


def action_tables(results: Sequence[RecordingResult]) -> list[Table]:
    """One table per action: every predictor's errors, mm."""
    clean = undisturbed(results)
    tables = []
    for action in clean[0].actions if clean else ():
        rows = tuple((r.predictor, *_cells(r.action_mm(action))) for r in clean)
        windows = clean[0].actions[action].windows
        tables.append(Table(f"{action} ({windows} windows), mm", _columns(clean), rows))
    return tables


def joint_table(results: Sequence[RecordingResult], horizon_ms: int) -> Table:
    """Every predictor's mean over the five actions by joint at one of ``HORIZONS_MS``, mm."""
    clean, step = undisturbed(results), HORIZON_STEPS[HORIZONS_MS.index(horizon_ms)] - 1
    unknown = np.full(len(BODY.joints), np.nan)
    columns = [r.mean_by_joint()[step] if step < r.steps else unknown for r in clean]
    rows = tuple((BODY.joints[j], *_cells([c[j] for c in columns])) for j in scored_joints())
    title = f"By joint, {horizon_ms} ms ahead, mm"
    return Table(title, ("joint", *(r.predictor for r in clean)), rows)


def corruption_table(results: Sequence[RecordingResult]) -> Table:
    """Return the loss of every predictor by each disturbance, relative to undisturbed input.

    Each cell: mean error over actions and horizons, mm, and its relative growth.
    """
    clean = {r.predictor: r for r in undisturbed(results)}
    rows = [("none", *(f"{r.overall_mm():.0f}" for r in clean.values()))]
    names = list(dict.fromkeys(r.corruption.name for r in results if r.corruption))
    for name in names:
        found = {r.predictor: r for r in results if r.corruption and r.corruption.name == name}
        rows.append((name, *(_loss(clean[p], found.get(p)) for p in clean)))
    title = "Disturbed input: mean error over actions and horizons, mm, and its growth"
    return Table(title, ("disturbance", *clean), tuple(rows))


def undisturbed(results: Sequence[RecordingResult]) -> list[RecordingResult]:
    """Results on undisturbed input."""
    return [r for r in results if r.corruption is None]


def as_json(results: Sequence[RecordingResult], zones: Sequence[ZoneBasis] = ()) -> dict[str, Any]:
    """All numbers of the tables, for programs; millimetres, ``null`` where nothing is known.

    ``results``: per predictor and disturbance the mean and every action by horizon, and the mean
    by joint; ``losses``: as a share of the undisturbed error, at each horizon and over them all;
    ``zones``: the basis of each requested predictor's zones.
    """
    clean = {r.predictor: r for r in undisturbed(results)}
    return {
        "horizons_ms": list(results[0].horizons_ms),
        "zones": [basis.as_json() for basis in zones],
        "results": [_result_json(r) for r in results],
        "losses": [
            {
                "predictor": r.predictor,
                "disturbance": r.corruption.name,
                "by_horizon": _numbers(relative_loss(clean[r.predictor], r)[:-1], 4),
                "overall": _numbers(relative_loss(clean[r.predictor], r)[-1:], 4)[0],
            }
            for r in results
            if r.corruption is not None and r.predictor in clean
        ],
    }


def _result_json(result: RecordingResult) -> dict[str, Any]:
    by_joint = at_horizons(result.mean_by_joint())
    return {
        "predictor": result.predictor,
        "disturbance": result.corruption.name if result.corruption else None,
        "mean_over": list(result.averaged),
        "mean_mm": _numbers(result.mean_mm()),
        "actions": {
            action: {"windows": errors.windows, "mm": _numbers(result.action_mm(action))}
            for action, errors in result.actions.items()
        },
        "joints_mm": {BODY.joints[j]: _numbers(by_joint[:, j]) for j in scored_joints()},
    }


def as_csv(results: Sequence[RecordingResult]) -> str:
    """One line per predictor, disturbance, action ("mean" first), joint ("all" first), horizon."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["predictor", "disturbance", "action", "windows", "joint", "horizon_ms", "error_mm"]
    )
    for r in results:
        what = r.corruption.name if r.corruption else ""
        total = sum(r.actions[a].windows for a in r.averaged)
        parts = [("mean", total, r.mean_by_step(), r.mean_by_joint())]
        parts += [(a, e.windows, e.by_step(), e.by_joint()) for a, e in r.actions.items()]
        for action, windows, whole, joints in parts:
            columns = [("all", whole), *((BODY.joints[j], joints[:, j]) for j in scored_joints())]
            for joint, errors in columns:
                for ms, error in zip(r.horizons_ms, at_horizons(errors), strict=True):
                    if math.isfinite(error):
                        value = f"{error:.2f}"
                        writer.writerow([r.predictor, what, action, windows, joint, ms, value])
    return out.getvalue()


def as_markdown(results: Sequence[RecordingResult], zones: Sequence[ZoneBasis] = ()) -> str:
    """Every table, and what was measured."""
    tables = [judge_table(results), *action_tables(results)]
    horizons_ms = results[0].joint_horizons_ms if results else ()
    tables += [joint_table(results, ms) for ms in horizons_ms]
    if any(r.corruption for r in results):
        tables.append(corruption_table(results))
    head = (
        "# Evaluation on recordings\n\n"
        "Mean distance between predicted and true joints in the room, the person's travel "
        "included: true millimetres and seconds, on the pelvis and the 25 joints of the CMU "
        "benchmark where they are known. Forecast origins at 25 Hz, each with 15 steps of history, "
        f"the same for all predictors. The five actions are {_and(MEAN_ACTIONS)}; a mean gives "
        "each action the same weight. A dash: the recording or the predictor does not reach that "
        "far.\n"
    )
    notes = ["".join(f"- {basis.line}\n" for basis in zones)] if zones else []
    return "\n".join([head, *notes, *(t.markdown() for t in tables)])


def write_report(
    results: Sequence[RecordingResult], out_dir: Path, zones: Sequence[ZoneBasis] = ()
) -> list[Path]:
    """Write ``real.md``, ``real.csv`` and ``real.json``, with matplotlib also plots; return them.

    Raises:
        ConfigError: the folder cannot be written.
    """
    texts = {
        "real.md": as_markdown(results, zones),
        "real.csv": as_csv(results),
        "real.json": json.dumps(as_json(results, zones), indent=1) + "\n",
    }
    with OsErrorAs(ConfigError, f"--out {out_dir}: cannot be written", "name another folder"):
        for name, text in texts.items():
            atomic_write(out_dir / name, text.encode())
        written = [out_dir / name for name in texts]
        if can_plot():
            from hri_predict.lab.evaluation.plots import write_plots

            written += write_plots(results, out_dir)
    return written


def _columns(results: Sequence[RecordingResult]) -> tuple[str, ...]:
    return ("predictor", *(f"{ms} ms" for ms in (results[0].horizons_ms if results else ())))


def _cells(values: Sequence[float] | np.ndarray) -> tuple[str, ...]:
    return tuple(f"{v:.0f}" if math.isfinite(v) else "–" for v in values)


def _loss(clean: RecordingResult, disturbed: RecordingResult | None) -> str:
    if disturbed is None:
        return "–"
    return f"{disturbed.overall_mm():.0f} ({relative_loss(clean, disturbed)[-1]:+.0%})"


def _numbers(values: np.ndarray, digits: int = 2) -> list[float | None]:
    return [round(float(v), digits) if math.isfinite(v) else None for v in values]


def _and(words: Sequence[str]) -> str:
    return (
        " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words) or "nothing"
    )
