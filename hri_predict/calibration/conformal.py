"""From scores to radii: split conformal quantiles, widened because recordings are few.

*Estimated*: for every motion class, joint and step the quantile of rank ceil((n + 1) l) over all
windows, at least ``LEAST_RADIUS_M``. The body's radii are these times one factor per class and
step: the same quantile of the largest ratio over the joints. But windows of one recording resemble
each other, and a new recording differs from all of them. So each recording is left out in turn.
The radii of a level and speed class are multiplied by the factor (at least 1) with which radii from
the other recordings would have held the stated share of the one left out; recordings have equal
weights. This is cross-conformal prediction (V. Vovk, Annals of Mathematics and AI 74 (2015) 9; R.
Barber et al., "Predictive inference with the jackknife+", Annals of Statistics 49 (2021) 486) with
recordings as folds. A class that occurs in fewer than ``LEAST_RECORDINGS`` recordings is not
calibrated; physical limits are used there.

*Guaranteed*: see ``risk.zones.radii``. Here the body's shape must not come from the recordings that
are ranked: it is the fixed growth ``body_shape``.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from hri_predict.arrays import Floats, Ints
from hri_predict.calibration.scores import HISTORY_STEPS, Scores, units
from hri_predict.errors import ConfigError
from hri_predict.risk.settings import LEVELS
from hri_predict.risk.zones.motion_class import (
    CLASSES,
    GRADES,
    SPEED_CLASSES,
    motion_class,
    speed_class,
)
from hri_predict.risk.zones.motion_ranges import SHORT_S, motion_ranges, short_ratio
from hri_predict.risk.zones.radii import OFS, Calibration, UsedRecording, needed, plain
from hri_predict.skeleton import Skeleton

LEAST_RADIUS_M = 0.02
"""Lower bound: joints that hardly move would make the body's factor huge."""
LEAST_RECORDINGS = 4

_BY_SPEED = np.split(np.arange(len(CLASSES)), len(SPEED_CLASSES))
"""The motion classes of each speed class: single ones occur in too few recordings."""


def calibrate(
    *,
    scores: Sequence[Scores],
    predictor: str,
    settings: Mapping[str, Any],
    weights: str | None,
    rate_hz: float,
    skeleton: Skeleton,
) -> Calibration:
    """Make a calibration; the same scores give the same calibration.

    Raises:
        ConfigError: there are fewer than ``LEAST_RECORDINGS`` recordings.
    """
    by_name = units(scores)
    names = list(by_name)
    if len(names) < LEAST_RECORDINGS:
        raise ConfigError(
            f"--data: too few recordings ({len(names)}): windows of one resemble each other; give"
            f" {LEAST_RECORDINGS} at least ({needed(LEVELS[0])} for a guarantee of"
            f" {100 * LEVELS[0]:g} %)"
        )
    error = np.concatenate([s.error_m for s in scores])
    unit = np.concatenate([np.full(len(s.error_m), names.index(s.name)) for s in scores])
    speed = np.concatenate([s.speed_m_s for s in scores])
    residual = np.concatenate([s.residual_m for s in scores])
    thresholds = _terciles(speed, residual)
    kind = motion_class(speed, residual, thresholds)
    joints = tuple(dict.fromkeys(plain(name) for name in skeleton.joints))
    group = np.array([joints.index(plain(name)) for name in skeleton.joints])
    counts = np.array(
        [np.bincount(kind[unit == u], minlength=len(CLASSES)) for u in range(len(names))]
    )
    windows = _Windows(error, kind, unit, group)
    estimated = _inflated(windows, _estimated(windows))
    guaranteed = _guaranteed(
        error=error,
        fast=speed_class(speed),
        unit=unit,
        group=group,
        joints=len(joints),
        rate_hz=rate_hz,
    )
    ranges = _ranges(
        scores=scores,
        radius=estimated["joint"][-1],
        kind=kind,
        error=error,
        group=group,
        joints=joints,
        rate_hz=rate_hz,
        skeleton=skeleton,
    )
    return Calibration(
        predictor=predictor,
        settings=settings,
        weights=weights,
        rate_hz=rate_hz,
        joints=joints,
        thresholds_m=thresholds,
        estimated=estimated,
        guaranteed=guaranteed,
        recordings=tuple(
            UsedRecording(name=name, windows=tuple(map(int, row)), digest=scores[own[0]].digest)
            for (name, own), row in zip(by_name.items(), counts, strict=True)
        ),
        ranges=ranges,
    )


