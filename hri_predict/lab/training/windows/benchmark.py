"""The train recordings of the benchmarks, CMU's and Human3.6M, as batches for the training loop.

All windows of stride 1 of every train file, as in the papers. But 70 % of them belong to two
actions, while the benchmark's mean weighs actions equally, so batches may draw the action first.
The pack's ``walking_extra`` is not used. Nothing is augmented unless ``reverse`` or ``mirror`` is
set: not all papers augment.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import torch
from pydantic import Field, model_validator
from torch import Tensor

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Settings
from hri_predict.lab.datasets.cmu_benchmark import (
    ACTIONS,
    RATE_HZ,
    Clip,
    action_of,
    all_windows,
    benchmark_names,
    data_root,
    read_clip,
    to_model,
)
from hri_predict.lab.datasets.human36m import (
    FIT_SUBJECTS,
    VALIDATION_SUBJECT,
    read_takes,
)
from hri_predict.lab.datasets.human36m import (
    Take as HumanTake,
)
from hri_predict.lab.datasets.splits import benchmark_split
from hri_predict.lab.training.windows.samples import Samples
from hri_predict.predictors.neural.cmu_skeleton import CMU25, CMU38, MOVING
from hri_predict.predictors.neural.human_skeleton import HUMAN22, HUMAN32, SCORED
from hri_predict.predictors.neural.mirror import Mirror
from hri_predict.predictors.neural.network import Shape

log = logging.getLogger(__name__)

_BATCH = 64

Take = tuple[str, Floats]
"""An action, and (n, J, 3) of one recording as networks read it."""


class WindowData(Settings):
    """``data:`` of a training configuration for a benchmark: which windows are used."""

    root: Path = Field(Path("../shared/data"), description="folder of the recordings")
    refit: bool = Field(
        False, description="fit all train recordings, once the epoch has been chosen"
    )
    space: Literal["positions", "rotations"] = Field(
        "positions", description="joints in metres, or exponential maps where the set has them"
    )
    actions: list[str] = Field([], description="only these actions; default: all")
    balanced: bool = Field(True, description="draw the action first, then a window of it")
    validation_windows: int = Field(64, ge=1, description="number per action, evenly spread")
    reverse: float = Field(
        0.0, ge=0, le=1, description="share of fitted windows played backwards; papers differ"
    )
    mirror: float = Field(0.0, ge=0, le=1, description="share mirrored; only for positions")

    @model_validator(mode="after")
    def _positions_are_mirrored(self) -> Self:
        if self.mirror and self.space == "rotations":
            raise ValueError("mirror: rotations cannot be mirrored here; use 0")
        return self


class BenchmarkData(WindowData):
    """``data:`` for the CMU benchmark."""

    splits: str = Field("splits.yaml", description="file that lists the pack's recordings by use")


class HumanData(WindowData):
    """``data:`` for Human3.6M."""


class BenchmarkSamples:
    """A ``SampleSource`` over the benchmark.

    Positions are (25, 3) of ``CMU25`` in benchmark metres (its mm / 1000), x forward, y left, z up;
    rotations are (38, 3) exponential maps of ``CMU38`` as stored, radians, the root's included and
    its translation dropped. Both are already in the body's frame: ``shape.framed``.

    A refit on all recordings has no validation windows: all windows are fitted.

    Attributes:
        shape: shape of the windows.
        actions: names of the actions with train recordings.
        window_count: number of windows that batches are drawn from.

    Raises:
        ConfigError: a list of the splits is missing, or names no recording of the benchmark that is
            long enough; or a recording is in both lists.
        RecordingError: a recording cannot be read.
    """

    settings_model: type[WindowData] = BenchmarkData
    skeletons = {"positions": CMU25, "rotations": CMU38}

    @classmethod
    def opened(
        cls, data: WindowData, *, history_steps: int, horizon_steps: int, rate_hz: float
    ) -> Self:
        """Open the recordings; their rate is the benchmark's."""
        return cls(data, history_steps, horizon_steps)

    def __init__(self, data: WindowData, history_steps: int, horizon_steps: int) -> None:
        fitted, validation = self._takes(data)
        self.actions = tuple(sorted({action for action, _ in (*fitted, *validation)}))
        self.shape = Shape(
            skeleton=self.skeletons[data.space],
            history_steps=history_steps,
            horizon_steps=horizon_steps,
            rate_hz=RATE_HZ,
            framed=True,
        )
        self._data = data
        self._mirror = Mirror(self.shape.skeleton)
        self._fit = _Windows(fitted, self.actions, self.shape)
        self._validation = _Windows(validation, self.actions, self.shape) if validation else None
        if self._validation is not None:
            self._validation.thin(data.validation_windows)
        self._counts = np.array([len(starts) for starts in self._fit.starts])
        self.window_count = int(self._counts.sum())
        if self.window_count == 0:
            raise ConfigError(
                f"data.root {data.root}: no train recording of {history_steps + horizon_steps} "
                f"frames at the nominal rate; check the folder"
            )
        if self._validation is not None and not any(map(len, self._validation.starts)):
            raise ConfigError(
                f"data.root {data.root}: no recording in validation has "
                f"{history_steps + horizon_steps} frames at the nominal rate; add longer ones"
            )

    @staticmethod
    def _takes(data: Any) -> tuple[list[Take], list[Take]]:
        """The recordings to fit, and those to validate on."""
        root = data_root(data.root)
        lists = [benchmark_names(root, "train")]
        if not data.refit:
            lists = [_listed(data.splits, key) for key in ("fit", "validation")]
        _check_actions(data.actions, [action_of(name) for names in lists for name in names])
        chosen = [_of(data.actions, names) for names in lists]
        fitted, validation = chosen[0], chosen[1] if len(chosen) > 1 else []
        for name in sorted(set(fitted) & set(validation)):
            raise ConfigError(
                f"splits {data.splits}: {name} is both in fit and in validation; take it out of "
                f"one of them"
            )
        read = [
            [(action_of(name), model_values(read_clip(root, name), data.space)) for name in names]
            for names in (fitted, validation)
        ]
        return read[0], read[1]

    def rest(self) -> Tensor:
        """(J, 3) mean pose, or mean exponential map, of the fitted windows."""
        return self._fit.frames.mean(0)

    def batch(self, rng: np.random.Generator, size: int) -> Samples:
        """Draw ``size`` windows with replacement."""
        weights = (self._counts > 0) if self._data.balanced else self._counts
        actions = rng.choice(len(weights), size, p=weights / weights.sum())
        chosen = [self._fit.starts[a][rng.integers(self._counts[a])] for a in actions]
        samples = self._fit.samples(np.array(chosen), actions)
        if not (self._data.reverse or self._data.mirror):  # draws as it did before there were these
            return samples
        whole = torch.cat([samples.history, samples.future], 1)
        backwards = torch.from_numpy(rng.random(size) < self._data.reverse)
        whole[backwards] = whole[backwards].flip(1)
        mirrored = torch.from_numpy(rng.random(size) < self._data.mirror)
        whole[mirrored] = self._mirror(whole[mirrored])
        steps = self.shape.history_steps
        return replace(samples, history=whole[:, :steps], future=whole[:, steps:])

    def validation(self) -> Iterator[Samples]:
        """Yield windows of the validation recordings, evenly spread over each action."""
        if self._validation is None:
            return
        starts = np.concatenate(self._validation.starts)
        counts = [len(s) for s in self._validation.starts]
        actions = np.repeat(np.arange(len(counts)), counts)
        for i in range(0, len(starts), _BATCH):
            yield self._validation.samples(starts[i : i + _BATCH], actions[i : i + _BATCH])


