"""Growth of radii with a tracker's noise: ``zones.input_noise``.

Recordings are scored as recorded and as live depth trackers deliver them (``depth_tracker``). For
each error e of a noisy window with the radius r, the growth that would have held it is the root of
e² - r² over the noise. Its quantile at the stated level would be enough if the coverage without
noise were the stated one; it is higher on the recordings that a calibration rests on, and lower on
new ones. So the quantile at the *aim* is used: half-way between the level and the coverage without
noise. Recordings have equal weights, as in ``conformal``.
"""

import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.predictor import Predictor
from hri_predict.lab.calibration.depth_tracker import RATE_HZ, DepthTracker
from hri_predict.lab.calibration.presence import Presence, of_each
from hri_predict.lab.calibration.quantiles import LEAST_RECORDINGS, of_equals
from hri_predict.lab.calibration.scores import Scores, evidence_of, score_presence, units
from hri_predict.zones.calibration import OFS, Calibration
from hri_predict.zones.input_noise import MOST_GROWTH, NoiseGrowth, input_noise_m
from hri_predict.zones.learned_scale import KNOT_STEPS
from hri_predict.zones.radii import Radii
from hri_predict.zones.settings import LEVELS, CoverageSettings

SECONDS = 8.0
"""Scored duration of each presence, from its start."""
EACH = 3
"""Every third window is used, because neighbours are alike."""
FITTED_TO = (DepthTracker(), DepthTracker(strength=2.0))
_LEAST_NOISE_M = 1e-4
_LEAST_WINDOWS = 5

See = Callable[[Presence, int], Presence]
"""Maps a presence and a seed to the presence that a tracker delivers."""


def as_recorded(presence: Presence, seed: int) -> Presence:
    """A tracker without noise, at the rate of the others."""
    del seed
    every = max(1, round(presence.rate_hz / RATE_HZ))
    return presence.only(np.arange(0, len(presence.stamps_ns), every))


def scores_seen(
    predictor: Predictor,
    recordings: Sequence[Path],
    see: See,
    *,
    seed: int,
    joint_map: JointMap | None = None,
    on_recording: Callable[[str], None] = lambda _: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Scores]:
    """Score a predictor on the start of recordings as a tracker sees them.

    The truth is what the tracker delivers later, because the node compares zones with captures.

    Args:
        predictor: on canonical joints.
        recordings: files; those that cannot be used are left out.
        see: the tracker.
        seed: seed of all noise.
        joint_map: the user's own for the files' joints; default: found by their names.
        on_recording: called with the name of each recording when it is done.
        on_left_out: called with one line for each recording that is left out.

    Raises:
        RecordingError: a file cannot be read.
    """

    def scored(name: str, action: str, presences: Sequence[Presence]) -> list[Scores]:
        found = []
        for i, presence in enumerate(presences):
            since_ns = presence.stamps_ns - presence.stamps_ns[0]
            begin = presence.only(np.flatnonzero(since_ns <= SECONDS * 1e9))
            if len(begin.stamps_ns) < 2:
                continue
            seen = see(begin, zlib.crc32(name.encode()) + i + 1_000_003 * seed)
            found.append(score_presence(predictor, name, action, seen))
        return [s for s in found if s is not None]

    found, _ = of_each(
        recordings,
        lambda name, recording, presences: scored(name, recording.action, presences),
        joint_map=joint_map,
        nobody="no person is seen for long enough",
        on_recording=on_recording,
        on_left_out=on_left_out,
    )
    return found


def with_noise(
    calibration: Calibration,
    *,
    clean: Sequence[Scores],
    noisy: Sequence[Scores],
    skeleton: Skeleton,
) -> Calibration:
    """Return the calibration, completed by the growth of its radii with noise.

    Args:
        calibration: calibration of the scored predictor.
        clean, noisy: scores of the recordings that the calibration was made with, see
            ``scores_seen``.
        skeleton: skeleton of the forecasts.

    Raises:
        ConfigError: fewer than ``LEAST_RECORDINGS`` recordings are usable, or noisy. At a single
            step, the calibration's own growth, if it has one, stays instead.
    """
    _demand_recordings(clean, noisy, skeleton)
    bare = replace(calibration, noise=None)
    table = {of: np.zeros((len(LEVELS), calibration.steps)) for of in OFS}
    for of in OFS:
        for i, level in enumerate(LEVELS):
            settings = CoverageSettings(level=level, of=of)
            without = _judged(bare, clean, settings, skeleton)
            old = None if calibration.noise is None else calibration.noise.table[of][i]
            table[of][i] = _growth(without, _judged(bare, noisy, settings, skeleton), level, old)
        # neither a higher level nor a longer step grows less
        table[of] = np.maximum.accumulate(np.maximum.accumulate(table[of], axis=0), axis=1)
    return replace(calibration, noise=NoiseGrowth(table))


