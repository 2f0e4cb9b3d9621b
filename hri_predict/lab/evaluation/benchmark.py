"""Evaluation as in the papers: error per action under one protocol of a benchmark.

A forecaster sees the history of each window and nothing else: (N, n_in, J, 3) in, (N, n_out, J, 3)
out, in the benchmark's own units. No frame after the window's origin reaches it.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, PredictorError, RecordingError
from hri_predict.base.skeleton import Skeleton
from hri_predict.lab.datasets import cmu_benchmark
from hri_predict.lab.datasets.cmu_benchmark import from_model, to_model
from hri_predict.lab.datasets.euler import euler_error
from hri_predict.lab.evaluation.benchmarks import Benchmark, benchmark_of
from hri_predict.lab.evaluation.published import ErrorKind
from hri_predict.predictors.neural.network import Network

Forecaster = Callable[[Floats], Floats]

_FRAMES = (1, 3, 7, 9, 13, 24)
"""Future frames, from 0, in the papers' columns 80, 160, 320, 400, 560 and 1000 ms."""
_KD_FRAMES = (0, 2, 6, 8, 12, 23)
"""The frames that KD-Former's paper reads under the same headings."""
_NOMINAL_MS = {1: 80, 3: 160, 7: 320, 9: 400, 13: 560, 24: 1000}
_BATCH = 128


@dataclass(frozen=True, slots=True)
class Protocol:
    """Settings of an evaluation.

    Attributes:
        windows: all windows of each test recording, or the ones that papers draw.
        n_out: frames predicted; with ``windows`` all, 10 and 25 are different sets of windows.
        error: mean per joint position error, or KD-Former's error of Euler angles.
        observed_frames: frames observed, if not as most papers do; SINN's observes 25.
    """

    benchmark: str
    windows: str
    n_out: int
    error: ErrorKind = "mpjpe"
    observed_frames: int | None = None

    def __post_init__(self) -> None:
        """Check that the benchmark has such windows and such an error.

        Raises:
            ConfigError: the benchmark does not exist, or has no such windows or error.
        """
        of = self.of
        for flag, value, known in (
            ("--windows", self.windows, of.windows),
            ("--error", self.error, of.skeletons),
        ):
            if value not in known:
                raise ConfigError(
                    f"{flag} {value}: {of.title} is evaluated with {', '.join(known)}; use one"
                )

    @property
    def n_in(self) -> int:
        """Frames observed: 10, and 50 where exponential maps are predicted."""
        return self.observed_frames or (50 if self.error == "euler" else 10)

    @property
    def readings(self) -> tuple[tuple[int, ...], ...]:
        """Future frames that tables show; the Euler error also has those of its paper."""
        frames = tuple(f for f in _FRAMES if f < self.n_out)
        if self.error == "mpjpe":
            return (frames,)
        return frames, tuple(f for f in _KD_FRAMES if f < self.n_out)

    @property
    def of(self) -> Benchmark:
        """The benchmark."""
        return benchmark_of(self.benchmark)

    @property
    def unit(self) -> str:
        """Unit of the errors."""
        return "rad" if self.error == "euler" else self.of.unit

    @property
    def skeleton(self) -> Skeleton:
        """Joints that forecasters predict."""
        return self.of.skeletons[self.error]


def nominal_ms(frame: int) -> int:
    """The benchmark's name for a future frame: milliseconds at 25 frames per second."""
    return _NOMINAL_MS.get(frame, 40 * (frame + 1))


@dataclass(frozen=True, slots=True, eq=False)
class ActionTests:
    """An action's test windows: (N, n_in, J, 3) and (N, n_out, J, 3) of ``Protocol.skeleton``.

    Positions are in the benchmark's unit, x left, y up, z forward; rotations as stored.
    """

    action: str
    history: Floats
    future: Floats


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """A forecaster's error on one action.

    Attributes:
        windows: number of windows.
        errors: (n_out,) mean error at each future frame.
        joints: (n_out, J) mean error of each predicted joint; ``None`` for the Euler error.
    """

    windows: int
    errors: Floats
    joints: Floats | None


def open_tests(protocol: Protocol, directory: Path) -> Iterator[ActionTests]:
    """Yield each action's test windows.

    Raises:
        ConfigError: there are no recordings below ``directory``.
        RecordingError: a recording cannot be read or is too short.
    """
    benchmark = protocol.of
    for action, where, takes in benchmark.takes(directory, protocol.error):
        frames = [len(take) for take in takes]
        with _named(where):
            starts = benchmark.starts(protocol.windows, frames, protocol.n_in, protocol.n_out)
            _check_long_enough(protocol, frames, sum(map(len, starts)))
        parts = [
            cmu_benchmark.cut(take, own, protocol.n_in, protocol.n_out)
            for take, own in zip(takes, starts, strict=True)
        ]
        yield ActionTests(action, *(np.concatenate(part) for part in zip(*parts, strict=True)))


@contextlib.contextmanager
def _named(where: str) -> Iterator[None]:
    """Name the recording in an error."""
    try:
        yield
    except RecordingError as error:
        raise RecordingError(f"{where}: {error}") from error


def _check_long_enough(protocol: Protocol, frames: Sequence[int], windows: int) -> None:
    if windows == 0:
        raise RecordingError(
            f"{' and '.join(map(str, frames))} frames at the nominal rate are too few for a "
            f"window of {protocol.n_in} + {protocol.n_out}; leave it out"
        )


