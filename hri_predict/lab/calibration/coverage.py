"""Coverage of people by zones, and the zones' sizes: measured on recordings.

*As calibrated* compares errors with radii. *As run* builds the zones as the node does, tick after
tick, with the cut to what bodies can do and (if asked) the live self-check, and checks whether each
joint stayed inside during each interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.predictor import Forecast, Predictor
from hri_predict.lab.calibration.scores import Scores, evidence_of
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.zones.calibration import Calibration
from hri_predict.zones.joint_zones import JointSpheres, JointZones
from hri_predict.zones.radii import Radii
from hri_predict.zones.self_check.self_check import SelfCheck, SelfCheckConstants, Trust
from hri_predict.zones.settings import CoverageSettings, HumanLimits

RESAMPLES = 2000
INTERVAL = (0.025, 0.975)


class Calibrated(NamedTuple):
    """A predictor and the calibration of its zones, as a node runs them."""

    predictor: Predictor
    calibration: Calibration


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Coverage:
    """Counts by recording. U recordings, H steps.

    Attributes:
        names, actions: names and actions of the recordings.
        held, known: per question, (U, H) number of intervals inside, and of intervals known.
        windows: (U,) number of windows.
        widened_in, unlike_in: (U,) number of windows in which zones were widened, or in which
            physical limits replaced them.
    """

    names: tuple[str, ...]
    actions: tuple[str, ...]
    held: dict[str, Floats]
    known: dict[str, Floats]
    windows: Floats
    widened_in: Floats
    unlike_in: Floats

    @property
    def widened(self) -> float:
        """Share of all windows in which zones were widened."""
        return float(self.widened_in.sum() / max(self.windows.sum(), 1))

    @property
    def unlike(self) -> float:
        """Share of all windows in which physical limits replaced the zones."""
        return float(self.unlike_in.sum() / max(self.windows.sum(), 1))

    def trust_of(self, action: str) -> tuple[float, float]:
        """``widened`` and ``unlike`` of one action."""
        own = self.of_action(action)
        return own.widened, own.unlike

    def of_action(self, action: str) -> "Coverage":
        """The recordings of one action alone."""
        own = [i for i, a in enumerate(self.actions) if a == action]
        return replace(
            self,
            names=tuple(self.names[i] for i in own),
            actions=tuple(self.actions[i] for i in own),
            held={of: table[own] for of, table in self.held.items()},
            known={of: table[own] for of, table in self.known.items()},
            windows=self.windows[own],
            widened_in=self.widened_in[own],
            unlike_in=self.unlike_in[own],
        )

    def share(self, of: str) -> Floats:
        """(H,) share inside, pooled over all windows; NaN where nothing is known."""
        return ratio(self.held[of].sum(0), self.known[of].sum(0))

    def interval(self, of: str, seed: int = 0) -> tuple[Floats, Floats]:
        """(H,) and (H,): 95 % interval of ``share`` from resampling recordings (bootstrap)."""
        count = len(self.names)
        draws = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), RESAMPLES)
        shares = ratio(draws @ self.held[of], draws @ self.known[of])
        low, high = (_nanquantile(shares, q) for q in INTERVAL)
        return low, high


def ratio(held: Floats, known: Floats) -> Floats:
    """Return the share of ``known`` that ``held`` is; NaN where nothing is known."""
    return np.where(known > 0, held / np.maximum(known, 1), np.nan)


def _nanquantile(values: Floats, q: float) -> Floats:
    known = np.isfinite(values).any(0)
    result = np.full(values.shape[1], np.nan)
    result[known] = np.nanquantile(values[:, known], q, axis=0)
    return result


def as_calibrated(
    scores: Sequence[Scores],
    calibration: Calibration,
    settings: CoverageSettings,
    skeleton: Skeleton,
) -> Coverage:
    """Errors against calibrated radii, without cut and self-check."""
    inside = []
    for entry in scores:
        radii = Radii(calibration, settings, skeleton, entry.error_m.shape[1])
        radius = radii.of(entry.speed_m_s, evidence_of(entry))
        calibrated = np.isfinite(radius)
        known = np.isfinite(entry.error_m) & calibrated
        inside.append((known & (entry.error_m <= radius), known))
    return _collected(scores, inside)


def as_run(
    scores: Sequence[Scores],
    calibrated: Calibrated,
    settings: CoverageSettings,
    limits: HumanLimits | None = None,
) -> Coverage:
    """Zones as the node builds them, window after window of each presence."""
    rate_hz = calibrated.predictor.rate_hz
    inside, trusted = [], []
    for entry in scores:
        held = np.zeros(entry.error_m.shape, dtype=bool)
        widened = unlike = 0
        runs = run_zones(entry, calibrated, settings, limits)
        for window, (spheres, trust) in enumerate(runs):
            held[window] = _holds(entry, window, spheres, rate_hz)
            widened += bool(trust.widened.any())
            unlike += bool(trust.out_of_distribution.any())
        known = np.isfinite(entry.error_m)
        inside.append((held & known, known))
        trusted.append((widened, unlike))
    return _collected(scores, inside, trusted)


def run_zones(
    entry: Scores,
    calibrated: Calibrated,
    settings: CoverageSettings,
    limits: HumanLimits | None = None,
) -> "list[tuple[JointSpheres, Trust]]":
    """The joints' zones of every window, in order, with the self-check's trust at that time."""
    predictor, calibration = calibrated
    rate_hz, steps = predictor.rate_hz, entry.error_m.shape[1]
    skeleton = predictor.skeleton
    check = SelfCheck(
        SelfCheckConstants(),
        level=settings.level,
        of=settings.of,
        rate_hz=rate_hz,
        horizon_steps=steps,
        ranges=calibration.motion_ranges(skeleton),
    )
    builder = JointZones(
        skeleton=skeleton,
        limits=limits or HumanLimits(),
        rate_hz=rate_hz,
        horizon_steps=steps,
        times_s=np.arange(steps + 1) / rate_hz,
        radii=Radii(calibration, settings, skeleton, steps),
    )
    found = []
    for window in range(len(entry.origin_ns)):
        snapshot = snapshot_of(entry, window, predictor.history_steps)
        forecast = forecast_of(entry, window)
        trust = check.check(snapshot)
        if not settings.self_check:
            trust = trust.residual_alone()
        spheres = builder.build(
            snapshot, forecast, capture_ns=int(entry.origin_ns[window]), trust=trust
        )
        assert spheres.claimed is not None
        check.note(snapshot, forecast, spheres.claimed)
        found.append((spheres, trust))
    return found


def forecast_of(entry: Scores, window: int) -> Forecast:
    """Return the forecast of one window, as the node has it."""
    one = slice(window, window + 1)
    return Forecast(entry.forecast[one], None if entry.std is None else entry.std[one])


def snapshot_of(entry: Scores, window: int, history_steps: int) -> PeopleSnapshot:
    """Return the node's snapshot in one window: one person, at the time of the capture."""
    now = int(entry.origin_ns[window])
    seen = entry.observed[window, -1]
    at = int(entry.truth.stamps_ns.searchsorted(now))
    return PeopleSnapshot(
        now_ns=now,
        ids=(1,),
        history=entry.history[window, -history_steps:][None],
        observed=entry.observed[window, -history_steps:][None],
        capture_ns=np.array([now], dtype=np.int64),
        last_positions=np.where(seen[:, None], entry.truth.positions[at], np.nan)[None],
        joint_age_s=np.where(seen, 0.0, np.inf)[None],
        lost=(),
        reasons=(),
        newest_capture_ns=now,
        captures=window + 1,
        counters={},
    )


