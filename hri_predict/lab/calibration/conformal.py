"""From scores to radii: a learned scale, and factors on it from recordings it has not seen.

*Estimated*: the error of each window, joint and step is divided by the scale of a network that was
not fitted to its recording (``scale_fit``), times the scale's shape (``shape_of``). A factor is the
stated quantile of these ratios (of the largest over the joints, for the whole body), for each speed
class and step; recordings have equal weights, because windows of one resemble each other. This is
cross-conformal prediction (V. Vovk, Annals of Mathematics and AI 74 (2015) 9; R. Barber et al.,
"Predictive inference with the jackknife+", Annals of Statistics 49 (2021) 486) with recordings as
units. (The shape is fitted to the same errors as the factors: a few quantiles of thousands of
windows.) A speed class that occurs in fewer than ``LEAST_RECORDINGS`` recordings, and a joint that
fewer show, are not calibrated; physical limits are used there.

*Limits*: a scale that grows with past errors can exceed any possible error. When a person stopped,
radii reached 4 m at 1 s, but the largest error in a whole calibration was 2.3 m. So estimated radii
are limited, for each joint, speed class and step, to a quantile of the errors themselves. Its level
allows ``SPARE`` times fewer misses than the stated one: for 99 % it is the 99.9 % quantile. The
limits cost at most a tenth of the allowed misses (Boole's inequality).

*Guaranteed*: see ``zones.calibration``. Here the body's shape must not come from the
recordings that are ranked: it is the fixed growth ``body_shape``.
"""

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import Skeleton
from hri_predict.base.work.workers import Workers
from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS, of_equals
from hri_predict.lab.calibration.scale_fit import cross_scales
from hri_predict.lab.calibration.scores import HISTORY_STEPS, Scores, units
from hri_predict.lab.calibration.toward import with_toward
from hri_predict.zones.calibration import OFS, Calibration, Of, UsedRecording, needed, plain
from hri_predict.zones.motion_class import SPEED_CLASSES, speed_class
from hri_predict.zones.motion_ranges import SHORT_S, bounded, motion_ranges, short_ratio
from hri_predict.zones.scale_shape import KNOTS, ScaleShape
from hri_predict.zones.settings import LEVELS

SPARE = 10.0
SHAPE_LEVEL = 0.97
_SPREAD = 1.05
"""Minimum ratio between the sizes of a scale for a shape to be fitted."""
_LEAST_FACTOR = 0.01
"""Minimum factor: a person standing like a statue has errors of 0, but a scale must not be 0."""
_SOME = 20
"""Minimum number of values of a recording in a size range; fewer show nothing of the tail."""


