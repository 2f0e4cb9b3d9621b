"""Tables of a simulation, for the terminal, Markdown and JSON."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_predict.lab.evaluation.table import Table
from hri_predict.recording.recording import names_of
from hri_sim.simulation.cell import FOREKNOWN
from hri_sim.simulation.results.outcome import HORIZON_S, NEAR_M
from hri_sim.simulation.results.statistics import Estimate, ratio

Row = Mapping[str, Any]
"""An ``Outcome`` or a ``Prediction`` as plain data."""


@dataclass(frozen=True, kw_only=True)
class Metric:
    """A column: key, title with unit, digits, and factor from the ratio to the shown value.

    ``better``: "less", "more", or "" if the value does not rate a mode.
    """

    key: str
    title: str
    digits: int
    factor: float = 1.0
    better: str = "less"


METRICS = (
    Metric(key="contacts", title="contacts, moving, /100", digits=2, factor=100.0),
    Metric(
        key="contacts_standing", title="contacts, standing, /100", digits=1, factor=100.0, better=""
    ),
    Metric(key="violation_share", title="too close, % of time", digits=2, factor=100.0),
    Metric(
        key="moving_separation",
        title="nearest while moving, m",
        digits=2,
        factor=1.0,
        better="more",
    ),
    Metric(key="productivity", title="productivity, %", digits=1, factor=100.0, better="more"),
    Metric(key="stops_per_h", title="stops /h", digits=0, factor=3600.0),
    Metric(key="false_stops_per_h", title="false stops /h", digits=0, factor=3600.0),
    Metric(key="missed", title="missed touches, %", digits=1, factor=100.0),
    Metric(key="lead_s", title="lead time, s", digits=2, factor=1.0, better=""),
)
_SUMMED = (
    "seconds", "contacts", "contacts_standing", "violation_s", "stops", "false_stops", "touches",
    "missed", "cycles", "cycles_empty",
)  # fmt: skip
_TOTALS = (
    "contacts", "contacts_standing", "violation_s", "stops", "wire_stops", "judged_stops",
    "false_stops", "missed", "cycles", "cycles_empty", "touches_beyond", "touches_relative_beyond",
    "touches_forbidden", "clampings",
)  # fmt: skip
_SPEEDS = ("touch_speeds_m_s", "touch_relative_m_s", "touch_limits_m_s")
_NOT_SUMMED = ("motion", "lead_s", *_SPEEDS)
HARM, WORK = METRICS[:4], METRICS[4:]
PREDICTION = (
    Metric(key="precision", title="precision, %", digits=1, factor=100.0, better="more"),
    Metric(key="recall", title="recall, %", digits=1, factor=100.0, better="more"),
    Metric(key="f1", title="F1, %", digits=1, factor=100.0, better="more"),
)


@dataclass(frozen=True, kw_only=True)
class Judged:
    """The numbers of one predictor under one variant.

    Attributes:
        predictor, variant: their names.
        outcomes: the outcomes of all approaches.
        estimates: metric's key -> ratio with interval.
        totals: sums and extremes for the record.
        by_recording: recording -> sums over its approaches.
    """

    predictor: str
    variant: str
    outcomes: Sequence[Row]
    estimates: Mapping[str, Estimate]
    totals: Mapping[str, Any]
    by_recording: Mapping[str, Mapping[str, float]]


def judged(predictor: str, variant: str, rows: Sequence[Row]) -> Judged:
    """Add up all approaches of one variant."""
    names = [row["motion"] for row in rows]

    def of(top: Sequence[float], bottom: Sequence[float]) -> Estimate:
        return ratio(recordings=names, numerators=top, denominators=bottom)

    column = {key: [row[key] for row in rows] for key in rows[0] if key not in _NOT_SUMMED}
    ones = [1.0] * len(rows)
    moving = [row["moving_separation_m"] for row in rows]
    estimates = {
        "contacts": of(column["contacts"], ones),
        "contacts_standing": of(column["contacts_standing"], ones),
        "violation_share": of(column["violation_s"], column["seconds"]),
        "moving_separation": of(
            [0.0 if m is None else m for m in moving], [float(m is not None) for m in moving]
        ),
        "stops_per_h": of(column["judged_stops"], column["judged_s"]),
        "false_stops_per_h": of(column["false_stops"], column["judged_s"]),
        "missed": of(column["missed"], column["touches"]),
        "lead_s": of([sum(r["lead_s"]) for r in rows], [len(r["lead_s"]) for r in rows]),
        "productivity": of(column["cycles"], column["cycles_empty"]),
    }
    separations = [s for s in column["min_separation_m"] if s is not None]
    totals = {
        "approaches": len(rows),
        "recordings": len(set(names)),
        "hours": sum(column["seconds"]) / 3600,
        **{key: sum(column[key]) for key in _TOTALS},
        **{key: _highest(row[key] for row in rows) for key in _SPEEDS},
        "approaches_with_violation": sum(s > 0 for s in column["violation_s"]),
        "violation_depth_m": max(column["violation_m"]),
        "min_separation_m": min(separations, default=None),
        "moving_separation_m": min((m for m in moving if m is not None), default=None),
        "touches_unprotected": sum(column["touches"]),
    }
    return Judged(
        predictor=predictor,
        variant=variant,
        outcomes=rows,
        estimates=estimates,
        totals=totals,
        by_recording=_by_recording(rows),
    )


def _highest(speeds: Iterable[Mapping[str, float]]) -> dict[str, float]:
    """Return the maximum speed by body part."""
    found: dict[str, float] = {}
    for each in speeds:
        for name, speed in each.items():
            found[name] = max(found.get(name, 0.0), speed)
    return found


def _by_recording(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Return each recording's sums: a long recording weighs more in every rate."""
    found: dict[str, dict[str, float]] = {}
    motions = sorted({str(row["motion"]) for row in rows})
    names = dict(zip(motions, names_of([Path(m) for m in motions]), strict=True))
    for row in rows:
        sums = found.setdefault(names[row["motion"]], {"approaches": 0})
        sums["approaches"] += 1
        for key in _SUMMED:
            sums[key] = sums.get(key, 0) + row[key]
    return found


