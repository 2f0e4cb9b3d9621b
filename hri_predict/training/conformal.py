"""From scores to radii: split conformal quantiles, and what few recordings leave open.

*Estimated*: of every motion class, joint and step the quantile of rank ceil((n + 1) l) over all its
windows, ``LEAST_RADIUS_M`` at least; the body's radii are those times one factor per class and
step, the same quantile of the largest ratio over the joints. But windows of one recording resemble
each other, and a new recording is unlike all of them. So each recording is left out in turn, and
the radii of a level and speed class are multiplied by the factor (1 at least) with which those of
the others would have held the stated share of what was left out, each recording weighing the same:
cross-conformal prediction (V. Vovk, Annals of Mathematics and AI 74 (2015) 9; R. Barber et al.,
"Predictive inference with the jackknife+", Annals of Statistics 49 (2021) 486) with recordings for
folds. A class that fewer than ``LEAST_RECORDINGS``
recordings show is not calibrated, and physical limits serve there.

*Guaranteed*: see ``risk.calibration``. Here the body's shape must not come from the recordings that
are ranked: it is the fixed growth ``body_shape``.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hri_predict.errors import ConfigError
from hri_predict.risk.calibration import OFS, Calibration, UsedRecording, needed, plain
from hri_predict.risk.motion_class import CLASSES, GRADES, SPEED_CLASSES, motion_class, speed_class
from hri_predict.risk.motion_ranges import SHORT_S, motion_ranges, short_ratio
from hri_predict.risk.settings import LEVELS
from hri_predict.scene import Floats
from hri_predict.skeleton import Skeleton
from hri_predict.training.zone_scores import HISTORY_STEPS, Scores, units

LEAST_RADIUS_M = 0.02
"""Joints that hardly move would scale everybody else by their millimetres."""
LEAST_RECORDINGS = 4
Ints = NDArray[np.intp]

_BY_SPEED = np.split(np.arange(len(CLASSES)), len(SPEED_CLASSES))
"""The motion classes of each speed class: too few recordings show one alone for a factor."""


def calibrate(
    scores: Sequence[Scores],
    predictor: str,
    settings: Mapping[str, Any],
    weights: str | None,
    rate_hz: float,
    skeleton: Skeleton,
) -> Calibration:
    """Make a calibration; the same scores give the same one.

    Raises:
        ConfigError: there are too few recordings for anything.
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
    surprise = np.concatenate([s.surprise_m for s in scores])
    thresholds = _terciles(speed, surprise)
    kind = motion_class(speed, surprise, thresholds)
    joints = tuple(dict.fromkeys(plain(name) for name in skeleton.joints))
    group = np.array([joints.index(plain(name)) for name in skeleton.joints])
    counts = np.array(
        [np.bincount(kind[unit == u], minlength=len(CLASSES)) for u in range(len(names))]
    )
    windows = _Windows(error, kind, unit, group)
    estimated = _inflated(windows, _estimated(windows))
    guaranteed = _guaranteed(error, speed_class(speed), unit, group, len(joints), rate_hz)
    ranges = _ranges(scores, estimated["joint"][-1], kind, error, group, joints, rate_hz, skeleton)
    return Calibration(
        predictor,
        settings,
        weights,
        rate_hz,
        joints,
        thresholds,
        estimated,
        guaranteed,
        tuple(
            UsedRecording(name=name, windows=tuple(map(int, row)), digest=scores[own[0]].digest)
            for (name, own), row in zip(by_name.items(), counts, strict=True)
        ),
        ranges,
    )


def _terciles(speed: Floats, surprise: Floats) -> Floats:
    """(3, 2) thresholds of surprise in each speed class; those of all where a class is empty.

    Where no surprise is known (a horizon of less than ``SURPRISE_S``), any one is surprising.
    """
    fast = speed_class(speed)
    found = []
    for wanted in range(len(SPEED_CLASSES)):
        own = surprise[(fast == wanted) & np.isfinite(surprise)]
        known = own if own.size else surprise[np.isfinite(surprise)]
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
    """The radii times what makes those of the others hold each recording; see the module."""
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
    # whoever holds the whole body holds each joint, and 99 % hold 95 %
    result["body"] = np.maximum(result["body"], result["joint"])
    return {of: np.maximum.accumulate(table, axis=0) for of, table in result.items()}


def _ratios(windows: _Windows, table: Floats, of: str) -> Floats:
    """Errors over the radii (C, G, H) of a table: (W, H, J) of joints, (W, H) of the body."""
    radius = table[windows.kind][:, windows.group].swapaxes(1, 2)
    ratio = np.where(np.isfinite(radius), windows.error / radius, np.nan)
    return ratio if of == "joint" else _nanmax(ratio, 2)


def _of_equals(samples: Sequence[Floats], level: float) -> float:
    """The quantile of several samples that weigh the same, whatever their sizes; 1 of none."""
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
    error: Floats, fast: Ints, unit: Ints, group: Ints, joints: int, rate_hz: float
) -> dict[str, Floats]:
    """Per question (L, 3, G, H): ranks of the recordings' largest errors."""
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
    """(H,) a growth that is known beforehand: 1.6 m/s, the standard's walking speed."""
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
    """(L,) the values of rank ceil((n + 1) l) of n finite ones, or the largest; inf of none."""
    known = np.sort(values[np.isfinite(values)])
    if not known.size:
        return np.full(len(LEVELS), np.inf)
    ranks = [min(math.ceil((known.size + 1) * level - 1e-9), known.size) for level in LEVELS]
    return np.asarray(known[np.array(ranks) - 1])


def rising(table: Floats) -> Floats:
    """A zone never shrinks with the horizon."""
    result: Floats = np.maximum.accumulate(table, axis=-1)
    return result


def _nanmax(values: Floats, axis: int) -> Floats:
    known = np.isfinite(values)
    largest = np.where(known, values, -np.inf).max(axis)
    return np.where(known.any(axis), largest, np.nan)


def _ranges(
    scores: Sequence[Scores],
    radius: Floats,
    kind: Ints,
    error: Floats,
    group: Ints,
    joints: Sequence[str],
    rate_hz: float,
    skeleton: Skeleton,
) -> dict[str, Any]:
    """What bodies and motions of the calibration were like; see ``self_check.MotionRanges``."""
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
        float(np.nanmax(wrong)) if np.isfinite(wrong).any() else 1.0,
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
