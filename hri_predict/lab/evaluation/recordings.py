"""Evaluation on recordings: forecasts against people's true motion, in seconds and metres.

Errors are distances between predicted and true joints in the room, the person's travel included, on
the pelvis and the 25 joints of the CMU benchmark, wherever the truth is known. A mean is over all
joint-frames of an action's windows; the headline is the mean over five actions with equal weights.
``running`` (too short for 1 s), ``walking_extra`` and the seated arms are reported separately.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import PredictorError
from hri_predict.base.work.workers import Workers
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Predictor, PredictorSettings, checked
from hri_predict.lab.datasets.corruption import Corruption
from hri_predict.lab.evaluation.table import HORIZONS_MS
from hri_predict.lab.evaluation.windows import (
    FUTURE_STEPS,
    HORIZON_STEPS,
    ORIGIN_STEPS,
    RATE_HZ,
    Batch,
    Motion,
    batches,
    read_motions,
    scored_joints,
)
from hri_predict.predictors.baselines import ConstantVelocitySettings, ZeroVelocitySettings
from hri_predict.predictors.kalman import KalmanSettings
from hri_predict.predictors.neural.body import BODY
from hri_predict.recording.recording import Recording

MEAN_ACTIONS = ("basketball", "jumping", "soccer", "walking", "washwindow")
"""The actions of the headline mean: those with a test recording long enough for 1 s."""
_SCORED = scored_joints()


@dataclass(slots=True, eq=False)
class Errors:
    """Sums over one action's windows.

    Attributes:
        windows: number of windows.
        total_m: (H, 28) sum of errors by step and joint, metres.
        count: (H, 28) number of errors summed.
    """

    windows: int
    total_m: Floats
    count: Floats

    @classmethod
    def none(cls, steps: int) -> "Errors":
        """Sums over no window."""
        return cls(0, *np.zeros((2, steps, len(BODY.joints))))

    def by_step(self) -> Floats:
        """(H,) mean error in millimetres 40, 80, ... ms ahead; NaN where nothing is known."""
        return _mean_mm(self.total_m.sum(axis=1), self.count.sum(axis=1))

    def by_joint(self) -> Floats:
        """(H, 28) mean error in millimetres; NaN where nothing is known, and at the hips."""
        return _mean_mm(self.total_m, self.count)


@dataclass(frozen=True, slots=True, eq=False)
class RecordingResult:
    """Results of one predictor under one condition.

    Attributes:
        predictor: its name.
        corruption: disturbance of its input; ``None`` if none.
        actions: errors by action, in the order of the recordings.
    """

    predictor: str
    corruption: Corruption | None
    actions: Mapping[str, Errors]

    @property
    def averaged(self) -> tuple[str, ...]:
        """Actions of the mean: those of ``MEAN_ACTIONS`` that occur, or all if none does."""
        return tuple(a for a in MEAN_ACTIONS if a in self.actions) or tuple(self.actions)

    @property
    def steps(self) -> int:
        """H, the steps evaluated."""
        return max((len(e.count) for e in self.actions.values()), default=FUTURE_STEPS)

    @property
    def horizons_ms(self) -> tuple[int, ...]:
        """Those of ``HORIZONS_MS`` that are evaluated."""
        return HORIZONS_MS[: len(_within(self.steps))]

    @property
    def joint_horizons_ms(self) -> tuple[int, ...]:
        """Horizons shown by joint: 400 and 1000 ms where evaluated, else the longest one."""
        found = tuple(ms for ms in (400, 1000) if ms in self.horizons_ms)
        return found or self.horizons_ms[-1:]

    def action_mm(self, action: str) -> Floats:
        """Mean error in millimetres at ``horizons_ms``; NaN beyond the recording's end."""
        return at_horizons(self.actions[action].by_step())

    def mean_by_step(self) -> Floats:
        """(H,) mean over ``averaged``, all actions with the same weight; NaN if there is none."""
        if not self.averaged:
            return np.full(self.steps, np.nan)
        result: Floats = np.mean([self.actions[a].by_step() for a in self.averaged], axis=0)
        return result

    def mean_mm(self) -> Floats:
        """The headline: ``mean_by_step`` at ``horizons_ms``."""
        return at_horizons(self.mean_by_step())

    def overall_mm(self) -> float:
        """Mean of ``mean_mm`` over the horizons that all of ``averaged`` reach; NaN if none."""
        reached = self.mean_mm()[np.isfinite(self.mean_mm())]
        return float(reached.mean()) if reached.size else math.nan

    def mean_by_joint(self) -> Floats:
        """(H, 28) mean over ``averaged`` by joint, millimetres."""
        if not self.averaged:
            return np.full((self.steps, len(BODY.joints)), np.nan)
        result: Floats = np.mean([self.actions[a].by_joint() for a in self.averaged], axis=0)
        return result


