"""Verdict on past forecasts of all people with a new capture, in one call.

``PastForecasts.judge`` compares each kept forecast with the capture; a verdict holds the results
for the self-check: sums by band of horizons, and the errors for the learned scale.
"""

from math import ceil, inf, isnan, nan, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.machine.compiled import kernel, part
from hri_predict.people.ring_buffer import NEVER
from hri_predict.zones.learned_scale import LEAD_TOLERANCE_S, LEADS_S
from hri_predict.zones.motion_class import RESIDUAL_S
from hri_predict.zones.motion_ranges import SHORT_S, short_ratio
from hri_predict.zones.self_check.past_forecasts import (
    Judged,
    NewestCaptures,
    Ring,
    judge_all,
    mean_error,
)

MOST_ERROR_M = 1e6
"""Replacement for an error that is not finite, so that the sums stay finite."""
_NEVER = int(NEVER)


class Terms(NamedTuple):
    """Parameters for judging forecasts: (H,) the band of each step, the number of bands, and
    whether all joints of a body are judged together."""

    band: Ints
    bands: int
    whole_body: bool


Verdict = tuple[Floats, Floats, Floats, Floats]
"""For Q people and B bands: (6, Q, B) sums over judgements (their number; number with radii in use;
misses of the calibrated radii, of the bands' own factors, and of the factors in force when made;
mean errors); (Q,) residuals, NaN if unknown; (Q, 2, J) errors of the forecasts made ``LEADS_S``
ago, NaN if unknown; (Q,) the largest ``short_ratio``, minus infinity without any."""


def _by_arrays(ring: Ring, asked: NewestCaptures, terms: Terms, factor: Floats) -> Verdict:
    judged = judge_all(ring, asked)
    people = len(asked.slots)
    wrong = np.full(people, -np.inf)
    rows = np.flatnonzero(judged.lead_s <= SHORT_S + 1e-9)
    ratio = short_ratio(judged.ratio[rows], judged.claimed[rows])
    np.maximum.at(wrong, judged.person[rows], np.where(np.isnan(ratio), -np.inf, ratio))
    return (
        _sums(judged, terms, factor),
        _residuals(judged, people, ring.rate_hz),
        _errors(judged, people),
        wrong,
    )


def _sums(judged: Judged, terms: Terms, factor: Floats) -> Floats:
    own = factor[judged.person, terms.band[judged.step]]
    claimed = judged.claimed
    some = claimed.any(1)
    # the worst joint decides for the whole body
    ratio = judged.ratio.max(1, keepdims=True) if terms.whole_body else judged.ratio
    joints = 1 if terms.whole_body else np.maximum(claimed.sum(1), 1)
    used = ~np.isnan(judged.widened)
    values = [
        np.where(some, 1.0, 0.0),
        np.where(some & used, 1.0, 0.0),
        (ratio > 1.0).sum(1) / joints,
        (ratio > own[:, None]).sum(1) / joints,
        (ratio > judged.widened[:, None]).sum(1) / joints,
        np.where(some, np.minimum(mean_error(judged.errors, claimed), MOST_ERROR_M), 0.0),
    ]
    people = len(factor)
    cell = judged.person * terms.bands + terms.band[judged.step]
    member = (cell[:, None] == np.arange(people * terms.bands)).astype(np.float64)
    return (np.stack(values) @ member).reshape(len(values), people, terms.bands)


def _residuals(judged: Judged, people: int, rate_hz: float) -> Floats:
    """Return (Q,) error of the forecast made about ``RESIDUAL_S`` ago."""
    off = np.abs(judged.lead_s - RESIDUAL_S)
    # a forecast of a hardly seen person tells nothing about the forecasts to come
    used = judged.claimed.any(1)
    near = np.flatnonzero(used & (off <= 0.5 / rate_hz + 1e-9))
    near = near[np.argsort(-off[near], kind="stable")]  # the nearest last
    row_of = np.full(people, -1, np.intp)
    row_of[judged.person[near]] = near  # the last of several stays
    found = np.full(people, np.nan)
    person = np.flatnonzero(row_of >= 0)
    row = row_of[person]
    found[person] = mean_error(judged.errors[row], judged.seen[row])
    return found


def _errors(judged: Judged, people: int) -> Floats:
    """Return (Q, 2, J) each joint's error in the forecasts with ages nearest to ``LEADS_S``."""
    found = np.full((people, len(LEADS_S), judged.errors.shape[1]), np.nan)
    for i, (lead_s, within_s) in enumerate(zip(LEADS_S, LEAD_TOLERANCE_S, strict=True)):
        off = np.abs(judged.lead_s - lead_s)
        near = np.flatnonzero(off <= within_s + 1e-9)
        # the nearest last, and of two equally near the older, as in a calibration
        near = near[np.lexsort((judged.lead_s[near], -np.round(off[near], 9)))]
        error = np.where(judged.seen[near], judged.errors[near], np.nan)
        found[judged.person[near], i] = error  # the last of several stays
    return found