class HumanSamples(BenchmarkSamples):
    """Windows of Human3.6M: subject 11 for validation, 5 for the test; a refit uses all others.

    Positions are (22, 3) of ``HUMAN22`` in metres, x forward, y left, z up; rotations are (32, 3)
    exponential maps of ``HUMAN32`` as stored, radians.
    """

    settings_model = HumanData
    skeletons = {"positions": HUMAN22, "rotations": HUMAN32}

    @staticmethod
    def _takes(data: Any) -> tuple[list[Take], list[Take]]:
        every = (*FIT_SUBJECTS, VALIDATION_SUBJECT)
        found: dict[str, list[Take]] = {}
        for subject in every:
            with suppress(ConfigError):  # it is missing
                found[subject] = [
                    (action, _human_values(take, data.space))
                    for action, takes in read_takes(data.root, (subject,)).items()
                    for take in takes
                ]
        if not found:
            read_takes(data.root, every)  # names what is missing
        if missing := [subject for subject in every if subject not in found]:
            log.warning("data.root %s: trained without subjects %s", data.root, ", ".join(missing))
        _check_actions(data.actions, [action for takes in found.values() for action, _ in takes])
        parts = []
        for subjects in (every,) if data.refit else (FIT_SUBJECTS, (VALIDATION_SUBJECT,)):
            takes = [take for subject in subjects for take in found.get(subject, [])]
            chosen = [t for t in takes if not data.actions or t[0] in data.actions]
            if not chosen:
                raise ConfigError(
                    f"data.root {data.root}: no recording of {', '.join(subjects)} to train with; "
                    f"add one, or name other data.actions"
                )
            parts.append(chosen)
        return parts[0], [] if data.refit else parts[1]


