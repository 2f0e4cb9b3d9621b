"""Input of the training loop: batches of histories with their futures, and validation windows."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from torch import Tensor

from hri_predict.base.settings import Settings
from hri_predict.predictors.neural.network import BodyFrames, Network, Shape, Target


@dataclass(frozen=True, slots=True, kw_only=True)
class Samples:
    """A batch in the room's frame (or, where the shape is ``framed``, in the body's).

    Attributes:
        history: (B, T, J, 3) metres, finite; anything where not observed.
        observed: (B, T, J) bool.
        future: (B, H, J, 3) metres, finite; anything where not known.
        known: (B, H, J) bool; false where a recording ends or lost the joint.
        actions: (B,) index into ``SampleSource.actions``.
        past: (B, T, J, 3) metres, the history without noise; ``None``: ``history`` has none.
        past_known: (B, T, J) bool, where ``past`` holds.
    """

    history: Tensor
    observed: Tensor
    future: Tensor
    known: Tensor
    actions: Tensor
    past: Tensor | None = None
    past_known: Tensor | None = None

    def entered(self, network: Network) -> tuple[BodyFrames, Target]:
        """Return the batch in each person's own frame, as the network reads it."""
        window, frame = network.enter(self.history, self.observed)
        past = None
        if self.past is not None and self.past_known is not None:
            past = Target(frame.enter(self.past), self.past_known)
        return window, Target(frame.enter(self.future), self.known, past)


class SampleSource(Protocol):
    """Source of training windows.

    Attributes:
        shape: shape of the windows.
        actions: names of the actions.
    """

    shape: Shape
    actions: tuple[str, ...]

    def rest(self) -> Tensor:
        """(J, 3) mean pose in the body frame, for ``Network.rest``."""

    def batch(self, rng: np.random.Generator, size: int) -> Samples:
        """Draw a random, augmented batch."""

    def validation(self) -> Iterator[Samples]:
        """Yield the validation windows, always the same, in batches."""


class SampleSourceClass(Protocol):
    """A data set for training, named by ``judgement:``.

    Attributes:
        settings_model: the model that validates ``data:`` of a training configuration.
    """

    settings_model: type[Settings]

    def opened(
        self, data: Any, *, history_steps: int, horizon_steps: int, rate_hz: float
    ) -> SampleSource:
        """Open it with the settings ``data``, an instance of its ``settings_model``.

        Raises:
            ConfigError: there is nothing to train on.
            RecordingError: a recording cannot be read.
        """
