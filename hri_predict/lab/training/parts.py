"""Parts that a training configuration names: data sets, optimisers and schedules.

A package adds one with an entry point in one of the groups ``hri_predict.data_sets``,
``hri_predict.optimisers`` and ``hri_predict.schedules``.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any

import torch

from hri_predict.contracts import registry
from hri_predict.lab.training.config import TrainSettings
from hri_predict.lab.training.windows.benchmark import BenchmarkSamples, HumanSamples
from hri_predict.lab.training.windows.motion import MotionSamples

DATA_SETS: Mapping[str, Any] = {
    "real": MotionSamples,
    "benchmark": BenchmarkSamples,
    "human36m": HumanSamples,
}
"""``judgement:`` -> a ``samples.SampleSourceClass``."""

OPTIMISERS: Mapping[str, Callable[..., torch.optim.Optimizer]] = {
    "adamw": torch.optim.AdamW,
    "adam": torch.optim.Adam,
}
"""``train.optimiser:`` -> class, called with groups of parameters and ``lr``, and with ``fused``
if it takes that.

Each group states its own ``weight_decay``: none for vectors (biases, scales of norms).
"""


def cosine(settings: TrainSettings, progress: float) -> float:
    """Half a cosine to zero."""
    return 0.5 * (1.0 + math.cos(math.pi * min(progress, 1.0)))


def constant(settings: TrainSettings, progress: float) -> float:
    """No change."""
    return 1.0


def steps(settings: TrainSettings, progress: float) -> float:
    """Multiply by ``decay`` every ``decay_epochs`` epochs."""
    passed = math.floor(progress * settings.epochs / settings.decay_epochs + 1e-9)
    return float(settings.decay**passed)


SCHEDULES: Mapping[str, Callable[[TrainSettings, float], float]] = {
    "cosine": cosine,
    "constant": constant,
    "steps": steps,
}
"""``train.schedule:`` -> share of the learning rate at a share of the run, without its warm-up."""

_OURS: Mapping[registry.TrainingKind, Mapping[str, Any]] = {
    "data_sets": DATA_SETS,
    "optimisers": OPTIMISERS,
    "schedules": SCHEDULES,
}


def part(kind: registry.TrainingKind, name: str) -> Any:
    """Return the part of this name, from this project or an installed package.

    Raises:
        ConfigError: no part has this name, or it cannot be imported.
    """
    return registry.part(kind, name, _OURS[kind])
