"""Live self-check: past forecasts are compared with what came, and zones widened that fell short.

**Surprise**: the mean error of the forecast made ``SURPRISE_S`` before, the largest of the last
``SURPRISE_S``; see ``motion_class``.

**Widening**: factors >= 1 on the calibrated radii, by person and band of horizons (``BANDS_S``),
that grow while radii hold less often than their level; see ``adaptive_widening`` for the update,
its reaction time and its return.

**Unlike**: a person is taken for unlike anything calibrated, so that physical limits apply, when

- most joints at once are farther than ``short_margin`` times as far outside a radius of the first
  ``SHORT_S`` as ever in the calibration (a camera was moved, an id changed its body);
- a joint is faster, or most bones are longer or shorter, than in the calibration (``MotionRanges``;
  a wrong scale);
- a factor is at its bound and forecasts still miss; or
- there is no room left to remember this person.

It lasts until ``unlike_hold_s`` of captures without a sign of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from hri_predict.predictors.base import Forecast
from hri_predict.reasons import Reason
from hri_predict.ring_buffer import NEVER
from hri_predict.risk.adaptive_widening import AdaptiveWidening
from hri_predict.risk.human_speed import SnapshotVelocities
from hri_predict.risk.motion_class import SURPRISE_S
from hri_predict.risk.motion_ranges import (
    SHORT_S,
    MotionRanges,
    bone_lengths,
    is_out_of_range,
    short_ratio,
)
from hri_predict.risk.past_forecasts import Ints, Judged, PastForecasts, Stamps, mean_error
from hri_predict.risk.self_check_report import Tally
from hri_predict.scene import Bools, Floats
from hri_predict.settings import Settings
from hri_predict.skeleton import JOINTS, PARENTS
from hri_predict.snapshot import PeopleSnapshot

__all__ = ["MotionRanges", "SelfCheck", "SelfCheckSettings", "Trust"]

BANDS_S = (0.12, 0.24, 0.4, 0.6, 0.8)
"""Horizons up to each of these, and beyond the last, share a factor. Of captures slower than 8 a
second none falls into the first band, which is then never widened."""
MAX_DT_S = 0.1
"""A longer gap between captures counts as this: it is one judgement all the same."""
_FRESH_S = 1e-6
_MAX_ERROR_M = 1e6
"""Counted for an error that is not finite, so that the sums stay so."""
_SURPRISES = 64
"""Surprises remembered of each person: over 0.4 s, of captures at up to 160 Hz."""


class SelfCheckSettings(Settings):
    """How past forecasts are judged; the module's docstring says how they are used."""

    growth_per_s: float = Field(
        4.0, gt=0, le=100, description="a factor that always misses grows by e^this in a second"
    )
    recover_s: float = Field(
        5.0, gt=0, le=600, description="after so long of good coverage radii are not widened"
    )
    max_factor: float = Field(
        4.0, gt=1, le=100, description="widening ends here; physical limits are used beyond"
    )
    short_margin: float = Field(
        1.1,
        ge=1,
        le=100,
        description="first steps wrong by more than this times the worst calibrated are unlike",
    )
    speed_margin: float = Field(
        1.2, ge=1, le=100, description="joints faster than this times the fastest are unlike"
    )
    bone_tolerance: float = Field(
        0.2,
        ge=0,
        lt=1,
        description="bones longer or shorter than any by more than this share are unlike; the"
        " calibration has few bodies, and adults differ by a tenth either way",
    )
    unlike_hold_s: float = Field(
        1.0, ge=0, le=600, description="physical limits stay so long after the last sign"
    )
    max_people: int = Field(
        64, ge=1, le=64, description="people whose forecasts are remembered; more are unlike"
    )


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """What past forecasts say of the ones made now. P people of the snapshot, H steps.

    Attributes:
        surprise_m: (P,) metres; NaN where no forecast is old enough to be judged.
        widen: (P, H) factors >= 1 for the calibrated radii.
        unlike: (P,) whose motion is unlike anything calibrated: use physical limits.
        reasons: ``MOTION_UNLIKE`` and ``ZONES_WIDENED`` as they apply, worst first.
    """

    surprise_m: Floats
    widen: Floats
    unlike: Bools
    reasons: tuple[Reason, ...]

    def surprise_alone(self) -> "Trust":
        """The same surprise, which tells motion classes apart, and nothing made of it."""
        return Trust(self.surprise_m, np.ones_like(self.widen), np.zeros_like(self.unlike), ())