def _terciles(speed: Floats, residual: Floats) -> Floats:
    """(3, 2) thresholds of residual in each speed class; an empty class takes those of all.

    All are 0 where no residual is known (a horizon shorter than ``RESIDUAL_S``).
    """
    fast = speed_class(speed)
    found = []
    for wanted in range(len(SPEED_CLASSES)):
        own = residual[(fast == wanted) & np.isfinite(residual)]
        known = own if own.size else residual[np.isfinite(residual)]
        shares = np.arange(1, len(GRADES)) / len(GRADES)
        found.append(np.quantile(known, shares) if known.size else np.zeros(len(shares)))
    return np.round(np.array(found), 4)


class _Windows:
    """All windows: error (W, H, J), motion class and recording (W,), group of each joint (J,)."""

    def __init__(self, error: Floats, kind: Ints, unit: Ints, group: Ints) -> None:
        self.error, self.kind, self.unit, self.group = error, kind, unit, group
        self.joints = int(group.max()) + 1

    def of(self, chosen: Any) -> "_Windows":
        """Some of them."""
        return _Windows(self.error[chosen], self.kind[chosen], self.unit[chosen], self.group)


def _estimated(windows: _Windows, least: int = LEAST_RECORDINGS) -> dict[str, Floats]:
    """Per question (L, C, G, H): pooled quantiles of the classes that ``least`` recordings show."""
    steps, group = windows.error.shape[1], windows.group
    shape = (len(LEVELS), len(CLASSES), windows.joints, steps)
    tables = {of: np.full(shape, np.inf) for of in OFS}
    for c in range(len(CLASSES)):
        own = windows.of(windows.kind == c)
        if len(np.unique(own.unit)) < least:
            continue
        for step in range(steps):
            at = own.error[:, step]
            by_joint = np.stack(
                [quantiles(at[:, group == g].ravel()) for g in range(windows.joints)], axis=1
            )
            radius = np.maximum(by_joint, LEAST_RADIUS_M)  # (L, G)
            tables["joint"][:, c, :, step] = radius
            for i in range(len(LEVELS)):
                factor = quantiles(_nanmax(at / radius[i, group], 1))[i]
                tables["body"][i, c, :, step] = factor * radius[i]
    return {of: rising(table) for of, table in tables.items()}


def _inflated(windows: _Windows, tables: dict[str, Floats]) -> dict[str, Floats]:
    """The radii times the cross-conformal factors; see the module."""
    result = {of: table.copy() for of, table in tables.items()}
    left_out = [windows.unit == unit for unit in np.unique(windows.unit)]
    others = [_estimated(windows.of(~mine), LEAST_RECORDINGS - 1) for mine in left_out]
    own = [windows.of(mine) for mine in left_out]
    for of in OFS:
        for i, level in enumerate(LEVELS):
            ratios = [_ratios(w, radii[of][i], of) for w, radii in zip(own, others, strict=True)]
            for like in _BY_SPEED:
                chosen = [
                    r[np.isin(w.kind, like)].ravel() for w, r in zip(own, ratios, strict=True)
                ]
                result[of][i, like] *= max(1.0, _of_equals(chosen, level))
    # what holds the whole body holds each joint, and a zone for 99 % holds that for 95 %
    result["body"] = np.maximum(result["body"], result["joint"])
    return {of: np.maximum.accumulate(table, axis=0) for of, table in result.items()}


def _ratios(windows: _Windows, table: Floats, of: str) -> Floats:
    """Errors divided by radii (C, G, H): (W, H, J) for joints, (W, H) for the body."""
    radius = table[windows.kind][:, windows.group].swapaxes(1, 2)
    ratio = np.where(np.isfinite(radius), windows.error / radius, np.nan)
    return ratio if of == "joint" else _nanmax(ratio, 2)


def _of_equals(samples: Sequence[Floats], level: float) -> float:
    """The quantile of several samples with equal weights, whatever their sizes; 1 if empty."""
    known = [values[np.isfinite(values)] for values in samples]
    known = [values for values in known if values.size]
    if not known:
        return 1.0
    values = np.concatenate(known)
    weight = np.concatenate([np.full(v.size, 1.0 / v.size) for v in known])
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) / len(known)
    return float(values[order][min(int(reached.searchsorted(level - 1e-12)), values.size - 1)])


