"""Live self-check: compares past forecasts with the actual motion, and widens zones if needed.

**Residual**: the mean error of the forecast made ``RESIDUAL_S`` ago; the largest value of the last
``RESIDUAL_S`` is used. See ``motion_class``.

**Widening**: factors >= 1 on the calibrated radii, by person and band of horizons (``BANDS_S``),
that grow while radii hold less often than their level. See ``widening`` for the update, the
reaction time and the return to 1.

**Out of distribution**: a person's motion is outside the calibration, so physical limits apply,
when

- most joints leave a radius of the first ``SHORT_S`` at the same time, by more than
  ``short_margin`` times the worst case of the calibration (a camera was moved, or an id moved to
  another body);
- a joint is faster than in the calibration (``MotionRanges``);
- a factor is at its bound and forecasts still miss; or
- no slot is free for this person.

This state ends after ``hold_s`` of captures without such a sign.

**Drift**: see ``drift``.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats, Ints, Stamps
from hri_predict.base.machine.compiled import plain
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.predictor import Forecast
from hri_predict.people.ring_buffer import NEVER
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.human_speed import Velocities, velocities_in
from hri_predict.zones.learned_scale import LEADS_S
from hri_predict.zones.motion_class import RESIDUAL_S
from hri_predict.zones.motion_ranges import MotionRanges, is_out_of_range
from hri_predict.zones.self_check.drift import Drift
from hri_predict.zones.self_check.past_forecasts import NewestCaptures, PastForecasts
from hri_predict.zones.self_check.slots import Slots
from hri_predict.zones.self_check.verdict import Terms, verdict
from hri_predict.zones.self_check.widening import AdaptiveWidening
from hri_predict.zones.trust import Trust

# -- the self-check's counts: how often past forecasts held, for the run's summary -----------------

_SUMS = 5
"""Sums over judgements: all, with radii in use, missed as calibrated, missed as used, mean
errors."""
_MAX_IDS = 64
"""Maximum number of ids in the report, so that flickering ids do not fill the memory."""


class Tally:
    """Running sums per person and band of horizons.

    Args:
        people: slots for people.
        bands_s: (B,) upper end of each band, seconds ahead.
    """

    def __init__(self, people: int, bands_s: Sequence[float]) -> None:
        self._bands_s = tuple(bands_s)
        self._sums: Floats = np.zeros((people, _SUMS, len(bands_s)))
        self._past: Floats = np.zeros((_SUMS, len(bands_s)))
        self._left: dict[int, Floats] = {}
        self._ticks = self._widened_ticks = self._outside_ticks = 0
        self._largest = 1.0

    def tick(self, trust: Trust) -> None:
        """Count whether a person is widened or out of distribution in this tick."""
        self._ticks += 1
        self._widened_ticks += bool(trust.widened.any())
        self._outside_ticks += bool(trust.out_of_distribution.any())
        self._largest = max(self._largest, float(trust.widen.max(initial=1.0)))

    def add(self, slots: NDArray[np.intp], sums: Floats) -> None:
        """Add (Q, ``_SUMS``, B) to the sums of Q people."""
        self._sums[slots] += sums

    def close(self, slot: int, number: int) -> None:
        """Record that the person with this id has left the slot."""
        sums = self._sums[slot].copy()
        self._sums[slot] = 0.0
        self._past += sums
        self._left[number] = sums + self._left.pop(number, 0.0)
        if len(self._left) > _MAX_IDS:
            del self._left[next(iter(self._left))]

    def report(self, ids: Sequence[int | None]) -> dict[str, Any]:
        """Return all sums since the start; ``ids`` are the ids now in the slots.

        ``covered`` is the share of the ``judged_in_use`` forecasts (or of their joints) that held
        with the widening in force when they were made. Forecasts made for people out of
        distribution are excluded. ``covered_as_calibrated`` is the share of all ``judged`` that
        held without widening. Shares are ``None`` if nothing was judged. The newest ids have their
        own entries.
        """
        people = dict(self._left)
        for slot, number in enumerate(ids):
            if number is not None:
                people[number] = self._sums[slot] + people.pop(number, 0.0)
        everybody = self._past + self._sums.sum(0)
        return {
            "ticks": self._ticks,
            "ticks_widened": self._widened_ticks,
            "ticks_unlike": self._outside_ticks,
            "largest_factor": self._largest,
            **_shares(everybody.sum(1)),
            "horizons": self._horizons(everybody),
            "people": {
                str(number): {**_shares(sums.sum(1)), "horizons": self._horizons(sums)}
                for number, sums in list(people.items())[-_MAX_IDS:]
            },
        }

    def _horizons(self, sums: Floats) -> list[dict[str, Any]]:
        return [
            {"up_to_s": end, **_shares(sums[:, band])} for band, end in enumerate(self._bands_s)
        ]


def _shares(sums: Floats) -> dict[str, Any]:
    judged, used, bare, then, error = (float(value) for value in sums)
    return {
        "judged": round(judged),
        "judged_in_use": round(used),
        "covered": 1.0 - then / used if used else None,
        "covered_as_calibrated": 1.0 - bare / judged if judged else None,
        "mean_error_m": error / judged if judged else None,
    }


# --------------------------------------------------------------------------------------------------

__all__ = ["MotionRanges", "SelfCheck", "SelfCheckConstants", "Trust"]

BANDS_S = (0.12, 0.24, 0.4, 0.6, 0.8)
"""Upper ends of the bands of horizons that share a factor; the last band includes all longer
horizons. If captures arrive at less than 8 a second, none falls into the first band, which is then
never widened."""
MAX_DT_S = 0.1
"""Maximum time that one gap between captures contributes: it is still one judgement."""
_RESIDUALS = 64
"""Number of residuals kept for each person: 0.4 s of captures at up to 160 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SelfCheckConstants:
    """Constants for judging past forecasts. See the module's docstring for their use.

    Attributes:
        growth_per_s: a factor whose radii always miss grows by e^growth_per_s in a second.
        recover_s: time of good coverage after which radii are no longer widened.
        max_factor: maximum factor; beyond it, physical limits apply.
        short_margin: errors of the first steps beyond this times the worst calibrated errors are a
            sign of motion out of distribution.
        speed_margin: joint speeds beyond this times the highest calibrated speeds are also a sign.
        hold_s: time for which physical limits apply after the last sign.
        max_people: maximum number of people whose forecasts are kept; others count as out of
            distribution.
    """

    growth_per_s: float = 4.0
    recover_s: float = 5.0
    max_factor: float = 4.0
    short_margin: float = 1.1
    speed_margin: float = 1.2
    hold_s: float = 1.0
    max_people: int = 64


