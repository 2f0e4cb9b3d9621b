"""Distances between people and their forecasts: the scores that radii are calibrated from.

Windows are cut as in the running node: canonical joints, a window that ends at a capture, histories
resampled by the node's ring buffer, origins 40 ms apart. The error of step k is the largest
distance of a joint from the forecast's path (linear between steps) at any capture *during* the
interval that ends with the step, because a zone must hold the body during the whole interval.
"""

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.errors import RecordingError
from hri_predict.base.work.workers import Workers
from hri_predict.contracts import registry
from hri_predict.contracts.joint_map import JointMap
from hri_predict.contracts.predictor import Predictor, PredictorSettings, checked
from hri_predict.lab.calibration.presence import Presence, as_tracked, gap_ns, of_each, of_one
from hri_predict.lab.datasets.tracks import nearest
from hri_predict.people.ring_buffer import resample
from hri_predict.recording.recording import Recording, names_of
from hri_predict.zones.human_speed import joint_velocities
from hri_predict.zones.joint_zones import SETTLED_STEPS
from hri_predict.zones.learned_scale import LEAD_TOLERANCE_S, LEADS_S, Evidence
from hri_predict.zones.motion_class import RESIDUAL_S, trunk_speed
from hri_predict.zones.self_check.past_forecasts import forecast_errors, mean_error