def _guaranteed(
    *, error: Floats, fast: Ints, unit: Ints, group: Ints, joints: int, rate_hz: float
) -> dict[str, Floats]:
    """Per question (L, 3, G, H): radii by the rank of the recordings' largest errors."""
    steps = error.shape[1]
    shape = body_shape(np.arange(1, steps + 1) / rate_hz)
    tables = {of: np.full((len(LEVELS), len(SPEED_CLASSES), joints, steps), np.inf) for of in OFS}
    for s in range(len(SPEED_CLASSES)):
        chosen = fast == s
        present = np.unique(unit[chosen])
        largest = [_largest_of(error[chosen & (unit == u)], group, joints) for u in present]
        if not largest:
            continue
        by_unit = np.stack(largest)  # (n, G, H), NaN where a recording knows nothing
        body = np.where(np.isnan(by_unit), -np.inf, by_unit).max(1) / shape  # (n, H)
        body = np.where(np.isfinite(body), body, np.nan)
        for i, level in enumerate(LEVELS):
            tables["joint"][i, s] = _ranked(by_unit, level)
            tables["body"][i, s] = _ranked(body, level) * shape
    return {of: rising(table) for of, table in tables.items()}


def body_shape(times_s: Floats) -> Floats:
    """(H,) metres: a growth fixed beforehand at 1.6 m/s, the standard's walking speed."""
    return 1.6 * times_s


def _largest_of(error: Floats, group: Ints, joints: int) -> Floats:
    """(G, H) largest error of a recording's windows."""
    by_joint = _nanmax(error, 0)  # (H, J)
    return np.stack([_nanmax(by_joint[:, group == g], 1) for g in range(joints)])


def _ranked(values: Floats, level: float) -> Floats:
    """The value of rank ceil((n + 1) level) along axis 0; infinite if there are too few."""
    known = np.isfinite(values).sum(0)
    rank = np.ceil((known + 1) * level - 1e-9).astype(np.intp)
    ordered = np.sort(np.where(np.isfinite(values), values, np.inf), axis=0)
    last = np.minimum(rank, len(ordered)) - 1
    found = np.take_along_axis(ordered, np.maximum(last, 0)[None], axis=0)[0]
    return np.where((known > 0) & (rank <= known), found, np.inf)


def quantiles(values: Floats) -> Floats:
    """(L,) the values of rank ceil((n + 1) l) among n finite ones, at most the largest; or inf."""
    known = np.sort(values[np.isfinite(values)])
    if not known.size:
        return np.full(len(LEVELS), np.inf)
    ranks = [min(math.ceil((known.size + 1) * level - 1e-9), known.size) for level in LEVELS]
    return np.asarray(known[np.array(ranks) - 1])


def rising(table: Floats) -> Floats:
    """The table with zones that never shrink as the horizon grows."""
    result: Floats = np.maximum.accumulate(table, axis=-1)
    return result


def _nanmax(values: Floats, axis: int) -> Floats:
    known = np.isfinite(values)
    largest = np.where(known, values, -np.inf).max(axis)
    return np.where(known.any(axis), largest, np.nan)


def _ranges(
    *,
    scores: Sequence[Scores],
    radius: Floats,
    kind: Ints,
    error: Floats,
    group: Ints,
    joints: Sequence[str],
    rate_hz: float,
    skeleton: Skeleton,
) -> dict[str, Any]:
    """Ranges of the calibration's bodies and motions; see ``motion_ranges.MotionRanges``."""
    short = max(1, round(SHORT_S * rate_hz))
    claimed = radius[kind][:, group, :short].swapaxes(1, 2)  # (W, short, J)
    judged = np.isfinite(claimed) & np.isfinite(error[:, :short])
    ratio = np.where(judged, error[:, :short] / claimed, 0.0).reshape(-1, len(group))
    wrong = short_ratio(ratio, judged.reshape(ratio.shape))
    found = motion_ranges(
        np.concatenate([s.history[:, -HISTORY_STEPS:] for s in scores]),
        np.concatenate([s.observed[:, -HISTORY_STEPS:] for s in scores]),
        rate_hz,
        skeleton.parents,
        ratio_short=float(np.nanmax(wrong)) if np.isfinite(wrong).any() else 1.0,
    )
    speed = {
        name: float(np.ceil(100 * found.speed_m_s[group == g].max()) / 100)
        for g, name in enumerate(joints)
        if np.isfinite(found.speed_m_s[group == g]).all()
    }
    bone = {}
    for g, name in enumerate(joints):
        low, high = found.bone_m[group == g, 0].min(), found.bone_m[group == g, 1].max()
        if np.isfinite(high) and np.isfinite(low):
            bone[name] = [float(np.floor(1000 * low) / 1000), float(np.ceil(1000 * high) / 1000)]
    return {"speed_m_s": speed, "bone_m": bone, "ratio_short": max(found.ratio_short, 1e-3)}