def calibrate(
    *,
    scores: Sequence[Scores],
    predictor: str,
    settings: Mapping[str, Any],
    weights: str | None,
    rate_hz: float,
    skeleton: Skeleton,
    on_fit: Callable[[str], None] = lambda _: None,
    workers: Workers | None = None,
) -> Calibration:
    """Make a calibration; the same scores give the same calibration on the same machine.

    ``on_fit`` is called before each fit of the scale, which takes a minute or more; ``workers``
    fit (default: this process).

    Raises:
        ConfigError: there are fewer than ``LEAST_RECORDINGS`` recordings, or no joint is seen in
            that many.
    """
    by_name = units(scores)
    names = list(by_name)
    if len(names) < LEAST_RECORDINGS:
        raise ConfigError(
            f"--data: too few recordings ({len(names)}): windows of one resemble each other; give"
            f" {LEAST_RECORDINGS} at least ({needed(LEVELS[0])} for a guarantee of"
            f" {100 * LEVELS[0]:g} %)"
        )
    network, scale = cross_scales(scores, rate_hz, skeleton, on_fit=on_fit, workers=workers)
    error = np.concatenate([s.error_m for s in scores])
    scale_m = np.concatenate(scale)
    unit = np.concatenate([np.full(len(s.error_m), names.index(s.name)) for s in scores])
    fast = speed_class(np.concatenate([s.speed_m_s for s in scores]))
    shape = shape_of(error=error, scale_m=scale_m, fast=fast, unit=unit)
    ratio = error / shape.of(scale_m, fast)
    joints, group = _calibrated_joints(error, unit, skeleton)
    ratio[:, :, group < 0] = np.nan
    counts = np.array(
        [np.bincount(fast[unit == u], minlength=len(SPEED_CLASSES)) for u in range(len(names))]
    )
    estimated = _estimated(ratio, fast, unit)
    limits = limits_of(error=error, fast=fast, unit=unit, group=group)
    guaranteed = guaranteed_radii(
        error=error, fast=fast, unit=unit, group=group, joints=len(joints), rate_hz=rate_hz
    )
    made = Calibration(
        predictor=predictor,
        settings=settings,
        weights=weights,
        rate_hz=rate_hz,
        joints=joints,
        scale=network,
        shape=shape,
        estimated=estimated,
        limits=limits,
        guaranteed=guaranteed,
        recordings=tuple(
            UsedRecording(name=name, windows=tuple(map(int, row)), digest=scores[own[0]].digest)
            for (name, own), row in zip(by_name.items(), counts, strict=True)
        ),
        ranges=_ranges(
            scores=scores,
            ratio=over_radius(
                ratio=ratio,
                error=error,
                fast=fast,
                factors=estimated["joint"][-1],
                limit=limits["joint"][-1],
                group=group,
            ),
            group=group,
            joints=joints,
            rate_hz=rate_hz,
        ),
    )
    return with_toward(made, scores, skeleton)


def _calibrated_joints(
    error: Floats, unit: Ints, skeleton: Skeleton
) -> tuple[tuple[str, ...], Ints]:
    """The joints seen in enough recordings, without their side, and (J,) their index or -1."""
    shown: dict[str, set[int]] = {plain(name): set() for name in skeleton.joints}
    known = np.asarray(np.isfinite(error).any(1))  # (W, J)
    for joint, name in enumerate(skeleton.joints):
        shown[plain(name)].update(unit[known[:, joint]].tolist())
    joints = tuple(name for name, units in shown.items() if len(units) >= LEAST_RECORDINGS)
    if not joints:
        raise ConfigError(
            f"--data: no joint is seen in {LEAST_RECORDINGS} recordings or more; give recordings"
            f" that show the same joints"
        )
    of = [joints.index(n) if n in joints else -1 for n in map(plain, skeleton.joints)]
    return joints, np.array(of)


