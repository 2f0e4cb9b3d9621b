"""Shares of calibrated radii that count towards a robot: ``zones.toward``.

For an error e and a direction n, a share is the quantile of e.n over the radius, divided by that of
the length of e over the radius. So a radius holds errors in all directions as often as its share
holds them in a direction of the class. Directions are drawn at random, nearly horizontal and steep,
and along the forecast's motion, where errors are largest. Recordings have equal weights, as in
``conformal``.
"""

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import norm
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS, of_equals
from hri_predict.lab.calibration.scores import Scores, evidence_of, units
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.learned_scale import KNOT_STEPS
from hri_predict.zones.motion_class import SPEED_CLASSES, speed_class
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import LEVELS, CoverageSettings
from hri_predict.zones.toward import BINS, direction_class, ways

_FLAT = 0.3
"""Standard deviation of the vertical part of a nearly horizontal direction."""
_LEAST_SHARE = 0.2
_SOME = 30
"""Minimum number of values of a recording in a class; fewer show nothing of the tail."""


def with_toward(
    calibration: Calibration, scores: Sequence[Scores], skeleton: Skeleton
) -> Calibration:
    """The calibration with the shares of its radii by direction.

    Args:
        calibration: calibration of the scored predictor.
        scores: scores of the recordings that the calibration was made with.
        skeleton: skeleton of the forecasts.
    """
    by_name = [
        _joined([missed(scores[i], calibration, skeleton) for i in own])
        for own in units(scores).values()
    ]
    return replace(calibration, toward=toward_shares(by_name))


class Missed(NamedTuple):
    """The errors of one recording. W windows, H steps, J joints.

    Attributes:
        error_m: (W, H, J, 3) true less forecast places; NaN where not known.
        moved_m: (W, H, J, 3) forecast places less the places at the capture.
        radius_m: (L, W, H, J) at each of ``LEVELS``.
        fast: (W,) speed class.
    """

    error_m: Floats
    moved_m: Floats
    radius_m: Floats
    fast: Ints


def missed(scored: Scores, calibration: Calibration, skeleton: Skeleton) -> Missed:
    """The errors of one presence, and what the calibration states for them."""
    steps = min(scored.forecast.shape[1], calibration.steps)
    whole, evidence = replace(calibration, toward=None), evidence_of(scored)
    radius_m = [
        Radii(whole, CoverageSettings(level=level), skeleton, scored.forecast.shape[1]).of(
            scored.speed_m_s, evidence
        )[:, :steps]
        for level in LEVELS
    ]
    forecast, now = scored.forecast[:, :steps], scored.history[:, -1:]
    error = truth_at(scored, steps, calibration.rate_hz) - forecast
    error[~np.broadcast_to(scored.observed[:, -1:], error.shape[:-1])] = np.nan
    # of unknown speed is who has just appeared; zones take the largest share of all classes then
    known = ~np.isnan(scored.speed_m_s)
    return Missed(
        error[known],
        (forecast - now)[known],
        np.stack(radius_m)[:, known],
        speed_class(scored.speed_m_s[known]),
    )


def truth_at(scored: Scores, steps: int, rate_hz: float) -> Floats:
    """(W, H, J, 3) true places at the forecasts' steps, between captures; NaN where not known."""
    stamps, positions = scored.truth.stamps_ns, scored.truth.positions
    ahead_ns = np.round(np.arange(1, steps + 1) * 1e9 / rate_hz).astype(np.int64)
    at = scored.origin_ns[:, None] + ahead_ns
    after = stamps.searchsorted(at)
    inside = (after > 0) & (after < len(stamps))
    after = np.clip(after, 1, len(stamps) - 1)
    part = (at - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
    between = positions[after - 1] + part[..., None, None] * (
        positions[after] - positions[after - 1]
    )
    seen = scored.truth.observed[after - 1] & scored.truth.observed[after] & inside[..., None]
    return np.where(seen[..., None], between, np.nan)


def _joined(parts: Sequence[Missed]) -> Missed:
    error, moved, radius, fast = zip(*parts, strict=True)
    return Missed(
        np.concatenate(error),
        np.concatenate(moved),
        np.concatenate(radius, axis=1),
        np.concatenate(fast),
    )


def toward_shares(recordings: Sequence[Missed], seed: int = 0) -> Floats:
    """Return (L, 3, H, ``BINS``), 1 where too few recordings show a class."""
    rng = np.random.default_rng(seed)
    steps = recordings[0].error_m.shape[1]
    knots = [k - 1 for k in KNOT_STEPS if k <= steps]
    table = np.ones((len(LEVELS), len(SPEED_CLASSES), steps, BINS))
    for knot, step in enumerate(knots):
        drawn = [_drawn(each, step, rng) for each in recordings]
        until = knots[knot + 1] if knot + 1 < len(knots) else steps
        for level, stated in enumerate(LEVELS):
            for c in range(len(SPEED_CLASSES)):
                table[level, c, step:until] = _shares([d[c] for d in drawn], level, stated)
    # a step between two knots gets the larger share of both
    later = table.copy()
    for first, second in itertools.pairwise(knots):
        at_second = table[:, :, second : second + 1]
        later[:, :, first:second] = np.maximum(table[:, :, first:second], at_second)
    later[:, :, : knots[0]] = 1.0
    return later


_ByDirection = tuple[Floats, Floats, Ints]
"""(L, N) error over radius; (L, M) its component in a direction; (M,) direction classes."""


def _drawn(of: Missed, step: int, rng: np.random.Generator) -> list[_ByDirection]:
    """Return the errors in random directions, by speed class."""
    known = np.isfinite(of.error_m[:, step]).all(-1) & np.isfinite(of.radius_m[:, :, step]).all(0)
    found = []
    for c in range(len(SPEED_CLASSES)):
        window, joint = np.nonzero(known & (of.fast == c)[:, None])
        error, way = of.error_m[window, step, joint], ways(of.moved_m[window, step, joint])
        radius = of.radius_m[:, window, step, joint]
        flat = rng.normal(size=error.shape) * [1.0, 1.0, _FLAT]
        steep = rng.normal(size=error.shape) * [0.5, 0.5, 1.0]
        moving = norm(way) > 0.5
        directions = np.concatenate([flat, steep, way[moving]])
        directions /= np.maximum(norm(directions), 1e-9)[:, None]
        errors = np.concatenate([error, error, error[moving]])
        of_ways = np.concatenate([way, way, way[moving]])
        radii = np.concatenate([radius, radius, radius[:, moving]], axis=1)
        part = np.einsum("ni,ni->n", errors, directions) / radii
        found.append((norm(error) / radius, part, direction_class(directions, of_ways)))
    return found


def _shares(drawn: Sequence[_ByDirection], level: int, stated: float) -> Floats:
    """(``BINS``,) of one level, speed class and step."""
    result = np.ones(BINS)
    whole = [size[level] for size, _, _ in drawn if size.shape[1] >= _SOME]
    if len(whole) < LEAST_RECORDINGS:
        return result
    ball = of_equals(whole, stated)
    if not ball > 0.0:
        return result
    for which in range(BINS):
        parts = [part[level, of == which] for _, part, of in drawn]
        parts = [part for part in parts if part.size >= _SOME]
        if len(parts) >= LEAST_RECORDINGS:
            result[which] = np.clip(of_equals(parts, stated) / ball, _LEAST_SHARE, 1.0)
    return result
