"""Speed of each joint in the room, measured directly from the captures.

A joint's velocity is the least-squares slope of its captures over a span: the difference of two
captures would turn a centimetre of noise into half a metre per second. Two spans are tried:
``QUICK_S`` detects a joint that has just started to move, and ``SPAN_S`` is less sensitive to
noise. For a source too slow for these spans, the newest ``LEAST_CAPTURES`` are used, however long
they span.

**Noise**: white noise of standard deviation s gives each component of a slope the standard
deviation s / sqrt(sum (t - mean)^2). With 2 cm at 30 Hz over 0.2 s, that is 0.11 m/s, and the
fastest of 21 joints of a standing person appears to move at up to 0.5 m/s. So s is measured as
well: it is the residual of the captures after fitting a parabola, which fits any motion with
constant acceleration, as the median over the person's joints. (A kick moves few joints; noise moves
them all.) Speed within ``CERTAIN`` standard deviations is not *surely* speed. At most
``MOST_NOISE_M_S`` is attributed to noise: a noisier sensor makes people appear fast, never slow.
The quick span is used only where its noise is below that.
"""

from dataclasses import dataclass
from math import inf, isfinite, sqrt
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, known_median, plain_flags
from hri_predict.base.geometry import norm
from hri_predict.base.machine.compiled import kernel, part, plain
from hri_predict.people.snapshot import RecentCaptures

QUICK_S, SPAN_S = 0.1, 0.2
LEAST_CAPTURES = 3
LEAST_SPAN_S = 0.09
"""Minimum time spanned by the captures of a measurement: 0.1 s, less the jitter of the stamps."""
HELD_S = 0.15
"""Maximum time from a joint's last observation to the capture; its speed is unknown after that."""
CERTAIN = 4.0
"""Number of standard deviations: one of 63 components (21 joints) exceeds it by chance in one of
250 captures."""
MOST_NOISE_M_S = 0.5
_NOISE_CAPTURES = 5
_QUICK_S, _SPAN_S = QUICK_S + 1e-6, SPAN_S + 1e-6  # a span holds its ends


@dataclass(frozen=True, slots=True, eq=False)
class JointSpeeds:
    """Speeds in the room, m/s. P people, J joints.

    Attributes:
        speed: (P, J) the greater of both spans; 0 where not measured.
        surely: (P, J) the part of ``speed`` that noise does not explain.
        measured: (P, J).
    """

    speed: Floats
    surely: Floats
    measured: Bools


class _Slope(NamedTuple):
    speed: Floats  # (P, J) m/s
    deviation: Floats  # (P, J) of each component, for noise of 1 m
    measured: Bools  # (P, J)


def joint_speeds(captures: RecentCaptures, shown: Bools | None = None) -> JointSpeeds:
    """Return the speed of every joint.

    Args:
        captures: the newest captures.
        shown: (P, J) joints used to measure the sensor's noise: all except inferred ones, which
            repeat the noise of others. ``None``: all joints.
    """
    shows = np.ones(captures.observed.shape[::2], np.bool_) if shown is None else shown
    found = _measured(
        plain(captures.age_s), plain(captures.positions), plain_flags(captures.observed), shows
    )
    return JointSpeeds(*found)


Measured = tuple[Floats, Floats, Bools]
"""(P, J) each: ``speed``, ``surely`` and ``measured`` of ``JointSpeeds``."""


def _by_arrays(ages_s: Floats, positions: Floats, observed: Bools, shows: Bools) -> Measured:
    seen = observed & np.isfinite(positions).all(-1)
    if not seen.size:
        return _nothing(seen)
    ages = ages_s[..., None]  # (P, C, 1)
    place = np.where(seen[..., None], positions, 0.0)
    place = place - place[:, -1:]  # rounding: a slope of small numbers
    rank = seen[:, ::-1].cumsum(1)[:, ::-1]  # 1: the newest that was seen
    noisy = seen & shows[:, None]
    noise_m = _noise(place, ages, noisy & ((ages <= _SPAN_S) | (rank <= _NOISE_CAPTURES)))
    whole = _slope(place, ages, seen & ((ages <= _SPAN_S) | (rank <= LEAST_CAPTURES)))
    quick = _slope(place, ages, seen & (ages <= _QUICK_S))
    explained = CERTAIN * noise_m[:, None] * whole.deviation
    surely = whole.speed - np.minimum(explained, MOST_NOISE_M_S)
    explained = CERTAIN * noise_m[:, None] * quick.deviation
    useful = quick.measured & (explained <= MOST_NOISE_M_S)
    faster = np.where(useful, quick.speed, 0.0)
    surely = np.maximum(surely, np.where(useful, quick.speed - explained, 0.0))
    measured = whole.measured
    return (
        np.where(measured, np.maximum(whole.speed, faster), 0.0),
        np.where(measured, np.maximum(surely, 0.0), 0.0),
        measured,
    )