def shape_of(*, error: Floats, scale_m: Floats, fast: Ints, unit: Ints) -> ScaleShape:
    """Return how the quantile of error over scale depends on the scale's size.

    The values of a speed class and step are divided by their scale into ``KNOTS`` parts of equal
    weight, or fewer if there are few recordings. The quantile ``SHAPE_LEVEL`` of each part is used.
    A higher one would rest on too few errors per part; the factors provide the stated level.

    Args:
        error, scale_m: (W, H, J) metres, NaN where unknown.
        fast, unit: (W,) speed class and recording.
    """
    steps = error.shape[1]
    size = np.tile(np.geomspace(0.01, 1.0, KNOTS), (len(SPEED_CLASSES), steps, 1))
    factor = np.ones_like(size)
    for c in range(len(SPEED_CLASSES)):
        own = [(fast == c) & (unit == u) for u in np.unique(unit[fast == c])]
        parts = min(KNOTS, len(own) // LEAST_RECORDINGS)
        for step in range(steps if parts > 1 else 0):
            values = [(error[w, step].ravel(), scale_m[w, step].ravel()) for w in own]
            known = [(e[np.isfinite(e)], s[np.isfinite(e)]) for e, s in values]
            known = [(e, s) for e, s in known if e.size]
            sizes, factors = _tails(known, parts)
            if len(sizes) > 1 and sizes[-1] > _SPREAD * sizes[0]:
                size[c, step] = np.geomspace(sizes[0], sizes[-1], KNOTS)
                logs = np.interp(np.log(size[c, step]), np.log(sizes), np.log(factors))
                factor[c, step] = np.exp(logs)
    return ScaleShape(size, factor)


def _tails(known: Sequence[tuple[Floats, Floats]], parts: int) -> tuple[list[float], list[float]]:
    """The parts' middle sizes, ascending, and their quantiles of error over scale."""
    scale = np.concatenate([s for _, s in known])
    weight = np.concatenate([np.full(s.size, 1.0 / s.size) for _, s in known])
    order = np.argsort(scale)
    reached = np.cumsum(weight[order]) / len(known)
    inner = scale[order][np.searchsorted(reached, np.arange(1, parts) / parts)]
    edges = [0.0, *inner.tolist(), math.inf]
    sizes: list[float] = []
    factors: list[float] = []
    for low, high in itertools.pairwise(edges):
        inside = [(e, s, (s >= low) & (s < high)) for e, s in known]
        some = [(e[w] / s[w], float(np.median(s[w]))) for e, s, w in inside if w.sum() >= _SOME]
        if len(some) < LEAST_RECORDINGS:
            continue
        middle = float(np.median([m for _, m in some]))
        if not sizes or middle > sizes[-1]:
            sizes.append(middle)
            found = of_equals([ratio for ratio, _ in some], SHAPE_LEVEL)
            factors.append(min(max(found, _LEAST_FACTOR), 1.0 / _LEAST_FACTOR))
    return sizes, factors


def _estimated(ratio: Floats, fast: Ints, unit: Ints) -> dict[Of, Floats]:
    """Per question (L, 3, H): weighted quantiles of the ratios (W, H, J)."""
    steps = ratio.shape[1]
    tables = {of: np.full((len(LEVELS), len(SPEED_CLASSES), steps), np.inf) for of in OFS}
    for c in range(len(SPEED_CLASSES)):
        own = [ratio[(fast == c) & (unit == u)] for u in np.unique(unit[fast == c])]
        if len(own) < LEAST_RECORDINGS:
            continue
        for step in range(steps):
            joints = [r[:, step].ravel() for r in own]
            bodies = [_nanmax(r[:, step], 1) for r in own]
            for i, level in enumerate(LEVELS):
                tables["joint"][i, c, step] = of_equals(joints, level)
                tables["body"][i, c, step] = of_equals(bodies, level)
    # what holds the whole body holds each joint
    tables["body"] = np.maximum(tables["body"], tables["joint"])
    return tables


def limits_of(*, error: Floats, fast: Ints, unit: Ints, group: Ints) -> dict[Of, Floats]:
    """Per question (L, 3, G, H) metres; infinite where too few recordings show a joint.

    Args:
        error: (W, H, J) metres, NaN where unknown.
        fast, unit: (W,) speed class and recording.
        group: (J,) calibrated joint of each joint, -1 for others.
    """
    error = np.where(group >= 0, error, np.nan)
    joints, steps = int(group.max()) + 1, error.shape[1]
    tables = {of: np.full((len(LEVELS), len(SPEED_CLASSES), joints, steps), np.inf) for of in OFS}
    for c in range(len(SPEED_CLASSES)):
        own = [error[(fast == c) & (unit == u)] for u in np.unique(unit[fast == c])]
        for i, level in enumerate(LEVELS):
            rare = 1.0 - (1.0 - level) / SPARE
            for g in range(joints):
                of_joint = [
                    e[:, :, group == g] for e in own if np.isfinite(e[..., group == g]).any()
                ]
                if len(of_joint) < LEAST_RECORDINGS:
                    continue
                found = [of_equals([e[:, k].ravel() for e in of_joint], rare) for k in range(steps)]
                tables["joint"][i, c, g] = np.maximum.accumulate(found)
            most = tables["joint"][i, c]
            tables["body"][i, c] = most * _growth_for_bodies(own, most[group].T, rare)
    # of a higher level or a longer step none is smaller
    return {of: rising(np.maximum.accumulate(table, axis=0)) for of, table in tables.items()}


def _growth_for_bodies(own: Sequence[Floats], limit: Floats, rare: float) -> Floats:
    """(H,) factors on the joints' limits (H, J) that hold whole bodies equally often."""
    bodies = [_nanmax(error / limit, 2) for error in own]
    factors = [of_equals([b[:, k] for b in bodies], rare) for k in range(len(limit))]
    return np.maximum(1.0, factors)


def raised(limit: Floats, error: Floats, fast: Ints, group: Ints) -> Floats:
    """Raise the limits (L, 3, G, H) to at least the largest of other errors (W, H, J)."""
    result = limit.copy()
    steps = min(limit.shape[-1], error.shape[1])
    for c in range(len(SPEED_CLASSES)):
        own = error[fast == c][:, :steps]
        for g in range(limit.shape[2]):
            here = own[:, :, group == g]
            largest = np.where(np.isfinite(here), here, 0.0).max(axis=(0, 2), initial=0.0)
            result[:, c, g, :steps] = np.maximum(result[:, c, g, :steps], largest)
    return rising(result)


def guaranteed_radii(
    *, error: Floats, fast: Ints, unit: Ints, group: Ints, joints: int, rate_hz: float
) -> dict[Of, Floats]:
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
    """(H,) metres: a fixed growth of 1.6 m/s, the standard's walking speed."""
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


def rising(table: Floats) -> Floats:
    """The table with zones that never shrink as the horizon grows."""
    result: Floats = np.maximum.accumulate(table, axis=-1)
    return result


def _nanmax(values: Floats, axis: int) -> Floats:
    known = np.isfinite(values)
    largest = np.where(known, values, -np.inf).max(axis)
    return np.where(known.any(axis), largest, np.nan)


def over_radius(
    *, ratio: Floats, error: Floats, fast: Ints, factors: Floats, limit: Floats, group: Ints
) -> Floats:
    """(W, H, J) errors over the estimated radii of a level.

    Args:
        ratio, error: (W, H, J) errors over the scale, and errors in metres.
        fast: (W,) speed class.
        factors, limit: (3, H) and (3, G, H).
        group: (J,) calibrated joint of each joint, -1 for others.
    """
    most = np.where((group >= 0)[:, None], limit[:, group], np.inf).swapaxes(1, 2)  # (3, H, J)
    found: Floats = np.maximum(ratio / factors[fast][..., None], error / most[fast])
    return found


def _ranges(
    *, scores: Sequence[Scores], ratio: Floats, group: Ints, joints: Sequence[str], rate_hz: float
) -> dict[str, Any]:
    """Ranges of the calibration's motions; see ``motion_ranges.MotionRanges``.

    Args:
        ratio: (W, H, J) errors over the radii of the highest level.
        scores, group, joints, rate_hz: see ``calibrate``.
    """
    short = max(1, round(SHORT_S * rate_hz))
    judged = np.isfinite(ratio[:, :short])
    flat = np.where(judged, ratio[:, :short], 0.0).reshape(-1, len(group))
    wrong = short_ratio(flat, judged.reshape(flat.shape))
    found = motion_ranges(
        np.concatenate([s.history[:, -HISTORY_STEPS:] for s in scores]),
        np.concatenate([s.observed[:, -HISTORY_STEPS:] for s in scores]),
        rate_hz,
        ratio_short=float(np.nanmax(wrong)) if np.isfinite(wrong).any() else 1.0,
    )
    speed = {
        name: float(np.ceil(100 * np.nanmax(found.speed_m_s[group == g])) / 100)
        for g, name in enumerate(joints)
        if np.isfinite(found.speed_m_s[group == g]).any()
    }
    return bounded(speed, found.ratio_short)