def predicted(rows: Sequence[Row]) -> dict[str, Estimate]:
    """Return precision, recall and F1 of "body and robot touch within 1 s", over instants."""
    names = [row["motion"] for row in rows]
    hits = [row["true_positive"] for row in rows]
    alarms = [row["true_positive"] + row["false_positive"] for row in rows]
    touches = [row["true_positive"] + row["false_negative"] for row in rows]
    return {
        "precision": ratio(recordings=names, numerators=hits, denominators=alarms),
        "recall": ratio(recordings=names, numerators=hits, denominators=touches),
        "f1": ratio(
            recordings=names,
            numerators=[2 * h for h in hits],
            denominators=[a + t for a, t in zip(alarms, touches, strict=True)],
        ),
    }


def shown(estimate: Estimate, metric: Metric) -> str:
    """Return a value and its interval, or a dash if the denominator is 0."""
    if estimate.value is None:
        return "–"
    value, low, high = (
        f"{metric.factor * v:.{metric.digits}f}"
        for v in (estimate.value, estimate.low or 0.0, estimate.high or 0.0)
    )
    return f"{value} [{low}, {high}]"


def tables(
    results: Sequence[Judged],
    alone: Judged,
    predictions: Mapping[str, Sequence[Row]],
) -> list[Table]:
    """Return the tables of the closed loop and of the prediction of touches."""
    first = results[0].totals
    what = (
        f"{first['approaches']} approaches of {first['recordings']} recordings, "
        f"{first['hours']:.2f} h with a person there; without protection "
        f"{first['touches_unprotected']} would touch"
    )
    everybody = (*results, alone)
    harm = Table(
        f"Safety: {what}",
        ("predictor", "mode", "contacts, moving", *(m.title for m in HARM), "deepest, cm"),
        tuple(
            (
                r.predictor,
                r.variant,
                str(r.totals["contacts"]),
                *(shown(r.estimates[m.key], m) for m in HARM),
                f"{r.totals['violation_depth_m'] * 100:.0f}",
            )
            for r in everybody
        ),
    )
    work = Table(
        "Cost, and foresight",
        ("predictor", "mode", *(m.title for m in WORK)),
        tuple(
            (
                r.predictor,
                r.variant,
                *(
                    "–" if r is alone and m.key != "productivity" else shown(r.estimates[m.key], m)
                    for m in WORK
                ),
            )
            for r in everybody
        ),
    )
    touch = Table(
        f"Prediction: body and robot touch within {HORIZON_S:g} s (mean bodies, planned robot)",
        ("predictor", *(m.title for m in PREDICTION)),
        tuple(
            (name, *(shown(e, m) for e, m in zip(predicted(rs).values(), PREDICTION, strict=True)))
            for name, rs in predictions.items()
        ),
    )
    return [harm, work, touch]


