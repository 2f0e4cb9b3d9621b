"""The contract of a predictor: a batch of histories in, one forecast out.

A kind of predictor is a class: ``PredictorClass`` is the interface required of the class,
``Predictor`` that of an object. ``hri-predict conformance predictor:NAME`` checks the contract on
any kind.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol, Self, TypeVar

import numpy as np
from pydantic import Field

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import PredictorError
from hri_predict.base.settings import Settings
from hri_predict.base.skeleton import CANONICAL, Skeleton

MAX_STEPS = 100_000
"""Maximum number of steps of history or horizon: 10 s, the longest horizon, at 10 kHz."""


MIN_HORIZON_S = 0.01
"""Minimum horizon: one step at 100 Hz."""


class PredictorSettings(Settings):
    """Settings that the node needs of every predictor (``predictor:`` in the configuration)."""

    name: str = Field(description="name of the predictor")
    horizon_s: float = Field(1.0, ge=MIN_HORIZON_S, le=10, description="horizon of the forecast")
    rate_hz: float = Field(
        25.0, ge=1, le=200, description="steps per second of history and forecast"
    )
    process: Literal["auto"] | bool = Field(
        "auto",
        description="predict in a separate process; auto: if forecasts take long and there is "
        "more than one core",
    )

    @property
    def takes_long(self) -> bool:
        """Whether forecasts are slow enough to justify a separate process; by default not."""
        return False

    def resolved(self, base_dir: Path) -> Self:
        """Return the settings with paths resolved relative to ``base_dir``, the configuration's
        folder.
        """
        return self

    def files(self) -> tuple[Path, ...]:
        """Files on which its forecasts depend: a calibration is refused if one of them has changed.

        By default the file named by the setting ``weights``, if it exists.
        """
        weights = getattr(self, "weights", None)
        return (Path(weights),) if isinstance(weights, str | Path) else ()

    def runs(self) -> tuple[str, ...]:
        """Names of other predictors whose code it runs, such as the members of an average."""
        return ()


@dataclass(frozen=True, slots=True, eq=False)
class Forecast:
    """Predicted joints.

    Attributes:
        positions: (P, H, J, 3) metres, room frame; step k (from 0) is at capture + (k+1)/rate.
        std: (P, H, J) metres, one standard deviation per axis, not below 0; or ``None``.
    """

    positions: Floats
    std: Floats | None


class Predictor(Protocol):
    """A human-motion predictor.

    Pure and batched: the same batch gives the same bytes, other batch sizes the same to 1e-5 m. A
    prediction depends on nothing captured after its window's end.

    Attributes:
        skeleton: the joints it works on.
        history_steps: T, number of steps of history.
        horizon_steps: H, number of predicted steps.
        rate_hz: steps per second of both.
    """

    skeleton: Skeleton
    history_steps: int
    horizon_steps: int
    rate_hz: float

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """Predict from ``history`` (P, T, J, 3), NaN-free, and ``observed`` (P, T, J).

        The last step of the history is each person's newest capture. Where ``observed`` is false,
        the history's value is meaningless. Joints never observed are placed at a neighbour: they
        are finite, and the risk stage bounds them.
        """


S = TypeVar("S", bound=PredictorSettings)


class PredictorClass(Protocol[S]):
    """Interface that the node requires of a kind of predictor: a class whose objects are
    ``Predictor``.

    The first line of its docstring is what ``hri-predict predictors`` shows.
    """

    @property
    def settings_model(self) -> type[S]:
        """The model that validates ``predictor:`` of this kind."""

    def __call__(self, settings: S, skeleton: Skeleton = CANONICAL, /) -> Predictor:
        """Create a predictor that is ready to predict within the node's cycle.

        Args:
            settings: validated by ``settings_model``, and ``resolved``.
            skeleton: the joints to work on; the node uses the default.

        Raises:
            HriPredictError: a setting cannot be used; one line with the remedy.
        """


AnyPredictorClass = PredictorClass[PredictorSettings]
"""Any kind of predictor, as returned by the registry."""


def refuse_unsound(predictor: Predictor) -> None:
    """Check a predictor's attributes before arrays are sized by them.

    Raises:
        PredictorError: an attribute is missing, of the wrong type or out of range.
    """
    skeleton = getattr(predictor, "skeleton", None)
    if not isinstance(skeleton, Skeleton):
        raise PredictorError(
            f"its skeleton is {skeleton!r}: must be a hri_predict.base.skeleton.Skeleton"
        )
    for name in ("history_steps", "horizon_steps"):
        steps = getattr(predictor, name, None)
        if not isinstance(steps, int) or not 1 <= steps <= MAX_STEPS:
            raise PredictorError(f"its {name} is {steps!r}: must be an int from 1 to {MAX_STEPS}")
    rate_hz = getattr(predictor, "rate_hz", None)
    if not isinstance(rate_hz, (int, float)) or not 0 < rate_hz < np.inf:
        raise PredictorError(f"its rate_hz is {rate_hz!r}: must be a number above 0")


def checked(forecast: Forecast, people: int, predictor: Predictor) -> Forecast:
    """Return ``forecast`` if it meets the contract.

    Raises:
        PredictorError: wrong shape, not finite, or a deviation below 0.
    """
    problem = problem_in(
        forecast, (people, predictor.horizon_steps, len(predictor.skeleton.joints), 3)
    )
    if problem:
        raise PredictorError(problem)
    return forecast


def problem_in(forecast: Forecast, shape: tuple[int, int, int, int]) -> str:
    """Return the problem of a forecast that should have ``shape`` (P, H, J, 3), or ""."""
    if forecast.positions.shape != shape:
        return f"forecast has shape {forecast.positions.shape}, expected {shape}"
    for array in (forecast.positions, forecast.std):
        if array is not None and not np.issubdtype(array.dtype, np.floating):
            return f"forecast is of type {array.dtype}, expected float64"
    if not np.isfinite(forecast.positions).all():
        return "forecast is not finite"
    if forecast.std is not None and not (
        forecast.std.shape == shape[:3]
        and np.isfinite(forecast.std).all()
        and (forecast.std >= 0).all()
    ):
        return "forecast's std is of the wrong shape, not finite or below 0"
    return ""
