"""Past forecasts, kept until the actual motion is known, and their errors.

A forecast is compared with each newer capture of the same person, up to the horizon. The forecast
is interpolated linearly between its steps; the body at its own capture is step 0. The radius to
check is that of the step at the end of the interval, as in the zones: entry k holds the body from
step k-1 to step k. Only joints that were observed at both captures are used.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints, Stamps
from hri_predict.people.ring_buffer import NEVER

SPACING_STEPS = 0.6
"""Minimum number of steps between two kept forecasts. At 100 Hz every third capture is enough; if
captures arrive only slightly faster than steps, all are kept."""


def forecast_errors(last: Floats, forecast: Floats, steps: Floats, truth: Floats) -> Floats:
    """Return the error of each of N forecasts.

    Args:
        last: (N, J, 3) metres, positions at the forecast's capture.
        forecast: (N, H, J, 3) metres; step k (from 0) is k + 1 steps after that capture.
        steps: (N,) the time of ``truth`` in steps after that capture, at most H.
        truth: (N, J, 3) metres.

    Returns:
        (N, J) metres; infinite where a number is not finite.
    """
    lower, part = _lower_step(steps, forecast.shape[1])
    row = np.arange(len(forecast))
    below = np.where((lower == 0)[:, None, None], last, forecast[row, np.maximum(lower - 1, 0)])
    return _distance(below, forecast[row, lower], part, truth)


def mean_error(errors: Floats, judged: Bools) -> Floats:
    """Return (N,) the residual: mean of (N, J) errors over the judged joints, NaN without any."""
    count = judged.sum(-1)
    total = np.where(judged, errors, 0.0).sum(-1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _lower_step(steps: Floats, horizon_steps: int) -> tuple[Ints, Floats]:
    """Return the knot before each time, and the fraction of the interval to the next knot."""
    lower = np.minimum(np.maximum(steps.astype(np.intp), 0), horizon_steps - 1)
    return lower, np.minimum(np.maximum(steps - lower, 0.0), 1.0)


def _distance(below: Floats, above: Floats, part: Floats, truth: Floats) -> Floats:
    with np.errstate(invalid="ignore", over="ignore"):
        apart = below + part[:, None, None] * (above - below) - truth
        distance = np.sqrt(np.einsum("nji,nji->nj", apart, apart))
    return np.where(np.isfinite(distance), distance, np.inf)


def _ratio(errors: Floats, radius: Floats, sound: Bools) -> Floats:
    """Return error over radius, infinite where the radius is not a positive number."""
    return np.where(sound, errors, np.inf) / np.where(sound, radius, 1.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judged:
    """N comparisons of a past forecast with the newest capture of the same person.

    Attributes:
        person: (N,) index of the person among those passed to ``judge``.
        lead_s: (N,) age of the forecast.
        step: (N,) step (from 0) whose radius had to hold.
        errors: (N, J) metres, infinite where a number was not finite.
        seen: (N, J) whether the joint was observed at both captures.
        claimed: (N, J) whether the joint was seen and had a finite radius.
        ratio: (N, J) error over calibrated radius, infinite where the radius was not a positive
            number; -infinity where not claimed.
        widened: (N,) the factor in force when the forecast was made; NaN: the radii were not in
            use.
    """

    person: Ints
    lead_s: Floats
    step: Ints
    errors: Floats
    seen: Bools
    claimed: Bools
    ratio: Floats
    widened: Floats


class Ring(NamedTuple):
    """Kept forecasts: S slots for people, R rows each.

    Attributes:
        stamps: (S, R) captures; ``NEVER``: the row is free.
        knots: (S, R, H+1, J, 3) metres, positions from the capture on.
        seen: (S, R, J) whether the joint was observed at the capture.
        radius: (S, R, H, J) calibrated radii, metres.
        widened: (S, R, H) factors; NaN: the radii were not in use.
        rate_hz, horizon_steps: steps per second of the forecasts, and their number.
    """

    stamps: Stamps
    knots: Floats
    seen: Bools
    radius: Floats
    widened: Floats
    rate_hz: float
    horizon_steps: int


class PastForecasts:
    """Forecasts made within the last horizon, in one ring buffer for each of a fixed number of
    people.

    Args:
        people: S, slots for people; this bounds the memory.
        joints: J.
        rate_hz: steps per second of the forecasts.
        horizon_steps: H of the forecasts.

    Attributes:
        ring: the kept forecasts.
    """

    def __init__(self, people: int, joints: int, rate_hz: float, horizon_steps: int) -> None:
        self._spacing_ns = round(SPACING_STEPS / rate_hz * 1e9)
        self._size = int(horizon_steps / SPACING_STEPS) + 2
        rows = (people, self._size)
        self._next: Ints = np.zeros(people, np.intp)
        self._newest: Stamps = np.full(people, NEVER)
        # zeros take memory only where they are written to
        self.ring = Ring(
            stamps=np.full(rows, NEVER),
            knots=np.zeros((*rows, horizon_steps + 1, joints, 3)),
            seen=np.zeros((*rows, joints), np.bool_),
            radius=np.zeros((*rows, horizon_steps, joints)),
            widened=np.ones((*rows, horizon_steps)),
            rate_hz=float(rate_hz),
            horizon_steps=horizon_steps,
        )

    def forget(self, slot: int) -> None:
        """Forget everything about the person in a slot."""
        self.ring.stamps[slot] = NEVER
        self._newest[slot] = NEVER

    def remember(
        self,
        slot: int,
        capture_ns: int,
        *,
        last: Floats,
        seen: Bools,
        forecast: Floats,
        radius: Floats,
        widened: Floats,
    ) -> None:
        """Keep one person's forecast, unless one from (nearly) the same capture is already kept.

        Args:
            slot: the person's slot.
            capture_ns: capture from which the forecast starts.
            last: (J, 3) positions at that capture, metres.
            seen: (J,) observed at that capture.
            forecast: (H, J, 3) metres.
            radius: (H, J) calibrated radii, metres; infinite: nothing is claimed.
            widened: (H,) factors on the radii; NaN: the radii are not in use.
        """
        newest = int(self._newest[slot])
        if newest != NEVER and 0 <= capture_ns - newest < self._spacing_ns:
            return
        at = int(self._next[slot])
        self.ring.knots[slot, at, 0] = last
        self.ring.knots[slot, at, 1:] = forecast
        self.ring.seen[slot, at] = seen
        self.ring.radius[slot, at] = radius
        self.ring.widened[slot, at] = widened
        self.ring.stamps[slot, at] = self._newest[slot] = capture_ns
        self._next[slot] = (at + 1) % self._size

    def judge(self, slots: Ints, capture_ns: Stamps, truth: Floats, observed: Bools) -> Judged:
        """Compare all kept forecasts of Q people with their newest captures.

        Args:
            slots: (Q,) slots of these people.
            capture_ns: (Q,).
            truth: (Q, J, 3) metres.
            observed: (Q, J) whether observed at exactly that capture.
        """
        return judge_all(self.ring, NewestCaptures(slots, capture_ns, truth, observed))


class NewestCaptures(NamedTuple):
    """The newest captures of Q people; see ``PastForecasts.judge``."""

    slots: Ints
    capture_ns: Stamps
    truth: Floats
    observed: Bools


def judge_all(ring: Ring, asked: NewestCaptures) -> Judged:
    """See ``PastForecasts.judge``."""
    slots, capture_ns, truth, observed = asked
    size, horizon, joints = ring.stamps.shape[1], ring.horizon_steps, ring.seen.shape[2]
    stamps = ring.stamps[slots]
    age = np.where(stamps == NEVER, 0, capture_ns[:, None] - np.maximum(stamps, 0)) * 1e-9
    person, at = np.nonzero((age > 0) & (age * ring.rate_hz <= horizon + 1e-6))
    slot, lead = slots[person], age[person, at]
    steps = lead * ring.rate_hz
    lower, part = _lower_step(steps, horizon)
    step = np.ceil(steps - 1e-6).astype(np.intp) - 1
    step = np.minimum(np.maximum(step, 0), horizon - 1)
    # taking rows from flat tables is several times faster than indexing by three arrays
    row = slot * size + at
    knot, knots = row * (horizon + 1) + lower, ring.knots.reshape(-1, joints, 3)
    below, above = knots.take(knot, axis=0), knots.take(knot + 1, axis=0)
    errors = _distance(below, above, part, truth.take(person, axis=0))
    seen = ring.seen.reshape(-1, joints).take(row, axis=0) & observed.take(person, axis=0)
    radius = ring.radius.reshape(-1, joints).take(row * horizon + step, axis=0)
    claimed = seen & (radius != np.inf)  # NaN is a claim, and missed
    sound = radius > 0  # not NaN
    with np.errstate(invalid="ignore"):  # a joint never seen: nothing is claimed for it
        ratio = errors / radius if sound.all() else _ratio(errors, radius, sound)
    return Judged(
        person=person,
        lead_s=lead,
        step=step,
        errors=errors,
        seen=seen,
        claimed=claimed,
        ratio=np.where(claimed, ratio, -np.inf),
        widened=ring.widened[slot, at, step],
    )