def _slope(place: Floats, ages: Floats, used: Bools) -> _Slope:
    """Return the slopes over the captures that are ``used`` (P, C, J)."""
    centred, spread, count = _centred(ages, used)
    velocity = (
        np.einsum("pcj,pcji->pji", centred, place) / np.where(spread > 0, spread, 1.0)[..., None]
    )
    age = np.where(used, ages, np.nan_to_num(ages, posinf=0.0))
    newest = np.where(used, age, np.inf).min(1)
    oldest = np.where(used, age, 0.0).max(1)
    measured = (count >= LEAST_CAPTURES) & (oldest - newest >= LEAST_SPAN_S) & (newest <= HELD_S)
    return _Slope(norm(velocity), 1.0 / np.sqrt(np.where(spread > 0, spread, np.inf)), measured)


def _noise(place: Floats, ages: Floats, used: Bools) -> Floats:
    """Return (P,) standard deviations of a component, metres; 0 for too few captures."""
    centred, spread, count = _centred(ages, used)
    square = np.where(used, centred**2, 0.0)
    square = np.where(used, square - (square.sum(1) / np.maximum(count, 1))[:, None], 0.0)
    safe = np.where(spread > 0, spread, 1.0)
    square = square - ((square * centred).sum(1) / safe)[:, None] * centred
    left = np.where(used[..., None], place, 0.0)
    mean = left.sum(1) / np.maximum(count, 1)[..., None]
    left = np.where(used[..., None], left - mean[:, None], 0.0)
    for basis in (centred, square):  # orthogonal to each other and to a constant
        size = (basis**2).sum(1)
        part = np.einsum("pcj,pcji->pji", basis, left) / np.where(size > 0, size, 1.0)[..., None]
        left = left - basis[..., None] * part[:, None]
    free = 3.0 * (count - 3)
    variance = np.where(free > 0, (left**2).sum((1, 3)) / np.maximum(free, 1), np.nan)
    enough: Bools = np.any(free > 0, axis=1)
    known = np.where(enough[:, None], variance, 0.0)
    return np.sqrt(known_median(known))


def _centred(ages: Floats, used: Bools) -> tuple[Floats, Floats, Floats]:
    """Return (P, C, J) times relative to the mean of the used ones, 0 elsewhere; the sum of their
    squares; their number."""
    time = np.where(used, -np.where(np.isfinite(ages), ages, 0.0), 0.0)
    count = used.sum(1)
    middle = time.sum(1) / np.maximum(count, 1)
    centred = np.where(used, time - middle[:, None], 0.0)
    return centred, (centred**2).sum(1), count


def _nothing(seen: Bools) -> Measured:
    shape = (seen.shape[0], seen.shape[2])
    return np.zeros(shape), np.zeros(shape), np.zeros(shape, np.bool_)


# -- the same as loops -----------------------------------------------------------------------------


@part
def _choose(ages: Floats, positions: Floats, observed: Bools, into: tuple[Floats, Bools]) -> None:
    """Fill in a joint's positions (C, 3) relative to its last one, and the captures (3, C) to use
    for noise and for both spans."""
    place, used = into
    rank, last = 0, len(ages) - 1
    for c in range(last, -1, -1):
        seen = observed[c]
        for i in range(3):
            seen = seen and isfinite(positions[c, i])
        for i in range(3):
            place[c, i] = positions[c, i] if seen else 0.0
        rank += seen
        used[0, c] = seen and (ages[c] <= _SPAN_S or rank <= _NOISE_CAPTURES)
        used[1, c] = seen and (ages[c] <= _SPAN_S or rank <= LEAST_CAPTURES)
        used[2, c] = seen and ages[c] <= _QUICK_S
    for i in range(3):
        newest = place[last, i]
        for c in range(len(ages)):
            place[c, i] -= newest


