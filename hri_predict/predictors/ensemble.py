"""The average of several predictors' forecasts: errors in which they differ partly cancel.

Any registered predictors can be members. Each reads as much of the history as it needs; the average
has the shortest horizon among them. For why the average of forecasts is better than most of its
members: J. Bates, C. Granger, "The Combination of Forecasts", Operational Research Quarterly 20
(1969) 451; equal weights are hard to beat: R. Clemen, International Journal of Forecasting 5 (1989)
559.
"""

from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field, field_validator

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import CANONICAL, Skeleton
from hri_predict.contracts import registry
from hri_predict.contracts.predictor import Forecast, Predictor, PredictorSettings, checked
from hri_predict.predictors.building import predictor_of


class AverageSettings(PredictorSettings):
    """Settings of the average."""

    members: tuple[str, ...] = Field(
        ("sinn", "mixer"), min_length=2, max_length=8, description="predictors, by name"
    )
    threads: int = Field(1, ge=1, le=64, description="CPU threads that torch may use")

    @field_validator("members")
    @classmethod
    def _each_once_and_none_within(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(value)) < len(value):
            raise ValueError("names a predictor twice; name each once")
        if "average" in value:
            raise ValueError("an average cannot be a member; name its members instead")
        return value

    @property
    def takes_long(self) -> bool:
        """Whether any member takes long."""
        return any(member.takes_long for member in self.of_members())

    def files(self) -> tuple[Path, ...]:
        """The weights of all members."""
        return tuple(path for member in self.of_members() for path in member.files())

    def runs(self) -> tuple[str, ...]:
        """The members."""
        return self.members

    def of_members(self) -> list[PredictorSettings]:
        """The members' settings: shipped weights, the same rate and horizon.

        Raises:
            ConfigError: the predictor does not exist.
        """
        found = []
        known = registry.names("predictors")
        for name in self.members:
            if name not in known:
                raise ConfigError(
                    f"predictor.members: unknown predictor '{name}' (known: {', '.join(known)})"
                )
            model = registry.predictor_settings(name)
            asked = {"name": name, "rate_hz": self.rate_hz, "horizon_s": self.horizon_s}
            if "threads" in model.model_fields:
                asked["threads"] = self.threads
            found.append(validated(model, asked, f"predictor.members: {name}"))
        return found


class AveragePredictor:
    """Averages the forecasts of several predictors.

    See ``contracts.predictor.Predictor`` for the other attributes.

    Attributes:
        members: the predictors.
    """

    settings_model: ClassVar[type[AverageSettings]] = AverageSettings

    def __init__(self, settings: AverageSettings, skeleton: Skeleton = CANONICAL) -> None:
        """Build the members.

        Raises:
            ConfigError: the predictor does not exist, or it cannot be built.
            PredictorError: a member's weights are broken.
        """
        self.members = [_member(own, skeleton) for own in settings.of_members()]
        for name, member in zip(settings.members, self.members, strict=True):
            if member.skeleton is not skeleton:
                raise ConfigError(
                    f"predictor average: {name} works on skeleton '{member.skeleton.name}', not "
                    f"on '{skeleton.name}'; take it out of predictor.members"
                )
            if member.rate_hz != settings.rate_hz:
                raise ConfigError(
                    f"predictor average: {name} predicts at {member.rate_hz:g} Hz, not at "
                    f"{settings.rate_hz:g}; take it out of predictor.members"
                )
        self.skeleton = skeleton
        self.rate_hz = settings.rate_hz
        self.history_steps = max(member.history_steps for member in self.members)
        self.horizon_steps = min(member.horizon_steps for member in self.members)
        # The members compute at the same time: on two free cores the mean takes as long as one.
        self._threads = ThreadPoolExecutor(len(self.members), "member")

    def predict(self, history: Floats, observed: Bools) -> Forecast:
        """The mean of what every member predicts; see ``Predictor.predict``.

        ``std`` is that of the mixture of the members' distributions, the mean of the axes: B.
        Lakshminarayanan et al., "Simple and Scalable Predictive Uncertainty Estimation using Deep
        Ensembles", NIPS 2017, section 2.4. A member without a ``std`` counts as certain: between
        such members it is how far they differ.

        Raises:
            PredictorError: a member's forecast is of the wrong shape or not finite.
        """
        ahead: list[Floats] = []
        variance: Floats | float = 0.0
        asked = [self._threads.submit(self._of, m, history, observed) for m in self.members]
        wait(asked)  # if one fails, the others must not still compute when they are asked again
        for forecast in (each.result() for each in asked):
            ahead.append(forecast.positions[:, : self.horizon_steps])
            if forecast.std is not None:
                variance = variance + forecast.std[:, : self.horizon_steps] ** 2 / len(asked)
        positions: Floats = np.mean(ahead, axis=0)
        return Forecast(positions, np.sqrt(variance + np.var(ahead, axis=0).mean(axis=-1)))

    def _of(self, member: Predictor, history: Floats, observed: Bools) -> Forecast:
        own = slice(self.history_steps - member.history_steps, None)
        return checked(member.predict(history[:, own], observed[:, own]), len(history), member)


def _member(settings: PredictorSettings, skeleton: Skeleton) -> Predictor:
    """Build a member, without torch where that is possible."""
    if skeleton is CANONICAL:
        return predictor_of(settings)
    made: Predictor = registry.load("predictors", settings.name)(settings, skeleton)
    return made