class SelfCheck:
    """Keeps forecasts and judges them; one per run, deterministic.

    Args:
        constants: see ``SelfCheckConstants``.
        level: level of the calibrated radii, 0 < level < 1.
        of: unit to which the level applies, the whole ``body`` at once or each ``joint``.
        rate_hz: steps per second of the forecasts and of the snapshots' history.
        horizon_steps: H of the forecasts.
        ranges: motion ranges of the calibration; ``None``: unknown, so no motion is out of range.
    """

    def __init__(
        self,
        constants: SelfCheckConstants,
        *,
        level: float,
        of: Literal["body", "joint"],
        rate_hz: float,
        horizon_steps: int,
        ranges: MotionRanges | None,
    ) -> None:
        self._constants = constants
        self._rate_hz = rate_hz
        self._ranges = ranges
        self._horizon_ns = round(horizon_steps / rate_hz * 1e9)
        self._hold_ns = round(constants.hold_s * 1e9)
        ends = np.arange(1, horizon_steps + 1) / rate_hz
        self._band: Ints = np.searchsorted(np.array(BANDS_S), ends - 1e-9).astype(np.intp)
        bands, people = int(self._band[-1]) + 1, constants.max_people
        self._terms = Terms(self._band, bands, of == "body")
        self._past = PastForecasts(people, len(JOINTS), rate_hz, horizon_steps)
        self._slots = Slots(people, self._horizon_ns, self._release)
        self._capture_ns: Stamps = np.full(people, NEVER)  # newest capture judged
        self._sign_ns: Stamps = np.full(people, NEVER)  # newest capture with a sign of it
        self._residual: Floats = np.zeros((people, _RESIDUALS))
        self._residual_ns: Stamps = np.full((people, _RESIDUALS), NEVER)
        self._residuals: Ints = np.zeros(people, np.intp)
        self._error: Floats = np.full((people, len(LEADS_S), len(JOINTS)), np.nan)  # newest capture
        band_ends = (*BANDS_S[: bands - 1], float(ends[-1]))
        self._widening = AdaptiveWidening(
            people=people,
            ends_s=np.array(band_ends),
            level=level,
            growth_per_s=constants.growth_per_s,
            recover_s=constants.recover_s,
            max_factor=constants.max_factor,
        )
        self._tally = Tally(people, band_ends)
        self.drift = Drift(level)

    # -- each tick --------------------------------------------------------------------------------

    def check(self, snapshot: PeopleSnapshot, velocities: Velocities | None = None) -> Trust:
        """Judge kept forecasts against the newest captures. Call it before building zones.

        Args:
            snapshot: people at this tick.
            velocities: velocities of their joints; ``None``: they are measured here.
        """
        slots = self._slots.assigned(snapshot)
        known = np.flatnonzero(slots >= 0)
        new = known[self._capture_ns[slots[known]] != snapshot.capture_ns[known]]
        if len(new):
            if velocities is None:
                velocities = velocities_in(snapshot, self._rate_hz)
            self._judge(snapshot, new, slots[new], velocities)
        trust = self._trust(snapshot, slots)
        self._tally.tick(trust)
        return trust

    def note(self, snapshot: PeopleSnapshot, forecast: Forecast, radius: Floats) -> None:
        """Keep this tick's forecasts.

        Args:
            snapshot: people at this tick, already passed to ``check``.
            forecast: forecast for these people.
            radius: (P, H, J) metres, calibrated, *before* widening. An infinite radius is not
                judged. People out of distribution need finite radii as well: only people who are
                judged can leave this state.
        """
        slots = self._slots.known(snapshot)
        fresh = snapshot.fresh  # only the truth judges
        factor = self._widening.factor(slots)[:, self._band]
        # radii of those who are out of distribution are not used
        factor[self._is_out_of_distribution(slots, self._capture_ns[slots])] = np.nan
        for person, slot in enumerate(slots.tolist()):
            if slot >= 0:
                self._past.remember(
                    slot,
                    int(snapshot.capture_ns[person]),
                    last=snapshot.last_positions[person],
                    seen=fresh[person],
                    forecast=forecast.positions[person],
                    radius=radius[person],
                    widened=factor[person],
                )

    def report(self) -> dict[str, Any]:
        """Return for the run's summary how often past forecasts held, and the widening applied."""
        return {**self._tally.report(self._slots.ids), "drift": self.drift.report()}

    # -- people come and go -----------------------------------------------------------------------

    def _release(self, slot: int, number: int) -> None:
        self._tally.close(slot, number)
        self._past.forget(slot)
        self._capture_ns[slot] = self._sign_ns[slot] = NEVER
        self._widening.forget(slot)
        self._residual_ns[slot] = NEVER
        self._error[slot] = np.nan

    # -- judging ----------------------------------------------------------------------------------

    def _judge(
        self, snapshot: PeopleSnapshot, new: Ints, slots: Ints, velocities: Velocities
    ) -> None:
        """Judge the people ``new`` of the snapshot, who have a new capture."""
        capture = snapshot.capture_ns[new]
        before = self._capture_ns[slots]
        elapsed = np.where(before == NEVER, 0, capture - np.maximum(before, 0)) * 1e-9
        self._capture_ns[slots] = capture
        fresh = snapshot.fresh[new]
        sums, residual, error, wrong = verdict(
            self._past.ring,
            NewestCaptures(slots, capture, plain(snapshot.last_positions[new]), fresh),
            self._terms,
            self._widening.own(slots),
        )
        self._note_residual(residual, slots, capture)
        self._error[slots] = error
        dt = np.minimum(np.maximum(elapsed, 0.0), MAX_DT_S)
        sign = self._adapt(sums, slots, dt, snapshot.now_ns)
        if self._ranges is not None:
            worst = max(1.0, self._ranges.ratio_short)
            sign |= wrong > self._constants.short_margin * worst
            velocity, measured = velocities
            sign |= is_out_of_range(
                (velocity[new], measured[new]),
                self._ranges,
                speed_margin=self._constants.speed_margin,
            )
        self._sign_ns[slots[sign]] = capture[sign]

    def _note_residual(self, value: Floats, slots: Ints, capture: Stamps) -> None:
        known = ~np.isnan(value)
        slot, at = slots[known], self._residuals[slots[known]]
        self._residual[slot, at] = value[known]
        self._residual_ns[slot, at] = capture[known]
        self._residuals[slot] = (at + 1) % _RESIDUALS

    def _adapt(self, sums: Floats, slots: Ints, dt: Floats, now_ns: int) -> Bools:
        """Update the factors. Return (Q,) whether one is at its bound and forecasts still miss."""
        count, in_use, bare, now, then, error = sums
        self._tally.add(slots, np.stack([count, in_use, bare, then, error], axis=1))
        self.drift.add(now_ns, float(bare.sum()), float(count.sum()))
        share_of = np.maximum(count, 1.0)
        return self._widening.update(
            slots, dt, judged=count > 0, bare=bare / share_of, now=now / share_of
        )

    def _trust(self, snapshot: PeopleSnapshot, slots: Ints) -> Trust:
        kept = slots >= 0
        capture = snapshot.capture_ns
        since = capture[:, None] - round(RESIDUAL_S * 1e9)
        stamps = self._residual_ns[slots]
        recent = (stamps >= since) & (stamps <= capture[:, None]) & kept[:, None]
        worst = np.where(recent, self._residual[slots], -np.inf).max(1)
        out_of_distribution = self._is_out_of_distribution(slots, capture) | ~kept
        widen = np.where(kept[:, None], self._widening.factor(slots)[:, self._band], 1.0)
        return Trust(
            residual_m=np.where(worst >= 0, worst, np.nan),
            error_m=np.where(kept[:, None, None], self._error[slots], np.nan),
            widen=widen,
            out_of_distribution=out_of_distribution,
        )

    def _is_out_of_distribution(self, slots: Ints, capture: Stamps) -> Bools:
        """Return (Q,) whether a sign occurred within the hold time before ``capture`` (Q,)."""
        sign = self._sign_ns[slots]
        return (sign != NEVER) & (capture - np.maximum(sign, 0) <= self._hold_ns)
