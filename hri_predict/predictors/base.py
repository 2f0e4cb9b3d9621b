"""The contract of a predictor: a batch of histories in, one forecast out."""

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, Self

import numpy as np
from pydantic import Field

from hri_predict.errors import PredictorError
from hri_predict.scene import Bools, Floats
from hri_predict.settings import Settings
from hri_predict.skeleton import Skeleton


class PredictorSettings(Settings):
    """What the node needs to know of every predictor (``predictor:`` in the configuration)."""

    name: str
    horizon_s: float = Field(1.0, gt=0, le=10, description="how far ahead the forecast reaches")
    rate_hz: float = Field(
        25.0, gt=0, le=200, description="steps per second of history and forecast"
    )

    def resolved(self, base_dir: Path) -> Self:
        """The same with relative paths taken from ``base_dir``, the configuration's folder."""
        return self


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Predicted joints.

    Attributes:
        positions: (P, H, J, 3) metres, room frame; step k (from 0) is at capture + (k+1)/rate.
        std: (P, H, J) metres, one standard deviation per axis, or ``None``.
    """

    positions: Floats
    std: Floats | None


class Predictor(Protocol):
    """A human-motion predictor.

    Pure and batched: the same batch gives the same bytes, other batch sizes the same to 1e-5 m. A
    prediction depends on nothing captured after its window's end.

    Attributes:
        skeleton: the joints it works on.
        history_steps: T, how many steps of history it reads.
        horizon_steps: H, how many steps it predicts.
        rate_hz: steps per second of both.
    """

    skeleton: Skeleton
    history_steps: int
    horizon_steps: int
    rate_hz: float

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Predict from ``history`` (P, T, J, 3), NaN-free, and ``observed`` (P, T, J).

        The last step of the history is each person's newest capture. Where ``observed`` is false
        the history's value means nothing. Joints that were never observed are put where a
        neighbour is: finite, and left to the risk stage to bound.
        """


def checked(forecast: Forecast, people: int, predictor: Predictor) -> Forecast:
    """Return ``forecast`` if it keeps the contract.

    Raises:
        PredictorError: wrong shape, or not finite.
    """
    shape = (people, predictor.horizon_steps, len(predictor.skeleton.joints), 3)
    if forecast.positions.shape != shape:
        raise PredictorError(f"forecast has shape {forecast.positions.shape}, expected {shape}")
    if not np.isfinite(forecast.positions).all():
        raise PredictorError("forecast is not finite")
    if forecast.std is not None and not (
        forecast.std.shape == shape[:3] and np.isfinite(forecast.std).all()
    ):
        raise PredictorError("forecast's std is of the wrong shape or not finite")
    return forecast
