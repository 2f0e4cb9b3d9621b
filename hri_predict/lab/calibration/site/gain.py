"""Gain from moving a calibration to a site: coverage and sizes before and after, on parts that
were held out.

The parts are divided into ``FOLDS`` blocks of neighbours in time. Each block is measured with
factors that were moved by the others alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.coverage import ratio
from hri_predict.lab.calibration.site.adapted import groups, moved_factors
from hri_predict.lab.calibration.site.parts import Part
from hri_predict.lab.evaluation.table import HORIZONS_MS, Table, percent, plain
from hri_predict.zones.calibration import OFS, Calibration, Of
from hri_predict.zones.settings import LEVELS

FOLDS = 5
WALK_M_S, BODY_M = 1.6, 0.08
"""Growth of the ball that sizes are compared with, and the body's size, added to both."""
BEFORE, AFTER = "before", "after"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Gain:
    """Coverage and sizes before and after the move. L levels, H steps.

    Attributes:
        parts: number of parts.
        held: (question, when) -> (L, H) share held, pooled over windows of held-out parts.
        radius_m: (question, when) -> (L, H) mean radius of a joint.
        volume: (question, when) -> (L, H) mean volume around a joint over that of the ball of
            ``WALK_M_S``.
        rate_hz: steps per second.
    """

    parts: int
    held: dict[tuple[Of, str], Floats]
    radius_m: dict[tuple[Of, str], Floats]
    volume: dict[tuple[Of, str], Floats]
    rate_hz: float


def measured_gain(base: Calibration, parts: Sequence[Part], skeleton: Skeleton) -> Gain:
    """Measure the base before and after the move; from a single part only before (else NaN)."""
    calibrated = groups(base, skeleton) >= 0
    sums: dict[tuple[Of, str], list[Floats]] = {}
    blocks = np.array_split(np.arange(len(parts)), min(FOLDS, len(parts)))
    for block in blocks:
        others = [p for i, p in enumerate(parts) if i not in block]
        after = moved_factors(base, others, skeleton) if others else None
        for part in (parts[i] for i in block):
            for of in OFS:
                _add(
                    sums,
                    (of, BEFORE),
                    _counts(part, base.estimated[of], of=of, calibrated=calibrated, base=base),
                )
                if after is not None:
                    _add(
                        sums,
                        (of, AFTER),
                        _counts(part, after[of], of=of, calibrated=calibrated, base=base),
                    )
    unknown = np.full((len(LEVELS), base.steps), np.nan)
    held, radius, volume = {}, {}, {}
    for of in OFS:
        for when in (BEFORE, AFTER):
            total = sums.get((of, when))
            held[of, when] = unknown if total is None else ratio(total[0], total[1])
            radius[of, when] = unknown if total is None else ratio(total[2], total[4])
            volume[of, when] = unknown if total is None else ratio(total[3], total[4])
    return Gain(parts=len(parts), held=held, radius_m=radius, volume=volume, rate_hz=base.rate_hz)


def _counts(
    part: Part, factors: Floats, *, of: Of, calibrated: Bools, base: Calibration
) -> list[Floats]:
    """Held, known, and sums of radii, volumes and their number; (L, H) each."""
    steps = base.steps
    ball = WALK_M_S * np.arange(1, steps + 1) / base.rate_hz + BODY_M
    found = []
    for table in factors:  # (3, H)
        radius = table[part.speeds][:, :, None] * part.scale_m[:, :steps][:, :, calibrated]
        radius = np.maximum.accumulate(radius, axis=1)  # as the node's zones never shrink
        error = part.error_m[:, :steps][:, :, calibrated]
        bounded = np.isfinite(radius)
        known = np.isfinite(error) & bounded
        inside = ~known | (error <= radius)
        if of == "body":
            somebody = known.any(2)
            held, count = (somebody & inside.all(2)).sum(0), somebody.sum(0)
        else:
            held, count = (known & inside).sum((0, 2)), known.sum((0, 2))
        plain = np.where(bounded, radius, 0.0)
        relative = np.where(bounded, ((plain + BODY_M) / ball[:, None]) ** 3, 0.0)
        found.append([held, count, plain.sum((0, 2)), relative.sum((0, 2)), bounded.sum((0, 2))])
    return [np.stack(column).astype(np.float64) for column in zip(*found, strict=True)]


def _add(
    sums: dict[tuple[Of, str], list[Floats]], key: tuple[Of, str], counts: list[Floats]
) -> None:
    known = sums.get(key)
    sums[key] = counts if known is None else [a + b for a, b in zip(known, counts, strict=True)]


# -- for people and programs -----------------------------------------------------------------------


def _at(gain: Gain) -> tuple[list[int], list[int]]:
    """The shown horizons in ms, and their steps."""
    steps = next(iter(gain.held.values())).shape[1]
    pairs = [(ms, round(ms * gain.rate_hz / 1000) - 1) for ms in HORIZONS_MS]
    shown = [(ms, k) for ms, k in pairs if 0 <= k < steps]
    return [ms for ms, _ in shown], [k for _, k in shown]


def tables(gain: Gain) -> list[Table]:
    """Coverage and sizes, before and after, at every level and question."""
    horizons, at = _at(gain)
    columns = ("stated", *(f"{ms} ms" for ms in horizons))
    parts = f"{gain.parts} held-out parts" if gain.parts > 1 else "one part"
    found = []
    for of in OFS:
        subject = "each joint" if of == "joint" else "the whole body"
        for title, values, text in (
            (f"Held of {subject}, {parts}, %", gain.held, percent),
            (f"Mean radius of a joint, zones of {subject}, mm", gain.radius_m, _mm),
            (
                f"Volume around a joint, zones of {subject}, over the ball of {WALK_M_S:g} m/s",
                gain.volume,
                _two,
            ),
        ):
            rows = [
                (f"{100 * level:g} %, {when}", *(text(values[of, when][i, k]) for k in at))
                for i, level in enumerate(LEVELS)
                for when in (BEFORE, AFTER)
            ]
            found.append(Table(title, columns, tuple(rows)))
    return found


def as_json(gain: Gain) -> dict[str, Any]:
    """Everything shown; shares from 0 to 1, metres, NaN as null."""
    horizons, at = _at(gain)
    return {
        "parts": gain.parts,
        "horizons_ms": horizons,
        "measured": [
            {
                "level": level,
                "of": of,
                "when": when,
                "held": plain(gain.held[of, when][i, at]),
                "radius_m": plain(gain.radius_m[of, when][i, at]),
                "relative_volume": plain(gain.volume[of, when][i, at]),
            }
            for of in OFS
            for i, level in enumerate(LEVELS)
            for when in (BEFORE, AFTER)
        ],
    }


def _mm(value: float) -> str:
    return f"{1000 * value:.0f}" if np.isfinite(value) else "–"


def _two(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"
