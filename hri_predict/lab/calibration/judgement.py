"""Evaluates zones: coverage at every level and by action, and sizes; for people and programs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.lab.calibration.coverage import Calibrated, Coverage, as_calibrated, as_run
from hri_predict.lab.calibration.levels import levels_text
from hri_predict.lab.calibration.scores import Scores
from hri_predict.lab.calibration.sizes import Sizes, measure_sizes
from hri_predict.lab.evaluation.table import HORIZONS_MS, Table, percent, plain
from hri_predict.zones.calibration import OFS, Calibration
from hri_predict.zones.motion_class import SPEED_CLASSES
from hri_predict.zones.settings import LEVELS, CoverageSettings

SIZE_MS = (400, 1000)
WAYS = ("as calibrated", "cut", "cut and self-check")
"""Radii alone; zones as the node builds them, without and with its self-check."""
DEFAULT_LEVEL = 0.99


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ZoneJudgement:
    """Measurements.

    Attributes:
        predictor: its name.
        calibration: the calibration that was evaluated.
        rate_hz: steps per second.
        coverage: (level, question, way) -> counts.
        sizes: question -> action -> volumes at ``SIZE_MS``.
    """

    predictor: str
    calibration: Calibration
    rate_hz: float
    coverage: Mapping[tuple[float, str, str], Coverage]
    sizes: Mapping[str, Mapping[str, Sizes]]

    def at(self, ms: int) -> int:
        """Index of the step at a horizon."""
        return round(ms * self.rate_hz / 1000) - 1

    @property
    def actions(self) -> tuple[str, ...]:
        """Actions in the order of the recordings."""
        return tuple(dict.fromkeys(next(iter(self.coverage.values())).actions))

    @property
    def recordings(self) -> int:
        """Number of recordings evaluated: the independent units."""
        return len(next(iter(self.coverage.values())).names)

    def horizons(self) -> list[int]:
        """Those of ``HORIZONS_MS`` that were calibrated and forecast."""
        forecast = len(next(iter(self.coverage.values())).share("body"))
        return [ms for ms in HORIZONS_MS if self.at(ms) < min(self.calibration.steps, forecast)]


def judge_zones(
    calibrated: Calibrated,
    scores: Sequence[Scores],
    beside: Mapping[str, tuple[Sequence[Scores], Calibrated]],
    on_part: Callable[[str], None] = lambda _: None,
) -> ZoneJudgement:
    """Measure everything.

    Args:
        calibrated: the predictor (see ``scores.score_recordings``) and the calibration to measure.
        scores: its scores of the recordings.
        beside: other predictors for comparing sizes, with their scores of the same recordings.
        on_part: called with the name of the next part, for a progress bar.
    """
    predictor, calibration = calibrated
    coverage: dict[tuple[float, str, str], Coverage] = {}
    for level in LEVELS:
        for of in OFS:
            on_part(f"coverage, {100 * level:g} % {of}")
            settings = CoverageSettings(level=level, of=of)
            bare = settings.model_copy(update={"self_check": False})
            found = as_calibrated(scores, calibration, settings, predictor.skeleton)
            coverage[level, of, WAYS[0]] = found
            coverage[level, of, WAYS[1]] = as_run(scores, calibrated, bare)
            coverage[level, of, WAYS[2]] = as_run(scores, calibrated, settings)
    steps = [round(ms * predictor.rate_hz / 1000) for ms in SIZE_MS]
    steps = [s for s in steps if s <= scores[0].error_m.shape[1]]
    compared = {calibration.predictor: (scores, calibrated), **beside}
    sizes: dict[str, dict[str, Sizes]] = {of: {} for of in OFS}
    for of in OFS:
        for action in dict.fromkeys(s.action for s in scores):
            on_part(f"sizes, {action}")
            own = [i for i, s in enumerate(scores) if s.action == action]
            methods = {
                name: ([theirs[i] for i in own], by) for name, (theirs, by) in compared.items()
            }
            settings = CoverageSettings(level=DEFAULT_LEVEL, of=of)
            sizes[of][action] = measure_sizes([scores[i] for i in own], methods, settings, steps)
    return ZoneJudgement(
        predictor=calibration.predictor,
        calibration=calibration,
        rate_hz=predictor.rate_hz,
        coverage=coverage,
        sizes=sizes,
    )


# -- tables -------------------------------------------------------------------------------------


def tables(judged: ZoneJudgement) -> list[Table]:
    """Coverage pooled, coverage by action, sizes."""
    return [*_pooled(judged), *_by_action(judged), *_sizes(judged)]


def _pooled(judged: ZoneJudgement) -> list[Table]:
    found = []
    columns = ("stated", *(f"{ms} ms" for ms in judged.horizons()))
    for of in OFS:
        for way in WAYS:
            rows = []
            for level in LEVELS:
                coverage = judged.coverage[level, of, way]
                low, high = coverage.interval(of)
                share = coverage.share(of)
                at = [judged.at(ms) for ms in judged.horizons()]
                cells = [_percent(share[k], low[k], high[k]) for k in at]
                if judged.recordings == 1:  # which says nothing of others
                    cells = [percent(share[k]) for k in at]
                rows.append((f"{100 * level:g} %", *cells))
            subject = "each joint" if of == "joint" else "the whole body"
            sure = f" [95 % interval, {judged.recordings} recordings]"
            title = f"Measured coverage of {subject}, {way}, %{sure * (judged.recordings > 1)}"
            found.append(Table(title, columns, tuple(rows)))
    return found


def _by_action(judged: ZoneJudgement) -> list[Table]:
    found = []
    columns = ("action", *(f"{ms} ms" for ms in judged.horizons()), "widened", "unlike")
    for of in OFS:
        for way in WAYS[1:]:
            coverage = judged.coverage[DEFAULT_LEVEL, of, way]
            rows = []
            for action in judged.actions:
                share = coverage.of_action(action).share(of)
                cells = [percent(share[judged.at(ms)]) for ms in judged.horizons()]
                widened, unlike = coverage.trust_of(action)
                rows.append((action, *cells, percent(widened), percent(unlike)))
            subject = "each joint" if of == "joint" else "the whole body"
            title = f"By action at {100 * DEFAULT_LEVEL:g} %, {subject}, {way}, %"
            found.append(Table(title, columns, tuple(rows)))
    return found


def _sizes(judged: ZoneJudgement) -> list[Table]:
    found = []
    for of, by_action in judged.sizes.items():
        for action, sizes in by_action.items():
            subject = "each joint" if of == "joint" else "the whole body"
            for k, step in enumerate(sizes.steps):
                ms = round(1000 * step / judged.rate_hz)
                title = (
                    f"Mean zone volume at {ms} ms, {action}, calibrated for {subject} at "
                    f"{100 * DEFAULT_LEVEL:g} %, m³ (relative to the ball of 1.6 m/s)"
                )
                rows = []
                for method, volumes in sizes.by_method.items():
                    share = sizes.relative(method, "1.6 m/s")[k]
                    total = [*volumes[k], volumes[k].sum()]
                    pairs = zip(total, share, strict=True)
                    rows.append((method, *(_volume(v, s) for v, s in pairs)))
                parts = (part.replace("_", " ") for part in sizes.parts)
                found.append(Table(title, ("method", *parts, "body"), tuple(rows)))
    return found


def notes(judged: ZoneJudgement) -> list[str]:
    """Notes for a reader of the tables."""
    used = len(judged.calibration.recordings)
    windows = np.array([r.windows for r in judged.calibration.recordings]).sum(0)
    per = ", ".join(f"{name} {n}" for name, n in zip(SPEED_CLASSES, windows, strict=True))
    return [
        f"calibrated on {used} recordings; windows by speed: {per}",
        *levels_text(judged.calibration),
        "coverage during the 40 ms that end at the horizon, at every capture in them",
        "self-check: widens only, or falls back to physical limits",
    ]


def as_json(judged: ZoneJudgement) -> dict[str, Any]:
    """Everything, for programs; shares from 0 to 1, volumes in cubic metres, NaN as null."""
    at = [judged.at(ms) for ms in judged.horizons()]
    coverage = []
    for (level, of, way), found in judged.coverage.items():
        low, high = found.interval(of)
        coverage.append(
            {
                "level": level,
                "of": of,
                "way": way,
                "share": plain(found.share(of)[at]),
                "low": plain(low[at]),
                "high": plain(high[at]),
                "widened": found.widened,
                "unlike": found.unlike,
                "actions": {a: plain(found.of_action(a).share(of)[at]) for a in judged.actions},
            }
        )
    return {
        "predictor": judged.predictor,
        "basis": "estimated",
        "recordings": judged.recordings,
        "horizons_ms": judged.horizons(),
        "levels": levels_text(judged.calibration),
        "coverage": coverage,
        "sizes_m3": {
            of: {
                action: {
                    "parts": list(s.parts),
                    "steps_ms": [round(1000 * k / judged.rate_hz) for k in s.steps],
                    "by_method": {m: [plain(row) for row in v] for m, v in s.by_method.items()},
                }
                for action, s in by_action.items()
            }
            for of, by_action in judged.sizes.items()
        },
    }


def markdown(judged: ZoneJudgement, shown: Sequence[Table], command: str) -> str:
    """The report of these tables."""
    head = f"# Zones of {judged.predictor}\n\n`{command}`\n\n"
    said = "".join(f"- {note}\n" for note in notes(judged))
    return head + said + "\n" + "\n".join(t.markdown() for t in shown)


def _percent(share: float, low: float, high: float) -> str:
    if not np.isfinite(share):
        return "–"
    return f"{100 * share:.1f} [{100 * low:.1f}, {100 * high:.1f}]"


def _volume(volume: float, share: float) -> str:
    return f"{volume:.2f} ({share:.2f})" if volume > 0 else "–"
