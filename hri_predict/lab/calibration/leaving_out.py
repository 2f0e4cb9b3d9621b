"""Leaving a set out: coverage of people, tasks and trackers that the calibration never saw.

Each set is left out in turn: the calibration is made from the other sets' recordings, and measured
on all recordings of the set. This estimates the coverage at a new site, with unknown people and a
tracker that places joints in its own way. The estimate is fair only if the predictor was not fitted
on the set either.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.work.workers import Workers
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor, PredictorSettings
from hri_predict.lab.calibration.conformal import calibrate
from hri_predict.lab.calibration.coverage import Calibrated, Coverage, as_calibrated, as_run
from hri_predict.lab.calibration.scores import Scores
from hri_predict.lab.datasets.tracks import nearest
from hri_predict.lab.evaluation.table import HORIZONS_MS, Table, plain
from hri_predict.zones.calibration import OFS, Calibration, Of
from hri_predict.zones.predictor_identity import identity
from hri_predict.zones.settings import LEVELS, CoverageSettings

SETS = ("arms", "beside_robot", "cmu_tools", "cmu_subjects", "cmu_dance")
"""The sets that are left out, as ``Scores.action`` names them."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LeftOut:
    """One set. H steps.

    Attributes:
        name: name of the set.
        recordings, calibrated_on: number of recordings measured, and of those calibrated on.
        calibration: the calibration made without the set.
        coverage: (level, question) -> coverage of the radii alone.
        run: zones as the node builds them, with its self-check, at the highest level.
        error_m: (H,) mean error of a joint.
        standing_m: (H,) mean error of a forecast that stands still.
    """

    name: str
    recordings: int
    calibrated_on: int
    calibration: Calibration
    coverage: dict[tuple[float, Of], Coverage]
    run: Coverage
    error_m: Floats
    standing_m: Floats


def leave_out(
    *,
    predictor: Predictor,
    settings: PredictorSettings,
    scores: Sequence[Scores],
    judged: Sequence[Scores],
    on_part: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
) -> list[LeftOut]:
    """Leave out each of ``SETS`` that occurs.

    Args:
        predictor: predictor of the zones to measure.
        settings: settings of that predictor.
        scores: the recordings to calibrate on.
        judged: the recordings to measure, as recorded; may include those of ``scores``.
        on_part: called with the name of each set.
        workers: workers that fit the scales; default: this process.

    Raises:
        ConfigError: no set occurs, or too few recordings are left.
    """
    found = []
    values, digest = identity(settings)
    for name in SETS:
        own = [s for s in judged if s.action == name]
        if not own:
            continue
        on_part(name)
        others = [s for s in scores if s.action != name]
        fitted = calibrate(
            scores=others,
            predictor=settings.name,
            settings=values,
            weights=digest,
            rate_hz=predictor.rate_hz,
            skeleton=predictor.skeleton,
            workers=workers,
        )
        made = replace(fitted, made=date.today(), code=registry.code_of(settings))
        coverage = {
            (level, of): as_calibrated(
                own, made, CoverageSettings(level=level, of=of), predictor.skeleton
            )
            for level in LEVELS
            for of in OFS
        }
        found.append(
            LeftOut(
                name=name,
                recordings=len({s.name for s in own}),
                calibrated_on=len({s.name for s in others}),
                calibration=made,
                coverage=coverage,
                run=as_run(own, Calibrated(predictor, made), CoverageSettings(level=LEVELS[-1])),
                error_m=_mean([_at_steps(s, s.forecast, predictor.rate_hz) for s in own]),
                standing_m=_mean([_at_steps(s, s.history[:, -1:], predictor.rate_hz) for s in own]),
            )
        )
    if not found:
        raise ConfigError(
            f"--leave-out: no recording belongs to a set ({', '.join(SETS)}); name others"
        )
    return found


def _at_steps(entry: Scores, forecast: Floats, rate_hz: float) -> Floats:
    """(W, H, J) distance of forecasts from the captures nearest to each step; NaN if unknown."""
    stamps, step_ns = entry.truth.stamps_ns, round(1e9 / rate_hz)
    ahead = step_ns * np.arange(1, entry.error_m.shape[1] + 1)
    wanted = entry.origin_ns[:, None] + ahead
    at = nearest(stamps, wanted)
    near = np.abs(stamps[at] - wanted) <= step_ns // 2
    seen = entry.truth.observed[at] & entry.observed[:, -1:, :] & near[..., None]
    apart = np.linalg.norm(entry.truth.positions[at] - forecast, axis=-1)
    return np.where(seen, apart, np.nan)


def _mean(parts: Sequence[Floats]) -> Floats:
    total = np.sum([np.nansum(p, (0, 2)) for p in parts], 0)
    count = np.sum([np.isfinite(p).sum((0, 2)) for p in parts], 0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def tables(found: Sequence[LeftOut], rate_hz: float) -> list[Table]:
    """Coverage at each level and question, what the self-check did, and errors."""
    at = [round(ms * rate_hz / 1000) - 1 for ms in HORIZONS_MS]
    at = [k for k in at if k < len(found[0].error_m)]
    horizons = tuple(f"{ms} ms" for ms in HORIZONS_MS[: len(at)])
    shown = []
    for of in OFS:
        for level in LEVELS:
            rows = [(f"{f.name} ({f.recordings})", f.coverage[level, of].share(of)) for f in found]
            held = sum(f.coverage[level, of].held[of].sum(0) for f in found)
            known = sum(f.coverage[level, of].known[of].sum(0) for f in found)
            rows.append(("pooled", np.asarray(held / np.maximum(known, 1))))
            subject = "each joint" if of == "joint" else "the whole body"
            shown.append(
                Table(
                    f"Held of {subject} at a stated {100 * level:g} %, set left out, %",
                    ("set (recordings)", *horizons),
                    tuple((name, *(f"{100 * share[k]:.1f}" for k in at)) for name, share in rows),
                )
            )
    shown.append(
        Table(
            f"As the node builds zones ({100 * LEVELS[-1]:g} % of joints), % of the time",
            ("set", "widened", "out of distribution"),
            tuple(
                (f.name, *(f"{100 * x:.1f}" for x in (f.run.widened, f.run.unlike))) for f in found
            ),
        )
    )
    errors = [
        (f"{f.name}, {who}", *(f"{1000 * error[k]:.0f}" for k in at))
        for f in found
        for who, error in (("forecast", f.error_m), ("standing still", f.standing_m))
    ]
    shown.append(Table("Mean error of a joint, mm", ("set", *horizons), tuple(errors)))
    return shown


def as_json(found: Sequence[LeftOut]) -> list[dict[str, Any]]:
    """Everything, for programs; shares from 0 to 1 and metres, by step, NaN as null."""
    return [
        {
            "set": f.name,
            "recordings": f.recordings,
            "calibrated_on": f.calibrated_on,
            "coverage": [
                {"level": level, "of": of, "share": plain(coverage.share(of))}
                for (level, of), coverage in f.coverage.items()
            ],
            "widened": f.run.widened,
            "out_of_distribution": f.run.unlike,
            "error_m": plain(f.error_m),
            "standing_m": plain(f.standing_m),
        }
        for f in found
    ]
