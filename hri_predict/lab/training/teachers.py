"""Distillation: a network learns from the mean forecast of trained ones.

G. Hinton, O. Vinyals, J. Dean, "Distilling the Knowledge in a Neural Network", NIPS workshop 2014.
The mean of several networks is better than most of them, and as slow as all of them; one network
that learned it is as fast as one. Teachers also answer for windows without a true future.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from hri_predict.base.errors import ConfigError
from hri_predict.predictors.neural.network import BodyFrames, Network, Shape, Target
from hri_predict.predictors.neural.settings import shipped_weights
from hri_predict.predictors.neural.weights import load_weights


class Teachers:
    """Trained networks whose mean forecast replaces the truth in a share of the windows.

    Args:
        names: weights files, or predictors whose weights ship.
        share: share of the windows of each batch that they teach.
        shape: the learner's shape.

    Raises:
        ConfigError: a name has no weights, or a teacher has other joints or another rate, or reads
            a longer history.
        PredictorError: its weights are broken.
    """

    def __init__(self, names: Sequence[str], share: float, shape: Shape) -> None:
        self._share = share
        self._asked: list[tuple[int, Callable[[BodyFrames], Tensor]]] = []
        self._steps = shape.horizon_steps
        for name in names:
            network = _teacher(name, shape)
            self._steps = min(self._steps, network.shape.horizon_steps)
            self._asked.append((network.shape.history_steps, network.lean()))

    def teach(self, window: BodyFrames, target: Target) -> Target:
        """Replace the future of the first windows with the teachers' mean, and state their spread.

        Steps beyond the shortest of the teachers' horizons are then unknown.
        """
        taught = round(self._share * len(window.positions))
        if not self._asked or taught == 0:
            return target
        positions, known = target.positions.clone(), target.observed.clone()
        said = self._said(BodyFrames(window.positions[:taught], window.observed[:taught]))
        positions[:taught, : self._steps] = said.mean(0)
        known[:taught, : self._steps], known[:taught, self._steps :] = True, False
        spread = torch.full(known.shape, torch.nan)
        spread[:taught, : self._steps] = said.var(0, correction=0).mean(-1).sqrt()
        return Target(positions, known, target.past, spread)

    @torch.no_grad()
    def _said(self, window: BodyFrames) -> Tensor:
        """(teachers, B, H, J, 3)."""
        said = []
        for steps, forward in self._asked:
            newest = BodyFrames(window.positions[:, -steps:], window.observed[:, -steps:])
            said.append(forward(newest)[:, : self._steps, :, :3])
        return torch.stack(said)


def _teacher(name: str, shape: Shape) -> Network:
    path = Path(name) if name.endswith(".safetensors") else shipped_weights(name)
    if not path.is_file():
        raise ConfigError(
            f"train.teachers: no weights '{name}'; name a weights file, or a predictor whose "
            f"weights ship"
        )
    network = load_weights(path).network
    theirs = network.shape
    if (theirs.skeleton.joints, theirs.rate_hz, theirs.framed) != (
        shape.skeleton.joints,
        shape.rate_hz,
        shape.framed,
    ):
        raise ConfigError(
            f"train.teachers: '{name}' has other joints, another rate or frame than this network; "
            f"name one that was trained on the same kind of data"
        )
    if theirs.history_steps > shape.history_steps:
        raise ConfigError(
            f"train.teachers: '{name}' reads {theirs.history_steps} steps; set "
            f"shape.history_steps to as many"
        )
    return network.eval()