# -- the same as loops -----------------------------------------------------------------------------


def _by_loops(ring: Ring, asked: NewestCaptures, terms: Terms, factor: Floats) -> Verdict:
    people, joints = asked.observed.shape
    sums, wrong = np.zeros((6, people, terms.bands)), np.full(people, -inf)
    residual, errors = np.full(people, nan), np.full((people, 2, joints), nan)
    error, ratio = np.empty(joints), np.empty(joints)
    seen, claimed = np.empty(joints, np.bool_), np.empty(joints, np.bool_)
    row = error, ratio, seen, claimed
    own = np.empty(3)
    for p in range(people):
        slot, nearest = asked.slots[p], inf
        near, lead_of = (inf, inf), (0.0, 0.0)
        for at in range(ring.stamps.shape[1]):
            stamp = ring.stamps[slot, at]
            lead = 0.0
            if stamp != _NEVER:
                lead = (asked.capture_ns[p] - max(stamp, 0)) * 1e-9
            if not (lead > 0 and lead * ring.rate_hz <= ring.horizon_steps + 1e-6):
                continue
            step = _compare(ring, asked, (p, slot, at), row)
            b = terms.band[step]
            own[0], own[1], own[2] = 1.0, factor[p, b], ring.widened[slot, at, step]
            count = _count(row, own, terms.whole_body, sums[:, p, b])
            off = abs(lead - RESIDUAL_S)
            if count and off <= 0.5 / ring.rate_hz + 1e-9 and off <= nearest:
                nearest, residual[p] = off, _mean(error, seen)
            for i in range(2):
                off = abs(lead - LEADS_S[i])
                far = np.rint(off * 1e9)
                better = far < near[i] or (far == near[i] and lead >= lead_of[i])
                if off <= LEAD_TOLERANCE_S[i] + 1e-9 and better:
                    near = (far, near[1]) if i == 0 else (near[0], far)
                    lead_of = (lead, lead_of[1]) if i == 0 else (lead_of[0], lead)
                    for j in range(joints):
                        errors[p, i, j] = error[j] if seen[j] else nan
            if count and lead <= SHORT_S + 1e-9:
                for j in range(joints):
                    error[j] = ratio[j] if claimed[j] else inf
                wrong[p] = max(wrong[p], np.sort(error)[min(count // 2, joints - 1)])
    return sums, residual, errors, wrong


@part
def _compare(
    ring: Ring,
    asked: NewestCaptures,
    which: tuple[int, int, int],
    into: tuple[Floats, Floats, Bools, Bools],
) -> int:
    """Fill (J,) errors, ratios, seen and claimed for one row of ``Judged``; return the step."""
    p, slot, at = which
    error, ratio, seen, claimed = into
    knots, radii, truth = ring.knots, ring.radius, asked.truth
    lead = (asked.capture_ns[p] - max(ring.stamps[slot, at], 0)) * 1e-9
    steps, final = lead * ring.rate_hz, ring.horizon_steps - 1
    lower = min(max(int(steps), 0), final)
    on = min(max(steps - lower, 0.0), 1.0)
    step = min(max(ceil(steps - 1e-6) - 1, 0), final)
    for j in range(len(error)):
        square = 0.0
        for i in range(3):
            below, above = knots[slot, at, lower, j, i], knots[slot, at, lower + 1, j, i]
            apart = below + on * (above - below) - truth[p, j, i]
            square += apart * apart
        off = sqrt(square)
        error[j] = off if off < inf else inf
        radius = radii[slot, at, step, j]
        seen[j] = ring.seen[slot, at, j] and asked.observed[p, j]
        claimed[j] = seen[j] and radius != inf  # NaN is a claim, and missed
        ratio[j] = error[j] / radius if radius > 0 else inf
    return step


@part
def _count(
    row: tuple[Floats, Floats, Bools, Bools], factors: Floats, whole_body: bool, sums: Floats
) -> int:
    """Add one judgement to (6,) sums; return the number of claimed joints."""
    error, ratio, _, claimed = row
    count = 0
    bare = own = then = 0
    for j in range(len(error)):
        if claimed[j]:
            count += 1
            bare += ratio[j] > factors[0]
            own += ratio[j] > factors[1]
            then += ratio[j] > factors[2]
    if not count:
        return 0
    sums[0] += 1.0
    sums[1] += 0.0 if isnan(factors[2]) else 1.0
    sums[2] += min(bare, 1) if whole_body else bare / count
    sums[3] += min(own, 1) if whole_body else own / count
    sums[4] += min(then, 1) if whole_body else then / count
    sums[5] += min(_mean(error, claimed), MOST_ERROR_M)
    return count


@part
def _mean(error: Floats, which: Bools) -> float:
    total, count = 0.0, 0
    for j in range(len(error)):
        if which[j]:
            total += error[j]
            count += 1
    return total / count if count else nan


verdict = kernel(_by_loops, _by_arrays)