def score(protocol: Protocol, forecaster: Forecaster, test: ActionTests) -> Score:
    """Evaluate a forecaster on one action.

    Raises:
        PredictorError: the forecast is of the wrong shape, or not finite.
    """
    predicted = forecaster(test.history.copy())
    if predicted.shape != test.future.shape or not np.isfinite(predicted).all():
        raise PredictorError(
            f"forecast of {test.action} has shape {predicted.shape} or is not finite; expected "
            f"finite numbers of shape {test.future.shape}; leave it out, or give it other weights"
        )
    if protocol.error == "euler":
        error = np.asarray(euler_error(predicted, test.future))
        return Score(len(test.history), error.mean(0), None)
    joints = np.linalg.norm(predicted - test.future, axis=-1)
    counted = protocol.of.errors(predicted, test.future)
    return Score(len(test.history), counted.mean((0, 2)), joints.mean(0))


def judge(
    protocol: Protocol,
    directory: Path,
    forecasters: Mapping[str, Forecaster],
    on_action: Callable[[str], None] = lambda _: None,
) -> dict[str, dict[str, Score]]:
    """Evaluate forecasters on the same windows; scores by forecaster and action.

    Args:
        protocol: settings of the evaluation.
        directory: folder of the recordings.
        forecasters: by name.
        on_action: called with the name of each action before its evaluation.

    Raises:
        ConfigError, RecordingError, PredictorError: see ``open_tests`` and ``score``.
    """
    scores: dict[str, dict[str, Score]] = {name: {} for name in forecasters}
    for tests in open_tests(protocol, directory):
        on_action(tests.action)
        for name, forecaster in forecasters.items():
            try:
                scores[name][tests.action] = score(protocol, forecaster, tests)
            except PredictorError as error:
                raise PredictorError(f"predictor {name}: {error}") from error
    return scores


def mean_over(protocol: Protocol, actions: Mapping[str, Score]) -> Floats:
    """(n_out,) mean over the benchmark's ``mean_over``; NaN if one is missing."""
    names = protocol.of.mean_over or tuple(actions)
    if not all(name in actions for name in names):
        return np.full(protocol.n_out, np.nan)
    result: Floats = np.mean([actions[name].errors for name in names], axis=0)
    return result


def zero_velocity(n_out: int) -> Forecaster:
    """The last observed frame, repeated."""
    return lambda history: np.repeat(history[:, -1:], n_out, axis=1)


def constant_velocity(n_out: int) -> Forecaster:
    """The last observed frame, extrapolated by the last difference."""

    def forecast(history: Floats) -> Floats:
        ahead = np.arange(1.0, n_out + 1)[:, None, None]
        step = history[:, -1:] - history[:, -2:-1]
        result: Floats = history[:, -1:] + ahead * step
        return result

    return forecast


def average_of(members: Sequence[Forecaster]) -> Forecaster:
    """Return the forecaster whose forecast is the mean of the members' (positions only)."""

    def average(history: Floats) -> Floats:
        mean: Floats = np.mean([member(history) for member in members], axis=0)
        return mean

    return average


_TRAINING = {
    ("cmu", "mpjpe"): ", with judgement: benchmark",
    ("cmu", "euler"): ", with judgement: benchmark and data: {space: rotations}",
    ("human36m", "mpjpe"): ", with judgement: human36m",
    ("human36m", "euler"): ", with judgement: human36m and data: {space: rotations}",
}


def network_forecaster(protocol: Protocol, network: Network, where: str) -> Forecaster:
    """A trained network as a forecaster; steps before the window count as unobserved.

    Raises:
        PredictorError: it works on other joints, in the room's frame, or predicts too few frames.
    """
    shape, wanted = network.shape, protocol.skeleton
    if shape.skeleton.joints != wanted.joints or not shape.framed:
        raise PredictorError(
            f"{where}: predicts skeleton {shape.skeleton.name}; this benchmark needs "
            f"{wanted.name} in its own frame; give weights that were trained for it"
            f"{_TRAINING.get((protocol.benchmark, protocol.error), '')}"
        )
    if shape.horizon_steps < protocol.n_out:
        raise PredictorError(
            f"{where}: predicts {shape.horizon_steps} frames, fewer than --n-out "
            f"{protocol.n_out}; give weights of a longer horizon"
        )

    def forecast(history: Floats) -> Floats:
        values = history if protocol.error == "euler" else to_model(history)
        parts = [values[i : i + _BATCH] for i in range(0, len(values), _BATCH)]
        predicted = np.concatenate([_predict(network, part) for part in parts])
        predicted = predicted[:, : protocol.n_out]
        return predicted if protocol.error == "euler" else from_model(predicted)

    return forecast


@torch.no_grad()
def _predict(network: Network, history: Floats) -> Floats:
    """(B, n_in, J, 3) to (B, H, J, 3); the history is padded or cut at its start to fit."""
    steps = network.shape.history_steps
    newest = torch.from_numpy(np.ascontiguousarray(history[:, -steps:], dtype=np.float32))
    missing = steps - newest.shape[1]
    padding = newest.new_zeros(len(newest), missing, *newest.shape[2:])
    observed = torch.ones(len(newest), steps, newest.shape[2], dtype=torch.bool)
    observed[:, :missing] = False
    window, frame = network.enter(torch.cat([padding, newest], dim=1), observed)
    result: Floats = frame.leave(network(window)[..., :3]).double().numpy()
    return result