def touched(result: Judged) -> str:
    """Return the body parts that the moving robot touched, with speeds; "" without touches."""
    totals = result.totals
    parts = [
        f"{part} {speed:.2f} m/s (relative {totals['touch_relative_m_s'][part]:.2f}; bears "
        f"{totals['touch_limits_m_s'][part]:.2f})"
        for part, speed in sorted(totals["touch_speeds_m_s"].items())
    ]
    if not parts:
        return ""
    return (
        f"{result.predictor} {result.variant} touched, at most: {', '.join(parts)}. Instants (10 "
        f"ms) faster than the part bears: {totals['touches_beyond']}, by the relative speed "
        f"{totals['touches_relative_beyond']}; of head, face or neck: "
        f"{totals['touches_forbidden']}; clamped: {totals['clampings']}."
    )


def recordings_table(results: Sequence[Judged]) -> Table:
    """Return each recording's productivity, longest recording first, because it weighs most."""
    first = results[0].by_recording
    longest_first = sorted(first, key=lambda name: -first[name]["seconds"])
    variants = [f"{r.predictor} {r.variant}" for r in results]

    def productivity(judged: Judged, name: str) -> str:
        sums = judged.by_recording[name]
        if not sums["cycles_empty"]:
            return "–"
        percent = round(100.0 * sums["cycles"] / sums["cycles_empty"], 1)
        return f"{percent + 0.0:.1f}"  # avoids -0.0, because sums are rounded

    return Table(
        "Productivity, %, by recording",
        ("recording", "approaches", "seconds", *variants),
        tuple(
            (
                name,
                f"{first[name]['approaches']:.0f}",
                f"{first[name]['seconds']:.0f}",
                *(productivity(r, name) for r in results),
            )
            for name in longest_first
        ),
    )


def notes(results: Sequence[Judged]) -> list[str]:
    """Return notes that explain the tables."""
    first = results[0].totals
    recordings, approaches = first["recordings"], first["approaches"]
    said = [
        f"Intervals (95 %) resample by recording; there are only {recordings}, and the "
        f"{approaches} approaches reuse them.",
        "A – means that the denominator is 0.",
        f"None in {approaches} approaches does not mean never: the upper end of a 95 % interval is "
        f"then about {min(1.0, 3 / approaches):.2g} per approach if approaches were independent, "
        f"and {min(1.0, 3 / recordings):.2g} of recordings if only recordings are (rule of three).",
        "Contacts, moving: touches while any point of the robot was faster than 10 mm/s. Contacts, "
        "standing: touches of a standing robot; recorded people do not react to the robot and walk "
        "through it.",
        "Too near: the robot moved while a body was nearer than C + Z_d + Z_r; deepest: the "
        "maximum shortfall.",
        "Nearest while moving: the smallest distance between a body and the moving robot, mean "
        "over the approaches.",
        "A false stop: if the robot had continued at full speed along its plan, no person would "
        f"have come within {NEAR_M:g} m in {HORIZON_S:g} s. The last {HORIZON_S:g} s of each "
        "approach do not count in the columns of stops, because the recording ends too soon to "
        "judge them.",
        "Missed: the unprotected robot would have been touched, and the advice was clear or warn "
        "until then. Lead time: in the other cases, the time between the first stricter advice and "
        "the touch.",
        "Rates are sums over sums, so that long recordings weigh more; with --out, simulate.md has "
        "each recording's productivity and simulate.json its sums.",
        "Productivity: work cycles while a person is there, compared with an empty cell in the "
        "same time with the same wire.",
    ]
    said += [text for text in map(touched, results) if text]
    if any(r.variant == "hybrid" for r in results):
        said.append(
            "Mode hybrid permits contact. Recorded people do not react to a touch: they walk on "
            "through the robot, so touches go deeper and reach other parts than in reality."
        )
    if any(r.variant == FOREKNOWN for r in results):
        said.append(
            "foreknown: the predictive mode with the true future instead of a forecast, and "
            "zones as narrow as the bodies. No real node can do this; it is an upper bound for "
            "any forecast."
        )
    if recordings < 2:
        said.append("With one recording there is no interval: all resamples are the same.")
    return said
