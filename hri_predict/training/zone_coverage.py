"""How often zones held people, and how large they were: measured on recordings.

*As calibrated* compares errors with radii. *As run* builds the zones as the node does, tick after
tick, with the cut to what bodies can do and (if asked) the live self-check, and looks whether each
joint stayed inside during each interval.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from hri_predict.predictors.base import Forecast, Predictor
from hri_predict.risk.calibration import Calibration, Radii
from hri_predict.risk.joint_zones import JointBalls, JointZones
from hri_predict.risk.self_check import SelfCheck, SelfCheckSettings, Trust
from hri_predict.risk.settings import CoverageSettings, HumanLimits
from hri_predict.scene import Bools, Floats
from hri_predict.skeleton import Skeleton
from hri_predict.snapshot import PeopleSnapshot
from hri_predict.training.zone_scores import Scores

RESAMPLES = 2000
INTERVAL = (0.025, 0.975)


@dataclass(frozen=True, slots=True, eq=False)
class Coverage:
    """Counts by recording. U recordings, H steps.

    Attributes:
        names, actions: of the recordings.
        held, known: per question, (U, H) how often inside, and how often that is known.
        widened, unlike: shares of windows in which zones were widened, or physical limits served.
    """

    names: tuple[str, ...]
    actions: tuple[str, ...]
    held: dict[str, Floats]
    known: dict[str, Floats]
    widened: float = 0.0
    unlike: float = 0.0

    def of_action(self, action: str) -> "Coverage":
        """The recordings of one action alone."""
        own = [i for i, a in enumerate(self.actions) if a == action]
        return replace(
            self,
            names=tuple(self.names[i] for i in own),
            actions=tuple(self.actions[i] for i in own),
            held={of: table[own] for of, table in self.held.items()},
            known={of: table[own] for of, table in self.known.items()},
        )

    def share(self, of: str) -> Floats:
        """(H,) share inside, pooled over all windows; NaN where nothing is known."""
        return _ratio(self.held[of].sum(0), self.known[of].sum(0))

    def interval(self, of: str, seed: int = 0) -> tuple[Floats, Floats]:
        """(H,) and (H,): 95 % interval of ``share`` from resampling recordings (bootstrap)."""
        count = len(self.names)
        draws = np.random.default_rng(seed).multinomial(count, np.full(count, 1 / count), RESAMPLES)
        shares = _ratio(draws @ self.held[of], draws @ self.known[of])
        low, high = (_nanquantile(shares, q) for q in INTERVAL)
        return low, high


def _ratio(held: Floats, known: Floats) -> Floats:
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
        radius = radii.of(entry.speed_m_s, entry.surprise_m)
        calibrated = np.isfinite(radius)
        known = np.isfinite(entry.error_m) & calibrated
        inside.append((known & (entry.error_m <= radius), known))
    return _collected(scores, inside)


def as_run(
    scores: Sequence[Scores],
    calibration: Calibration,
    settings: CoverageSettings,
    predictor: Predictor,
    limits: HumanLimits | None = None,
) -> Coverage:
    """Zones as the node builds them, window after window of each presence."""
    inside, widened, unlike, count = [], 0, 0, 0
    for entry in scores:
        held = np.zeros(entry.error_m.shape, dtype=bool)
        for window, (balls, trust) in enumerate(
            run_zones(entry, calibration, settings, predictor, limits)
        ):
            held[window] = _holds(entry, window, balls, predictor.rate_hz)
            widened += bool((trust.widen > 1).any())
            unlike += bool(trust.unlike.any())
            count += 1
        known = np.isfinite(entry.error_m)
        inside.append((held & known, known))
    result = _collected(scores, inside)
    return replace(result, widened=widened / max(count, 1), unlike=unlike / max(count, 1))


def run_zones(
    entry: Scores,
    calibration: Calibration,
    settings: CoverageSettings,
    predictor: Predictor,
    limits: HumanLimits | None = None,
) -> "list[tuple[JointBalls, Trust]]":
    """The joints' zones of every window, in order, with what the self-check knew by then."""
    rate_hz, steps = predictor.rate_hz, entry.error_m.shape[1]
    skeleton = predictor.skeleton
    check = SelfCheck(
        SelfCheckSettings(),
        settings.level,
        settings.of,
        rate_hz,
        steps,
        calibration.motion_ranges(skeleton),
    )
    builder = JointZones(
        skeleton,
        limits or HumanLimits(),
        rate_hz,
        steps,
        np.arange(steps + 1) / rate_hz,
        Radii(calibration, settings, skeleton, steps),
    )
    found = []
    for window in range(len(entry.origin_ns)):
        snapshot = snapshot_of(entry, window, predictor.history_steps)
        forecast = Forecast(entry.forecast[window][None], None)
        trust = check.check(snapshot)
        if not settings.self_check:
            trust = trust.surprise_alone()
        balls = builder.build(snapshot, forecast, int(entry.origin_ns[window]), trust)
        assert balls.claimed is not None
        check.note(snapshot, forecast, balls.claimed)
        found.append((balls, trust))
    return found


def snapshot_of(entry: Scores, window: int, history_steps: int) -> PeopleSnapshot:
    """What the node would know at one window: a single person, at the capture itself."""
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


def _holds(entry: Scores, window: int, balls: JointBalls, rate_hz: float) -> Bools:
    """(H, J) whether a joint was in its ball at every capture of each interval."""
    truth, steps = entry.truth, entry.error_m.shape[1]
    at = int(truth.stamps_ns.searchsorted(entry.origin_ns[window]))
    end = int(entry.origin_ns[window] + round(steps * 1e9 / rate_hz))
    ahead = slice(at + 1, int(truth.stamps_ns.searchsorted(end, side="right")))
    passed = (truth.stamps_ns[ahead] - entry.origin_ns[window]) * 1e-9 * rate_hz
    interval = np.clip(np.ceil(passed - 1e-6).astype(np.intp), 1, steps)
    apart = np.linalg.norm(truth.positions[ahead] - balls.mid[0, interval], axis=-1)
    outside = apart > balls.radius[0, interval] + 1e-9
    held = np.ones((steps + 1, outside.shape[1]), dtype=bool)
    np.logical_and.at(held, interval, ~outside)
    return held[1:]


def _collected(scores: Sequence[Scores], inside: Sequence[tuple[Bools, Bools]]) -> Coverage:
    """Counts by recording from (W, H, J) held and known of each presence."""
    names = list(dict.fromkeys(s.name for s in scores))
    actions = {s.name: s.action for s in scores}
    steps = scores[0].error_m.shape[1]
    held = {of: np.zeros((len(names), steps)) for of in ("joint", "body")}
    known = {of: np.zeros((len(names), steps)) for of in ("joint", "body")}
    for entry, (is_held, is_known) in zip(scores, inside, strict=True):
        unit = names.index(entry.name)
        held["joint"][unit] += is_held.sum((0, 2))
        known["joint"][unit] += is_known.sum((0, 2))
        anybody = is_known.any(2)
        held["body"][unit] += (anybody & (is_held | ~is_known).all(2)).sum(0)
        known["body"][unit] += anybody.sum(0)
    return Coverage(tuple(names), tuple(actions[n] for n in names), held, known)