@part
def _slope_of(ages: Floats, place: Floats, used: Bools) -> tuple[float, float, float]:
    """Return one joint's speed, its standard deviation, and 1 if it was measured."""
    count, middle = 0, 0.0
    newest, oldest = inf, 0.0
    for c in range(len(ages)):
        if used[c]:
            count += 1
            middle -= ages[c]
            newest, oldest = min(newest, ages[c]), max(oldest, ages[c])
    if count < LEAST_CAPTURES or oldest - newest < LEAST_SPAN_S or newest > HELD_S:
        return 0.0, 0.0, 0.0
    middle /= count
    spread = x = y = z = 0.0
    for c in range(len(ages)):
        if used[c]:
            centred = -ages[c] - middle
            spread += centred * centred
            x += centred * place[c, 0]
            y += centred * place[c, 1]
            z += centred * place[c, 2]
    x, y, z = x / spread, y / spread, z / spread
    return sqrt(x * x + y * y + z * z), 1.0 / sqrt(spread), 1.0


@part
def _variance_of(ages: Floats, place: Floats, used: Bools, kept: Floats) -> float:
    """Return one joint's residual after fitting a parabola, square metres; -1: too few captures."""
    n, middle = 0, 0.0
    for c in range(len(ages)):
        if used[c]:
            kept[0, n] = -ages[c]
            middle -= ages[c]
            for i in range(3):
                kept[2 + i, n] = place[c, i]
            n += 1
    if n <= 3:
        return -1.0
    middle /= n
    mean = spread = tilt = 0.0
    for c in range(n):
        kept[0, c] -= middle
        kept[1, c] = kept[0, c] * kept[0, c]
        spread += kept[1, c]
    mean = spread / n
    for c in range(n):
        kept[1, c] -= mean
        tilt += kept[1, c] * kept[0, c]
    tilt /= spread if spread > 0.0 else 1.0
    for c in range(n):
        kept[1, c] -= tilt * kept[0, c]
    total = 0.0
    for i in range(2, 5):
        mean = 0.0
        for c in range(n):
            mean += kept[i, c]
        mean /= n
        for c in range(n):
            kept[i, c] -= mean
        for b in range(2):  # orthogonal to each other and to a constant
            size = shared = 0.0
            for c in range(n):
                size += kept[b, c] * kept[b, c]
                shared += kept[b, c] * kept[i, c]
            shared /= size if size > 0.0 else 1.0
            for c in range(n):
                kept[i, c] -= kept[b, c] * shared
        for c in range(n):
            total += kept[i, c] * kept[i, c]
    return total / (3.0 * (n - 3))


def _by_loops(ages_s: Floats, positions: Floats, observed: Bools, shows: Bools) -> Measured:
    people, captures, joints = observed.shape
    speed, surely = np.zeros((people, joints)), np.zeros((people, joints))
    measured = np.zeros((people, joints), np.bool_)
    place, used = np.empty((captures, 3)), np.empty((3, captures), np.bool_)
    kept, slopes, known = np.empty((5, captures)), np.empty((joints, 6)), np.empty(joints)
    for p in range(people):
        count = 0
        for j in range(joints):
            _choose(ages_s[p], positions[p, :, j], observed[p, :, j], (place, used))
            slopes[j, 0], slopes[j, 1], slopes[j, 2] = _slope_of(ages_s[p], place, used[1])
            slopes[j, 3], slopes[j, 4], slopes[j, 5] = _slope_of(ages_s[p], place, used[2])
            if shows[p, j]:
                variance = _variance_of(ages_s[p], place, used[0], kept)
                if variance >= 0.0:
                    known[count] = variance
                    count += 1
        noise_m = 0.0
        if count:
            rising = np.sort(known[:count])
            noise_m = sqrt((rising[(count - 1) // 2] + rising[count // 2]) / 2)
        for j in range(joints):
            if slopes[j, 2] == 0.0:
                continue
            measured[p, j] = True
            fast = slopes[j, 0]
            sure = fast - min(CERTAIN * noise_m * slopes[j, 1], MOST_NOISE_M_S)
            explained = CERTAIN * noise_m * slopes[j, 4]
            if slopes[j, 5] != 0.0 and explained <= MOST_NOISE_M_S:
                fast, sure = max(fast, slopes[j, 3]), max(sure, slopes[j, 3] - explained)
            speed[p, j], surely[p, j] = fast, max(sure, 0.0)
    return speed, surely, measured


_measured = kernel(_by_loops, _by_arrays)