class _Windows:
    """Frames of several recordings in one tensor, and where windows begin in it.

    Attributes:
        frames: (F, J, 3).
        starts: by action, the first frames of its windows.
    """

    def __init__(self, takes: Sequence[Take], actions: Sequence[str], shape: Shape) -> None:
        self._shape = shape
        values = [value for _, value in takes]
        self.frames = torch.from_numpy(np.concatenate(values)).float()
        offsets = np.cumsum([0, *(len(v) for v in values[:-1])])
        found: list[list[np.ndarray]] = [[np.empty(0, np.intp)] for _ in actions]
        for (action, value), first in zip(takes, offsets, strict=True):
            windows = all_windows(len(value), shape.history_steps, shape.horizon_steps)
            found[actions.index(action)].append(first + windows)
        self.starts = [np.concatenate(windows) for windows in found]

    def thin(self, most: int) -> None:
        """Keep at most ``most`` windows of each action, evenly spread."""
        for i, windows in enumerate(self.starts):
            if len(windows) > most:
                self.starts[i] = windows[np.linspace(0, len(windows) - 1, most).round().astype(int)]

    def samples(self, starts: np.ndarray, actions: np.ndarray) -> Samples:
        """Cut windows that begin at ``starts``."""
        steps = self._shape.history_steps + self._shape.horizon_steps
        windows = self.frames[torch.from_numpy(starts[:, None] + np.arange(steps))]
        history = windows[:, : self._shape.history_steps]
        future = windows[:, self._shape.history_steps :]
        return Samples(
            history=history,
            observed=torch.ones(history.shape[:3], dtype=torch.bool),
            future=future,
            known=torch.ones(future.shape[:3], dtype=torch.bool),
            actions=torch.from_numpy(np.asarray(actions)),
        )


def _human_values(take: HumanTake, space: str) -> Floats:
    """A take as networks read it: (n, 22, 3) metres or (n, 32, 3) maps."""
    return take.maps if space == "rotations" else to_model(take.positions[:, SCORED])


def model_values(clip: Clip, space: str) -> Floats:
    """A clip as networks read it: (n, 25, 3) benchmark metres or (n, 38, 3) maps."""
    if space == "rotations":
        return clip.expmaps
    return to_model(clip.positions()[:, MOVING])


def _check_actions(asked: Sequence[str], there: Sequence[str]) -> None:
    for action in asked:
        if there and action not in there:
            raise ConfigError(
                f"data.actions {action}: no recording shows it; available: "
                f"{', '.join(sorted(set(there)))}"
            )


def _of(actions: Sequence[str], names: Sequence[str]) -> list[str]:
    """The recordings of these actions; all of them where none is named."""
    found = [name for name in names if not actions or action_of(name) in actions]
    if names and not found:
        raise ConfigError(
            f"data.actions {', '.join(actions)}: no recording shows them; available: "
            f"{', '.join(sorted({action_of(name) for name in names}))}"
        )
    return found


def _listed(file: str, key: str) -> list[str]:
    """The benchmark's recordings in one of its own lists of the splits file."""
    found = [name for name in benchmark_split(key, file) if action_of(name) in ACTIONS]
    if not found:
        raise ConfigError(
            f"splits {file}: 'benchmark.{key}' names no recording of the CMU benchmark; name one"
        )
    return found