def _mean_mm(total_m: Floats, count: Floats) -> Floats:
    return np.where(count > 0, 1000.0 * total_m / np.maximum(count, 1), np.nan)


def at_horizons(by_step: Floats) -> Floats:
    """Pick the steps of ``RecordingResult.horizons_ms`` from (H, ...)."""
    return by_step[np.array(_within(len(by_step)), dtype=int) - 1]


def _within(steps: int) -> list[int]:
    return [step for step in HORIZON_STEPS if step <= steps]


def judge_one(
    predictor: Predictor,
    recordings: Sequence[Path | Recording | Motion],
    corruption: Corruption | None = None,
    name: str | None = None,
) -> RecordingResult:
    """Evaluate one predictor; see ``judge_all``."""
    name = name or type(predictor).__name__
    return judge_all({name: predictor}, recordings, corruption)[0]


def judge_all(
    predictors: Mapping[str, Predictor],
    recordings: Sequence[Path | Recording | Motion],
    corruption: Corruption | None = None,
    future_steps: int = FUTURE_STEPS,
) -> list[RecordingResult]:
    """Evaluate predictors on the same windows.

    Args:
        predictors: by name; on ``BODY`` and at 25 Hz. Errors beyond a predictor's own horizon are
            NaN.
        recordings: files, recordings, or what ``read_motions`` made of them.
        corruption: applied to every history.
        future_steps: number of steps evaluated; see ``windows.batches``.

    Raises:
        PredictorError: a predictor works on other joints or another rate, or breaks its contract.
        RecordingError: a file cannot be read.
    """
    for name, predictor in predictors.items():
        _check(name, predictor)
    parts = [
        (motion.action, _of_motion(predictors, motion, corruption, future_steps))
        for motion in _read(recordings)
    ]
    return _summed(list(predictors), corruption, parts)


def judge_by(
    workers: Workers,
    predictors: Mapping[str, PredictorSettings],
    motions: Sequence[Motion],
    corruption: Corruption | None = None,
    *,
    future_steps: int = FUTURE_STEPS,
    on_motion: Callable[[], None] = lambda: None,
) -> list[RecordingResult]:
    """``judge_all`` with workers: a task is one motion, which is sent to the worker.

    Args:
        workers: workers that run the tasks.
        predictors: settings by name; each worker builds its own.
        motions, corruption, future_steps: see ``judge_all``.
        on_motion: called when a motion is done.

    Raises:
        HriPredictError: see ``judge_all`` and ``Workers.each``.
    """
    tasks = [(dict(predictors), motion, corruption, future_steps) for motion in motions]
    found = workers.in_order(_by_settings, tasks, on_motion)
    parts = [(motion.action, errors) for motion, errors in zip(motions, found, strict=True)]
    return _summed(list(predictors), corruption, parts)


def _by_settings(
    asked: Mapping[str, PredictorSettings],
    motion: Motion,
    corruption: Corruption | None,
    future_steps: int,
) -> dict[str, Errors]:
    """A task: all predictors on one motion."""
    predictors = {name: built(how) for name, how in asked.items()}
    return _of_motion(predictors, motion, corruption, future_steps)


def built(settings: PredictorSettings) -> Predictor:
    """A predictor for the evaluated joints, built once in each process.

    Raises:
        PredictorError: it cannot be built, or works at another rate.
    """
    return _built(settings.name, settings.model_dump_json())


@lru_cache(maxsize=32)
def _built(method: str, settings: str) -> Predictor:
    cls = registry.load("predictors", method)
    predictor = cls(cls.settings_model.model_validate_json(settings), BODY)
    _check(method, predictor)
    return predictor