def _demand_recordings(
    clean: Sequence[Scores], noisy: Sequence[Scores], skeleton: Skeleton
) -> None:
    count = len(units(clean))
    if count < LEAST_RECORDINGS:
        raise ConfigError(
            f"--data: too few recordings ({count}): in each, a person must be seen for long "
            f"enough; give {LEAST_RECORDINGS} at least"
        )
    shown = [
        np.concatenate([_noise_m(noisy[i], skeleton) for i in own]) for own in units(noisy).values()
    ]
    count = sum(_is_noisy(noise_m).sum() >= _LEAST_WINDOWS for noise_m in shown)
    if count < LEAST_RECORDINGS:
        raise ConfigError(
            f"--data: too few recordings ({count}) show a tracker's noise: it is measured at arms "
            f"and legs; give {LEAST_RECORDINGS} at least in which these are visible"
        )


def _noise_m(entry: Scores, skeleton: Skeleton) -> Floats:
    """(W,) metres of noise in each used window."""
    some = slice(None, None, EACH)
    return input_noise_m(entry.history[some], entry.observed[some], skeleton)


def _is_noisy(noise_m: Floats) -> Bools:
    return noise_m > _LEAST_NOISE_M


class _Judged(NamedTuple):
    """The windows of one recording: (W,) noise; (W, H, J) errors and radii, NaN if not known."""

    noise_m: Floats
    error_m: Floats
    radius_m: Floats
    whole_body: bool

    def held(self, step: int) -> Bools:
        """Return whether each joint, or each body, with a known error was held at a step."""
        known = np.isfinite(self.error_m[:, step])
        inside = self.error_m[:, step] <= self.radius_m[:, step]
        if self.whole_body:
            return np.asarray((inside | ~known).all(1))[known.any(1)]
        return np.asarray(inside[known])

    def needed(self, step: int) -> Floats:
        """The growth that holds each joint, or each body, of a noisy window."""
        noisy = _is_noisy(self.noise_m)
        if noisy.sum() < _LEAST_WINDOWS:
            return np.zeros(0)
        error, radius = self.error_m[noisy, step], self.radius_m[noisy, step]
        short = np.sqrt(np.maximum(error**2 - radius**2, 0.0)) / self.noise_m[noisy, None]
        known = np.isfinite(short)
        if self.whole_body:
            worst: Floats = np.where(known, short, 0.0).max(1)[known.any(1)]
            return worst
        return np.asarray(short[known])


def _judged(
    calibration: Calibration,
    scores: Sequence[Scores],
    settings: CoverageSettings,
    skeleton: Skeleton,
) -> list[_Judged]:
    steps, found = calibration.steps, []
    some = slice(None, None, EACH)
    for own in units(scores).values():
        parts = [scores[i] for i in own]
        radius = np.concatenate(
            [
                Radii(calibration, settings, skeleton, s.forecast.shape[1]).of(
                    s.speed_m_s, evidence_of(s)
                )[some, :steps]
                for s in parts
            ]
        )
        error = np.concatenate([s.error_m[some, :steps] for s in parts])
        noise = [_noise_m(s, skeleton) for s in parts]
        error = np.where(np.isfinite(radius), error, np.nan)
        found.append(_Judged(np.concatenate(noise), error, radius, settings.of == "body"))
    return found


def _growth(
    clean: Sequence[_Judged], noisy: Sequence[_Judged], level: float, old: Floats | None
) -> Floats:
    """(H,) quantile of the needed growth at the aim; ``old`` where too few recordings show it.

    Raises:
        ConfigError: too few recordings show it, and there is no ``old``.
    """
    steps = clean[0].error_m.shape[1]
    knots = sorted({*(k - 1 for k in KNOT_STEPS if k <= steps), steps - 1})
    found = []
    for step in knots:
        held = [h for h in (j.held(step) for j in clean) if h.size]
        share = float(np.mean([h.mean() for h in held])) if held else level
        needed = [n for n in (j.needed(step) for j in noisy) if n.size]
        aim = level + max(share - level, 0.0) / 2.0
        if len(needed) >= LEAST_RECORDINGS:
            found.append(min(of_equals(needed, aim), MOST_GROWTH))
        elif old is not None:
            found.append(float(old[step]))
        else:  # 0 would say that zones need not grow
            raise ConfigError(
                f"--data: too few recordings ({len(needed)}) are long enough to measure step "
                f"{step + 1} of {steps}; give {LEAST_RECORDINGS} at least that are longer"
            )
    return np.interp(np.arange(steps), knots, found)