HISTORY_STEPS = 15
"""Minimum number of history steps; the oldest may be unobserved."""
_BATCH = 128
_LEAST_WINDOWS = 5


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Scores:
    """The windows of one presence. W windows, T steps of history, H steps ahead, J joints.

    Attributes:
        name: the recording, see ``names_of``; all its presences are one independent unit.
        digest: SHA-256 of its file; ``None`` without a file.
        action: action of the people in it.
        origin_ns: (W,) forecast origins: capture times.
        history, observed: (W, T, J, 3) metres and (W, T, J), T at least ``HISTORY_STEPS``.
        forecast: (W, H, J, 3).
        error_m: (W, H, J) metres, see the module; NaN where the truth is not known.
        speed_m_s: (W,) speed of the trunk; NaN where not known.
        residual_m: (W,) see ``motion_class``; NaN where no forecast is old enough.
        past_error_m: (W, 2, J) see ``learned_scale.Evidence.error_m``.
        truth: the true motion.
        std: (W, H, J) metres, standard deviation that the forecasts state; ``None``: none.
    """

    name: str
    action: str
    origin_ns: NDArray[np.int64]
    history: Floats
    observed: Bools
    forecast: Floats
    error_m: Floats
    speed_m_s: Floats
    residual_m: Floats
    past_error_m: Floats
    truth: Presence
    digest: str | None = None
    std: Floats | None = None

    def only(self, windows: slice) -> "Scores":
        """The scores of some windows; ``truth`` stays complete."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        parts: dict[str, Any] = {k: v[windows] for k, v in own.items() if isinstance(v, np.ndarray)}
        return replace(self, **parts)


def evidence_of(entry: Scores) -> Evidence:
    """Return the evidence that the node has at each window."""
    return Evidence(
        history=entry.history,
        observed=entry.observed,
        forecast=entry.forecast,
        error_m=entry.past_error_m,
        residual_m=entry.residual_m,
        std=entry.std,
    )


def score_recordings(
    predictor: Predictor,
    recordings: Sequence[Path | Recording],
    *,
    on_recording: Callable[[str], None] = lambda _: None,
    on_left_out: Callable[[str], None] = lambda _: None,
    joint_map: JointMap | None = None,
    tracked: bool = False,
) -> list[Scores]:
    """Score a predictor on canonical joints; recordings that cannot be used are left out.

    Args:
        predictor: on canonical joints.
        recordings: files, or recordings in memory.
        on_recording: called with the name of each recording when it is done.
        on_left_out: called with one line for each recording that is left out.
        joint_map: the user's own for the files' joints; default: found by their names.
        tracked: each recording counts a second time, as a tracker would deliver it.

    Raises:
        RecordingError: a file cannot be read, or no recording can be used: too slow, of unknown
            joints, or without a window.
        PredictorError: the predictor breaks its contract.
    """

    found, left_out = of_each(
        recordings,
        lambda name, recording, presences: _scored(
            predictor, name, recording, presences, tracked=tracked
        ),
        joint_map=joint_map,
        nobody=_nobody(predictor),
        on_recording=on_recording,
        on_left_out=on_left_out,
    )
    _demand_some(found, left_out)
    return found


def scores_by(
    workers: Workers,
    settings: PredictorSettings,
    paths: Sequence[Path],
    *,
    on_recording: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
    joint_map: JointMap | None = None,
    tracked: bool = False,
) -> list[Scores]:
    """``score_recordings`` with workers: a task is one file, which a worker reads.

    Args:
        workers: workers that run the tasks.
        settings: settings of the predictor, which each worker builds for itself.
        paths, on_recording, on_left_out, joint_map, tracked: see ``score_recordings``.

    Raises:
        HriPredictError: see ``score_recordings`` and ``Workers.each``.
    """
    names = names_of(paths)
    tasks = [
        (_File(settings, path, name, joint_map, tracked),)
        for path, name in zip(paths, names, strict=True)
    ]
    results = workers.in_order(_of_file, tasks, on_recording)
    left_out = [problem for _, problem in results if problem]
    for problem in left_out:
        on_left_out(f"{problem}; left out")
    found = [entry for scored, _ in results for entry in scored]
    _demand_some(found, left_out)
    return found


class _File(NamedTuple):
    """A task; see ``scores_by``."""

    settings: PredictorSettings
    path: Path
    name: str
    joint_map: JointMap | None
    tracked: bool


def _of_file(file: _File) -> tuple[list[Scores], str]:
    """The scores of one file, and why it is left out, or ""."""
    predictor = _built(file.settings.name, file.settings.model_dump_json())
    return of_one(
        file.path,
        lambda recording, presences: _scored(
            predictor, file.name, recording, presences, tracked=file.tracked
        ),
        file.joint_map,
        _nobody(predictor),
    )


@lru_cache(maxsize=4)
def _built(method: str, settings: str) -> Predictor:
    cls = registry.load("predictors", method)
    predictor: Predictor = cls(cls.settings_model.model_validate_json(settings))
    return predictor


def _scored(
    predictor: Predictor,
    name: str,
    recording: Recording,
    presences: Sequence[Presence],
    *,
    tracked: bool,
) -> list[Scores]:
    scored = [score_presence(predictor, name, recording.action, p) for p in presences]
    if tracked:
        seed = zlib.crc32(name.encode())
        drawn = [as_tracked(p, seed + i) for i, p in enumerate(presences)]
        scored += [
            score_presence(predictor, name, recording.action, seen, delivered=delivered)
            for seen, delivered in drawn
        ]
    return [replace(s, digest=recording.digest) for s in scored if s is not None]


def _nobody(predictor: Predictor) -> str:
    least_s = (SETTLED_STEPS + 2 * _LEAST_WINDOWS) / predictor.rate_hz
    return f"no person is seen for {least_s:g} s without a break"


def _demand_some(found: Sequence[Scores], left_out: Sequence[str]) -> None:
    if left_out and not found:
        raise RecordingError(f"{left_out[0]}, and no other recording is left; give others")


def score_presence(
    predictor: Predictor,
    name: str,
    action: str,
    presence: Presence,
    *,
    delivered: Ints | None = None,
) -> Scores | None:
    """Score one presence of the recording ``name``; ``None`` if it is too short.

    Args:
        predictor, name, action: see ``Scores``.
        presence: the truth.
        delivered: captures that the predictor sees; ``None``: all.
    """
    seen = presence if delivered is None else presence.only(delivered)
    if len(seen.stamps_ns) < 2:
        return None
    at = _origins(seen, predictor.rate_hz)
    if len(at) < _LEAST_WINDOWS:
        return None
    steps = max(predictor.history_steps, HISTORY_STEPS)
    windows = [window_at(seen, int(i), steps, predictor.rate_hz) for i in at]
    history = np.stack([w[0] for w in windows])
    observed = np.stack([w[1] for w in windows])
    own = slice(steps - predictor.history_steps, None)
    made = [
        checked(predictor.predict(h[:, own], o[:, own]), len(h), predictor)
        for h, o in _batches(history, observed)
    ]
    forecast = np.concatenate([each.positions for each in made])
    stated = [each.std for each in made if each.std is not None]
    true = at if delivered is None else delivered[at]
    error = np.stack(
        [
            _errors(presence, int(i), f, predictor.rate_hz)
            for i, f in zip(true, forecast, strict=True)
        ]
    )
    return Scores(
        name=name,
        action=action,
        origin_ns=seen.stamps_ns[at],
        history=history,
        observed=observed,
        forecast=forecast,
        error_m=error,
        speed_m_s=trunk_speed(
            joint_velocities(history, observed, predictor.rate_hz), predictor.skeleton
        ),
        residual_m=_residual(seen, at, forecast, predictor.rate_hz),
        past_error_m=_past_errors(seen, at, forecast, predictor.rate_hz),
        truth=presence,
        std=np.concatenate(stated) if len(stated) == len(made) else None,
    )


def window_at(presence: Presence, index: int, steps: int, rate_hz: float) -> tuple[Floats, Bools]:
    """History (T, J, 3) and mask (T, J) that end at capture ``index``; nothing after it is used."""
    stamps, now = presence.stamps_ns, int(presence.stamps_ns[index])
    most_ns = gap_ns(presence.rate_hz)
    first = int(stamps.searchsorted(now - round(steps * 1e9 / rate_hz) - most_ns))
    held = slice(first, index + 1)
    window = resample(
        stamps=stamps[held],
        positions=presence.positions[held],
        observed=presence.observed[held],
        t_end_ns=now,
        n=steps,
        rate_hz=rate_hz,
        max_gap_ns=most_ns,
    )
    return window.positions, window.observed


def _origins(presence: Presence, rate_hz: float) -> NDArray[np.intp]:
    """Indices of the captures nearest to a grid of ``rate_hz`` that starts with the presence."""
    stamps = presence.stamps_ns
    step_ns = 1e9 / rate_hz
    count = int((stamps[-1] - stamps[0]) / step_ns) + 1
    grid = stamps[0] + np.round(step_ns * np.arange(SETTLED_STEPS - 1, count)).astype(np.int64)
    at = np.unique(nearest(stamps, grid))
    if grid.size:  # a capture before the eighth step has only seven
        at = at[stamps[at] >= grid[0]]
    result: NDArray[np.intp] = at[stamps[at] + step_ns <= stamps[-1]]
    return result


def _errors(presence: Presence, index: int, forecast: Floats, rate_hz: float) -> Floats:
    """(H, J) largest distance from the forecast's path during each step's interval."""
    stamps, (steps, joints) = presence.stamps_ns, forecast.shape[:2]
    end_ns = stamps[index] + round(steps * 1e9 / rate_hz)
    ahead = slice(index + 1, int(stamps.searchsorted(end_ns, side="right")))
    passed = (stamps[ahead] - stamps[index]) * 1e-9 * rate_hz  # steps since the origin
    interval = np.minimum(np.ceil(passed - 1e-6).astype(np.intp) - 1, steps - 1)
    knots = np.concatenate([presence.positions[index][None], forecast])
    path = along(knots, passed)
    seen = presence.observed[ahead] & presence.observed[index]
    distance = np.linalg.norm(path - presence.positions[ahead], axis=-1)
    distance = np.where(seen, distance, np.nan)
    result = np.full((steps, joints), np.nan)
    for step in np.unique(interval):  # one unseen capture makes the whole interval unknown
        result[step] = distance[interval == step].max(axis=0)
    return result


def along(knots: Floats, steps: Floats) -> Floats:
    """(M, ...) a path of knots (N, ...) at fractional steps (M,), linear in between."""
    below = np.clip(np.floor(steps).astype(np.intp), 0, len(knots) - 2)
    part = (steps - below).reshape(-1, *(1 for _ in knots.shape[1:]))
    result: Floats = knots[below] + part * (knots[below + 1] - knots[below])
    return result


def _residual(presence: Presence, at: NDArray[np.intp], forecast: Floats, rate_hz: float) -> Floats:
    """(W,) maximum over the last ``RESIDUAL_S`` of the mean error of forecasts of that age.

    The age is a time, as in the live self-check: origins are farther apart than steps where
    captures are sparse.
    """
    stamps, back_ns = presence.stamps_ns[at], round(RESIDUAL_S * 1e9)
    made = nearest(stamps, stamps - back_ns)
    steps = (stamps - stamps[made]).astype(np.float64) * (1e-9 * rate_hz)
    near = np.abs(steps - RESIDUAL_S * rate_hz) <= 0.5 + 1e-6
    judged = np.flatnonzero(near & (steps <= forecast.shape[1] + 1e-6))
    now, then = at[judged], at[made[judged]]
    error = forecast_errors(
        presence.positions[then], forecast[made[judged]], steps[judged], presence.positions[now]
    )
    value = np.full(len(at), -np.inf)
    mean = mean_error(error, presence.observed[now] & presence.observed[then])
    value[judged] = np.where(np.isnan(mean), -np.inf, mean)
    since = stamps.searchsorted(stamps - back_ns)
    largest = np.array([value[first : i + 1].max() for i, first in enumerate(since)])
    return np.where(largest >= 0, largest, np.nan)


def _past_errors(
    presence: Presence, at: NDArray[np.intp], forecast: Floats, rate_hz: float
) -> Floats:
    """(W, 2, J) errors at each origin of the forecasts made ``LEADS_S`` before; NaN if unknown."""
    stamps = presence.stamps_ns[at]
    found = np.full((len(at), len(LEADS_S), presence.positions.shape[1]), np.nan)
    for i, (lead_s, within_s) in enumerate(zip(LEADS_S, LEAD_TOLERANCE_S, strict=True)):
        made = nearest(stamps, stamps - round(lead_s * 1e9))
        age_s = (stamps - stamps[made]).astype(np.float64) * 1e-9
        near = (np.abs(age_s - lead_s) <= within_s + 1e-9) & (age_s > 0)
        judged = np.flatnonzero(near & (age_s * rate_hz <= forecast.shape[1] + 1e-6))
        now, then = at[judged], at[made[judged]]
        error = forecast_errors(
            presence.positions[then],
            forecast[made[judged]],
            age_s[judged] * rate_hz,
            presence.positions[now],
        )
        seen = presence.observed[now] & presence.observed[then]
        found[judged, i] = np.where(seen, error, np.nan)
    return found


def _batches(history: Floats, observed: Bools) -> list[tuple[Floats, Bools]]:
    return [
        (history[i : i + _BATCH], observed[i : i + _BATCH]) for i in range(0, len(history), _BATCH)
    ]


def units(scores: Sequence[Scores]) -> Mapping[str, list[int]]:
    """Recording -> indices of its presences, in order."""
    found: dict[str, list[int]] = {}
    for index, entry in enumerate(scores):
        found.setdefault(entry.name, []).append(index)
    return found
