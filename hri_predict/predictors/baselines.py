"""Zero velocity and constant velocity: the baselines every forecast is measured against.

Both extrapolate each joint separately from its last observed position in the window. A joint never
observed there moves with the nearest observed joint in the tree; a person without observed joints
is placed at zero.
"""

from typing import ClassVar

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.skeleton import CANONICAL, Skeleton, neighbours
from hri_predict.contracts.predictor import Forecast, PredictorSettings
from hri_predict.predictors.masked import (
    Indices,
    at_step,
    ever,
    last_observed,
    nearest_seen,
    steps,
    steps_to_cover,
)


class ZeroVelocitySettings(PredictorSettings):
    """Settings of ``zero_velocity``."""

    history_s: float = Field(
        0.5, ge=0.01, le=5, description="maximum time since a joint was last observed"
    )


class ConstantVelocitySettings(ZeroVelocitySettings):
    """Settings of ``constant_velocity``."""

    span_s: float = Field(0.1, ge=0.01, le=5, description="time over which velocity is measured")


class ZeroVelocity:
    """Every joint stays at its last observed position."""

    settings_model: ClassVar[type[ZeroVelocitySettings]] = ZeroVelocitySettings

    def __init__(self, settings: ZeroVelocitySettings, skeleton: Skeleton = CANONICAL) -> None:
        self.skeleton = skeleton
        self.rate_hz = settings.rate_hz
        self.history_steps = steps(settings.history_s, settings.rate_hz) + 1
        self.horizon_steps = steps_to_cover(settings.horizon_s, settings.rate_hz)
        self._neighbours = neighbours(skeleton.parents)

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Repeat each joint's newest observed position; see ``Predictor.predict``."""
        newest, seen = last_observed(observed)
        start = _masked_at(history, newest, seen)
        return self._extrapolate(start, np.zeros_like(start), newest, seen)

    def _extrapolate(
        self, start: Floats, velocity: Floats, newest: Indices, seen: Bools
    ) -> Forecast:
        """Forecast from positions (P, J, 3) at steps ``newest``; velocity in metres per step."""
        behind = (self.history_steps - 1 - newest)[..., np.newaxis]
        now = start + velocity * behind
        source = nearest_seen(seen, self._neighbours)[..., np.newaxis]
        now = np.take_along_axis(now, source, axis=1)
        velocity = np.take_along_axis(velocity, source, axis=1)
        ahead = np.arange(1.0, self.horizon_steps + 1)[:, np.newaxis, np.newaxis]
        return Forecast(now[:, np.newaxis] + velocity[:, np.newaxis] * ahead, None)


class ConstantVelocity(ZeroVelocity):
    """Every joint keeps its mean velocity over the last ``span_s``.

    Velocity is the difference between a joint's newest observed position and the one ``span_s``
    before it, or the observed one nearest to that time; zero if the window has no second one.
    """

    settings_model = ConstantVelocitySettings

    def __init__(self, settings: ConstantVelocitySettings, skeleton: Skeleton = CANONICAL) -> None:
        super().__init__(settings, skeleton)
        self._span = steps(settings.span_s, settings.rate_hz)
        self.history_steps = max(self.history_steps, self._span + 1)

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Extrapolate each joint's mean velocity; see ``Predictor.predict``."""
        newest, seen = last_observed(observed)
        earlier, moved = self._earlier(observed, newest)
        start = _masked_at(history, newest, seen)
        before = np.where(moved[..., np.newaxis], at_step(history, earlier), start)
        elapsed = np.where(moved, newest - earlier, 1)[..., np.newaxis]
        return self._extrapolate(start, (start - before) / elapsed, newest, seen)

    def _earlier(self, observed: Bools, newest: Indices) -> tuple[Indices, Bools]:
        """(P, J) the observed step nearest to a span before ``newest``, and whether one exists."""
        step = np.arange(observed.shape[1])[:, np.newaxis]
        newest = newest[:, np.newaxis]
        candidate = observed & (step < newest)
        distance = np.where(candidate, np.abs(step - (newest - self._span)), step.size)
        return np.argmin(distance, axis=1), ever(candidate)


def _masked_at(history: Floats, step: Indices, seen: Bools) -> Floats:
    """(P, J, 3) each joint at its own step, zero where it was never seen."""
    return np.where(seen[..., np.newaxis], at_step(history, step), 0.0)
