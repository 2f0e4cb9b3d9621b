"""How fast each joint moves in the room, measured from the captures themselves.

A joint's velocity is the least-squares slope of its captures over a span: the difference of two
captures would turn a centimetre of noise into half a metre per second. Two spans are tried:
``QUICK_S`` finds a joint that has just set out, ``SPAN_S`` is less disturbed by noise. Of a source
too slow for that, the newest ``LEAST_CAPTURES`` count, whatever time they take.

**Noise**: white noise of standard deviation s gives each component of a slope the standard
deviation s / sqrt(sum (t - mean)^2). With 2 cm at 30 Hz over 0.2 s that is 0.11 m/s, and the
fastest of 21 joints of a person who stands looks as fast as 0.5 m/s. So s is measured as well: by
what remains of the captures beside a parabola, which holds every motion with constant acceleration,
as the median over the person's joints. (A kick moves few joints; noise moves them all.) What
``CERTAIN`` standard deviations explain is not *surely* speed. At most ``MOST_NOISE_M_S`` is
explained so: a sensor that is noisier makes people look fast, never slow. The quick span is used
only where its noise is below that.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hri_predict.arrays import Bools, Floats, known_median
from hri_predict.geometry import norm
from hri_predict.people.snapshot import RecentCaptures

QUICK_S, SPAN_S = 0.1, 0.2
LEAST_CAPTURES = 3
LEAST_SPAN_S = 0.09
"""Captures of a shorter time measure nothing: 0.1 s, less the jitter of their stamps."""
HELD_S = 0.15
"""A joint that was last seen longer ago than this before the capture has no present speed."""
CERTAIN = 4.0
"""Standard deviations: of 63 components (21 joints), one in 250 captures exceeds it by chance."""
MOST_NOISE_M_S = 0.5
_NOISE_CAPTURES = 5


@dataclass(frozen=True, slots=True, eq=False)
class JointSpeeds:
    """Speeds in the room, m/s. P people, J joints.

    Attributes:
        speed: (P, J) the greater of both spans; 0 where not measured.
        surely: (P, J) the part of it that noise does not explain.
        measured: (P, J).
    """

    speed: Floats
    surely: Floats
    measured: Bools

    def only(self, joints: Bools) -> "JointSpeeds":
        """The same, but only some joints (J,) count as measured."""
        return JointSpeeds(self.speed * joints, self.surely * joints, self.measured & joints)


class _Slope(NamedTuple):
    speed: Floats  # (P, J) m/s
    deviation: Floats  # (P, J) of each component, for noise of 1 m
    measured: Bools  # (P, J)


def joint_speeds(captures: RecentCaptures, delivered: Bools | None = None) -> JointSpeeds:
    """How fast every joint is.

    Args:
        captures: the newest ones.
        delivered: (J,) the joints that show the sensor's noise: not the inferred ones, which repeat
            that of others. ``None``: all.
    """
    seen = captures.observed & np.isfinite(captures.positions).all(-1)
    if not seen.size:
        return _nothing(seen)
    ages = captures.age_s[..., None]  # (P, C, 1)
    place = np.where(seen[..., None], captures.positions, 0.0)
    place = place - place[:, -1:]  # rounding: a slope of small numbers
    rank = seen[:, ::-1].cumsum(1)[:, ::-1]  # 1: the newest that was seen
    noisy = seen if delivered is None else seen & delivered
    noise_m = _noise(place, ages, noisy & ((ages <= SPAN_S + 1e-6) | (rank <= _NOISE_CAPTURES)))
    whole = _slope(place, ages, seen & ((ages <= SPAN_S + 1e-6) | (rank <= LEAST_CAPTURES)))
    quick = _slope(place, ages, seen & (ages <= QUICK_S + 1e-6))
    explained = CERTAIN * noise_m[:, None] * whole.deviation
    surely = whole.speed - np.minimum(explained, MOST_NOISE_M_S)
    explained = CERTAIN * noise_m[:, None] * quick.deviation
    useful = quick.measured & (explained <= MOST_NOISE_M_S)
    faster = np.where(useful, quick.speed, 0.0)
    surely = np.maximum(surely, np.where(useful, quick.speed - explained, 0.0))
    measured = whole.measured
    return JointSpeeds(
        np.where(measured, np.maximum(whole.speed, faster), 0.0),
        np.where(measured, np.maximum(surely, 0.0), 0.0),
        measured,
    )


def _slope(place: Floats, ages: Floats, used: Bools) -> _Slope:
    """Slopes over the captures that are ``used`` (P, C, J)."""
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
    """(P,) standard deviation of a component, metres; 0 where there are too few captures."""
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
    """(P, C, J) times from the mean of those used, 0 elsewhere; their squares' sum; their count."""
    time = np.where(used, -np.where(np.isfinite(ages), ages, 0.0), 0.0)
    count = used.sum(1)
    middle = time.sum(1) / np.maximum(count, 1)
    centred = np.where(used, time - middle[:, None], 0.0)
    return centred, (centred**2).sum(1), count


def _nothing(seen: Bools) -> JointSpeeds:
    shape = (seen.shape[0], seen.shape[2])
    return JointSpeeds(np.zeros(shape), np.zeros(shape), np.zeros(shape, np.bool_))