def _of_motion(
    predictors: Mapping[str, Predictor],
    motion: Motion,
    corruption: Corruption | None,
    future_steps: int,
) -> dict[str, Errors]:
    """Each predictor's errors on one motion; none if it is too short for a window."""
    longest = max([ORIGIN_STEPS, *(p.history_steps for p in predictors.values())])
    sums: dict[str, Errors] = {}
    for batch in batches(motion, longest, future_steps):
        disturbed = _disturbed(batch, corruption)
        for name, predictor in predictors.items():
            try:
                _score(predictor, disturbed, sums.setdefault(name, Errors.none(future_steps)))
            except PredictorError as error:
                raise PredictorError(
                    f"predictor {name}: {error}, on recording {motion.name}; leave it out, or "
                    f"give it other weights"
                ) from error
    return sums


def _summed(
    names: Sequence[str],
    corruption: Corruption | None,
    parts: Sequence[tuple[str, Mapping[str, Errors]]],
) -> list[RecordingResult]:
    """Results from (action, predictor -> errors) of each motion, added in their order."""
    sums: dict[str, dict[str, Errors]] = {name: {} for name in names}
    for action, errors in parts:
        for name, own in errors.items():
            total = sums[name].setdefault(action, Errors.none(len(own.count)))
            total.windows += own.windows
            total.total_m += own.total_m
            total.count += own.count
    return [RecordingResult(name, corruption, sums[name]) for name in names]


def _read(recordings: Sequence[Path | Recording | Motion]) -> Iterable[Motion]:
    for entry in recordings:
        yield from [entry] if isinstance(entry, Motion) else read_motions([entry])


def _check(name: str, predictor: Predictor) -> None:
    if predictor.skeleton.joints != BODY.joints or predictor.rate_hz != RATE_HZ:
        raise PredictorError(
            f"predictor {name}: works on skeleton {predictor.skeleton.name} at "
            f"{predictor.rate_hz:g} Hz; the evaluation on recordings needs {BODY.name} at "
            f"{RATE_HZ:g} Hz"
        )


def _disturbed(batch: Batch, corruption: Corruption | None) -> Batch:
    if corruption is None:
        return batch
    seed = batch.motion.name, batch.index
    history, observed = corruption.apply(batch.history, batch.observed, seed, ORIGIN_STEPS)
    return replace(batch, history=history, observed=observed)


def forecast(predictor: Predictor, batch: Batch) -> Floats:
    """(N, H, 28, 3) forecast from a batch's histories, cut to the steps that are read."""
    steps = predictor.history_steps
    history = np.ascontiguousarray(batch.history[:, -steps:])
    observed = np.ascontiguousarray(batch.observed[:, -steps:])
    result = predictor.predict(history, observed)
    return checked(result, len(history), predictor).positions


def _score(predictor: Predictor, batch: Batch, errors: Errors) -> None:
    predicted = forecast(predictor, batch)
    steps = min(batch.future.shape[1], predicted.shape[1])
    distance = np.linalg.norm(predicted[:, :steps] - batch.future[:, :steps], axis=-1)
    scored = np.zeros_like(batch.known[:, :steps])
    scored[..., _SCORED] = batch.known[:, :steps][..., _SCORED]
    errors.windows += len(batch.history)
    errors.total_m[:steps] += np.where(scored, distance, 0.0).sum(axis=0)
    errors.count[:steps] += scored.sum(axis=0)


def baselines(future_steps: int = FUTURE_STEPS) -> dict[str, PredictorSettings]:
    """Settings of the baselines that are evaluated next to every trained predictor."""
    common = {"horizon_s": future_steps / RATE_HZ, "rate_hz": RATE_HZ}
    return {
        "zero_velocity": ZeroVelocitySettings(name="zero_velocity", **common),
        **{
            f"constant_velocity {ms} ms": ConstantVelocitySettings(
                name="constant_velocity", span_s=ms / 1000, **common
            )
            for ms in (120, 40)
        },
        "kalman": KalmanSettings(name="kalman", **common),
    }


def relative_loss(clean: RecordingResult, disturbed: RecordingResult) -> Floats:
    """Relative growth of the mean error, at each of ``horizons_ms`` and then over them all.

    0.1: the error is 10 % larger with disturbed input. NaN where the recordings are too short.
    """
    before, after = clean.mean_mm(), disturbed.mean_mm()
    result: Floats = np.append(after, disturbed.overall_mm()) / np.append(
        before, clean.overall_mm()
    )
    return result - 1