class SelfCheck:
    """Remembers forecasts and judges them; one per run, deterministic.

    Args:
        settings: see ``SelfCheckSettings``.
        level: of the calibrated radii, 0 < level < 1.
        of: what they hold at that level, the whole ``body`` at once or each ``joint``.
        rate_hz: steps per second of the forecasts and of the snapshots' history.
        horizon_steps: H of the forecasts.
        ranges: of the calibration; ``None``: nothing is known, so no motion is out of range.
        velocities: shared with whoever else measures them.
    """

    def __init__(
        self,
        settings: SelfCheckSettings,
        level: float,
        of: Literal["body", "joint"],
        rate_hz: float,
        horizon_steps: int,
        ranges: MotionRanges | None,
        velocities: SnapshotVelocities | None = None,
    ) -> None:
        self._settings = settings
        self._velocities = velocities or SnapshotVelocities(rate_hz)
        self._of = of
        self._rate_hz = rate_hz
        self._ranges = ranges
        self._horizon_ns = round(horizon_steps / rate_hz * 1e9)
        self._hold_ns = round(settings.unlike_hold_s * 1e9)
        ends = np.arange(1, horizon_steps + 1) / rate_hz
        self._band: Ints = np.searchsorted(np.array(BANDS_S), ends - 1e-9).astype(np.intp)
        bands, people = int(self._band[-1]) + 1, settings.max_people
        self._past = PastForecasts(people, len(JOINTS), rate_hz, horizon_steps)
        self._ids: list[int | None] = [None] * people
        self._present_ns: Stamps = np.full(people, NEVER)  # newest tick with this person
        self._capture_ns: Stamps = np.full(people, NEVER)  # newest capture judged
        self._sign_ns: Stamps = np.full(people, NEVER)  # newest capture with a sign of unlike
        self._surprise: Floats = np.zeros((people, _SURPRISES))
        self._surprise_ns: Stamps = np.full((people, _SURPRISES), NEVER)
        self._surprises: Ints = np.zeros(people, np.intp)
        band_ends = (*BANDS_S[: bands - 1], float(ends[-1]))
        self._widening = AdaptiveWidening(
            people,
            np.array(band_ends),
            level,
            settings.growth_per_s,
            settings.recover_s,
            settings.max_factor,
        )
        self._tally = Tally(people, band_ends)

    # -- each tick --------------------------------------------------------------------------------

    def check(self, snapshot: PeopleSnapshot) -> Trust:
        """Judge what is remembered against the newest captures; before this tick's zones."""
        slots = self._slots(snapshot)
        known = np.flatnonzero(slots >= 0)
        new = known[self._capture_ns[slots[known]] != snapshot.capture_ns[known]]
        if len(new):
            self._judge(snapshot, new, slots[new])
        trust = self._trust(snapshot, slots)
        self._tally.tick(trust.widen, trust.unlike)
        return trust

    def note(self, snapshot: PeopleSnapshot, forecast: Forecast, radius: Floats) -> None:
        """Remember this tick's forecasts.

        Args:
            snapshot: that was forecast, and checked before.
            forecast: of its people.
            radius: (P, H, J) metres, calibrated, *before* widening; infinite where nothing is
                claimed, which is not judged. Give finite ones for people who are unlike as well:
                only what is judged can come back.
        """
        slot_of = {number: slot for slot, number in enumerate(self._ids) if number is not None}
        fresh = snapshot.joint_age_s < _FRESH_S
        every = np.arange(len(self._ids))
        factor = self._widening.factor(every)[:, self._band]
        factor[self._is_unlike(every, self._capture_ns)] = np.nan  # their radii are not used
        for person, number in enumerate(snapshot.ids):
            slot = slot_of.get(number)
            if slot is not None:
                self._past.remember(
                    slot,
                    int(snapshot.capture_ns[person]),
                    snapshot.last_positions[person],
                    fresh[person],
                    forecast.positions[person],
                    radius[person],
                    factor[slot],
                )

    def report(self) -> dict[str, Any]:
        """For the run's summary: how often past forecasts held, and what was done about it."""
        return self._tally.report(self._ids)

    # -- people come and go -----------------------------------------------------------------------

    def _slots(self, snapshot: PeopleSnapshot) -> Ints:
        """(P,) the slot of each person, -1 where none is free."""
        here = set(snapshot.ids)
        for slot, number in enumerate(self._ids):
            if number is None or number in here:
                continue
            if snapshot.now_ns - int(self._present_ns[slot]) > self._horizon_ns:
                self._release(slot)
        slots = np.full(len(snapshot.ids), -1, np.intp)
        for person, number in enumerate(snapshot.ids):
            slots[person] = slot = self._slot(number, here)
            if slot >= 0:
                self._present_ns[slot] = snapshot.now_ns
        return slots

    def _slot(self, number: int, here: set[int]) -> int:
        if number in self._ids:
            return self._ids.index(number)
        if None in self._ids:
            slot = self._ids.index(None)
        else:  # whoever is gone for longest gives way
            gone = [s for s, other in enumerate(self._ids) if other not in here]
            if not gone:
                return -1
            slot = min(gone, key=lambda s: int(self._present_ns[s]))
            self._release(slot)
        self._ids[slot] = number
        return slot

    def _release(self, slot: int) -> None:
        number = self._ids[slot]
        if number is not None:
            self._tally.close(slot, number)
        self._ids[slot] = None
        self._past.forget(slot)
        self._capture_ns[slot] = self._sign_ns[slot] = NEVER
        self._widening.forget(slot)
        self._surprise_ns[slot] = NEVER

    # -- judging ----------------------------------------------------------------------------------

    def _judge(self, snapshot: PeopleSnapshot, new: Ints, slots: Ints) -> None:
        """Judge people ``new`` of the snapshot, who have a new capture."""
        capture = snapshot.capture_ns[new]
        before = self._capture_ns[slots]
        elapsed = np.where(before == NEVER, 0, capture - np.maximum(before, 0)) * 1e-9
        self._capture_ns[slots] = capture
        judged = self._past.judge(
            slots, capture, snapshot.last_positions[new], snapshot.joint_age_s[new] < _FRESH_S
        )
        self._note_surprise(judged, slots, capture)
        sign = self._adapt(judged, slots, np.minimum(np.maximum(elapsed, 0.0), MAX_DT_S))
        if self._ranges is not None:
            sign |= self._is_wrong_at_once(judged, len(new), self._ranges)
            velocity, measured = self._velocities.of(snapshot)
            bones = bone_lengths(snapshot.history, snapshot.observed, self._rate_hz, PARENTS)
            sign |= is_out_of_range(
                (velocity[new], measured[new]),
                bones[new],
                self._ranges,
                self._settings.speed_margin,
                self._settings.bone_tolerance,
            )
        self._sign_ns[slots[sign]] = capture[sign]

    def _note_surprise(self, judged: Judged, slots: Ints, capture: Stamps) -> None:
        """Of each person the error of the forecast made (nearly) ``SURPRISE_S`` ago."""
        off = np.abs(judged.lead_s - SURPRISE_S)
        # what was forecast of somebody hardly seen yet says nothing of the forecasts to come
        used = judged.claimed.any(1)
        near = np.flatnonzero(used & (off <= 0.5 / self._rate_hz + 1e-9))
        near = near[np.argsort(-off[near], kind="stable")]  # the nearest last
        row_of = np.full(len(slots), -1, np.intp)
        row_of[judged.person[near]] = near  # of several the last stays
        person = np.flatnonzero(row_of >= 0)
        row = row_of[person]
        value = mean_error(judged.errors[row], judged.seen[row])
        known = ~np.isnan(value)
        person, value = person[known], value[known]
        slot = slots[person]
        at = self._surprises[slot]
        self._surprise[slot, at] = value
        self._surprise_ns[slot, at] = capture[person]
        self._surprises[slot] = (at + 1) % _SURPRISES

    def _adapt(self, judged: Judged, slots: Ints, dt: Floats) -> Bools:
        """Move the factors; whether one is at its bound, and forecasts still miss."""
        factor = self._widening.own(slots)[judged.person, self._band[judged.step]]
        claimed = judged.claimed
        some = claimed.any(1)
        # of the whole body, its worst joint decides
        ratio = judged.ratio.max(1, keepdims=True) if self._of == "body" else judged.ratio
        joints = np.maximum(claimed.sum(1), 1) if self._of == "joint" else 1
        used = ~np.isnan(judged.widened)
        sums = self._by_band(
            judged,
            len(slots),
            [
                np.where(some, 1.0, 0.0),
                np.where(some & used, 1.0, 0.0),
                (ratio > 1.0).sum(1) / joints,
                (ratio > factor[:, None]).sum(1) / joints,
                (ratio > judged.widened[:, None]).sum(1) / joints,
                np.where(some, np.minimum(mean_error(judged.errors, claimed), _MAX_ERROR_M), 0.0),
            ],
        )
        count, in_use, bare, now, then, error = sums
        self._tally.add(slots, np.stack([count, in_use, bare, then, error], axis=1))

        share_of = np.maximum(count, 1.0)
        return self._widening.update(slots, dt, count > 0, bare / share_of, now / share_of)

    def _by_band(self, judged: Judged, people: int, values: Sequence[Floats]) -> Floats:
        """(V, people, bands) sums of V values per judgement (N,)."""
        bands = int(self._band[-1]) + 1
        cell = judged.person * bands + self._band[judged.step]
        member = (cell[:, None] == np.arange(people * bands)).astype(np.float64)
        return (np.stack(values) @ member).reshape(len(values), people, bands)

    def _is_wrong_at_once(self, judged: Judged, people: int, ranges: MotionRanges) -> Bools:
        rows = np.flatnonzero(judged.lead_s <= SHORT_S + 1e-9)
        ratio = short_ratio(judged.ratio[rows], judged.claimed[rows])
        bound = self._settings.short_margin * max(1.0, ranges.ratio_short)
        wrong = np.zeros(people, np.bool_)
        wrong[judged.person[rows[ratio > bound]]] = True
        return wrong

    def _trust(self, snapshot: PeopleSnapshot, slots: Ints) -> Trust:
        kept = slots >= 0
        capture = snapshot.capture_ns
        since = capture[:, None] - round(SURPRISE_S * 1e9)
        stamps = self._surprise_ns[slots]
        recent = (stamps >= since) & (stamps <= capture[:, None]) & kept[:, None]
        worst = np.where(recent, self._surprise[slots], -np.inf).max(1)
        unlike = self._is_unlike(slots, capture) | ~kept
        widen = np.where(kept[:, None], self._widening.factor(slots)[:, self._band], 1.0)
        return Trust(
            surprise_m=np.where(worst >= 0, worst, np.nan),
            widen=widen,
            unlike=unlike,
            reasons=_reasons(widen, unlike),
        )

    def _is_unlike(self, slots: Ints, capture: Stamps) -> Bools:
        """(Q,) who showed a sign of it within the hold time before ``capture`` (Q,)."""
        sign = self._sign_ns[slots]
        return (sign != NEVER) & (capture - np.maximum(sign, 0) <= self._hold_ns)


def _reasons(widen: Floats, unlike: Bools) -> tuple[Reason, ...]:
    found: Sequence[tuple[bool, Reason]] = (
        (bool(unlike.any()), Reason.MOTION_UNLIKE),
        (bool((widen[~unlike] > 1.0).any()), Reason.ZONES_WIDENED),
    )
    return tuple(reason for holds, reason in found if holds)