def _holds(entry: Scores, window: int, spheres: JointSpheres, rate_hz: float) -> Bools:
    """(H, J) whether a joint was in its sphere at every capture of each interval."""
    truth, steps = entry.truth, entry.error_m.shape[1]
    at = int(truth.stamps_ns.searchsorted(entry.origin_ns[window]))
    end = int(entry.origin_ns[window] + round(steps * 1e9 / rate_hz))
    ahead = slice(at + 1, int(truth.stamps_ns.searchsorted(end, side="right")))
    passed = (truth.stamps_ns[ahead] - entry.origin_ns[window]) * 1e-9 * rate_hz
    interval = np.clip(np.ceil(passed - 1e-6).astype(np.intp), 1, steps)
    apart = np.linalg.norm(truth.positions[ahead] - spheres.mid[0, interval], axis=-1)
    outside = apart > spheres.radius[0, interval] + 1e-9
    held = np.ones((steps + 1, outside.shape[1]), dtype=bool)
    np.logical_and.at(held, interval, ~outside)
    return held[1:]


def _collected(
    scores: Sequence[Scores],
    inside: Sequence[tuple[Bools, Bools]],
    trusted: Sequence[tuple[int, int]] = (),
) -> Coverage:
    """Counts by recording from (W, H, J) held and known of each presence."""
    names = list(dict.fromkeys(s.name for s in scores))
    actions = {s.name: s.action for s in scores}
    steps = scores[0].error_m.shape[1]
    held = {of: np.zeros((len(names), steps)) for of in ("joint", "body")}
    known = {of: np.zeros((len(names), steps)) for of in ("joint", "body")}
    windows, widened, unlike = (np.zeros(len(names)) for _ in range(3))
    for index, (entry, (is_held, is_known)) in enumerate(zip(scores, inside, strict=True)):
        unit = names.index(entry.name)
        held["joint"][unit] += is_held.sum((0, 2))
        known["joint"][unit] += is_known.sum((0, 2))
        anybody = is_known.any(2)
        held["body"][unit] += (anybody & (is_held | ~is_known).all(2)).sum(0)
        known["body"][unit] += anybody.sum(0)
        windows[unit] += len(is_held)
        if trusted:
            widened[unit] += trusted[index][0]
            unlike[unit] += trusted[index][1]
    return Coverage(
        names=tuple(names),
        actions=tuple(actions[n] for n in names),
        held=held,
        known=known,
        windows=windows,
        widened_in=widened,
        unlike_in=unlike,
    )
