"""Long predictions from short ones: temporal aggregation with a forget unit.

Chen et al., "Rethinking Human Motion Prediction with Symplectic Integral", CVPR 2024, section 3.2.
A network that predicts t steps is applied again and again with the same weights until the whole
horizon is covered (Eqs. 8-9); before each time a forget unit drops the t oldest steps of its window
and appends the t just predicted. It asks nothing of the network (its Table 5 wraps six others).

The window is read anew each time. A recurrent network could go on from its last state at a fifth of
the cost, but would then remember steps that the forget unit drops.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from pydantic import Field
from torch import Tensor, nn

from hri_predict import registry
from hri_predict.errors import ConfigError
from hri_predict.predictors.network import (
    Network,
    NetworkOptions,
    Shape,
    Target,
    Window,
    mpjpe,
)
from hri_predict.predictors.neural import NeuralPredictor, NeuralSettings
from hri_predict.predictors.weights import Header, LoadedWeights, load_weights
from hri_predict.settings import validated


def forget(window: Window, predicted: Tensor) -> Window:
    """Drop as many of the oldest steps as were ``predicted`` (B, t, J, 3), and append those.

    Predicted joints count as observed: nothing better will be known of them.
    """
    steps = window.positions.shape[1]
    seen = window.observed.new_ones(predicted.shape[:3])
    return Window(
        torch.cat([window.positions, predicted], 1)[:, -steps:],
        torch.cat([window.observed, seen], 1)[:, -steps:],
    )


def aggregate(operator: Callable[[Window], Tensor], window: Window, horizon_steps: int) -> Tensor:
    """Apply ``operator``, a window to (B, t, J, 3), until (B, horizon_steps, J, 3) are predicted.

    The horizon needs not be a multiple of t; of the last application only the start is used then.
    """
    parts: list[Tensor] = []
    done = 0
    while done < horizon_steps:  # Eq. 8: one sub-interval after the other
        if parts:
            window = forget(window, parts[-1])
        parts.append(operator(window))
        done += parts[-1].shape[1]
    return torch.cat(parts, 1)[:, :horizon_steps]  # Eq. 9


class AggregatedOptions(NetworkOptions):
    """Which network is wrapped, and how.

    Attributes:
        method: name of the predictor whose network it is.
        steps: t, how many steps that network predicts at a time.
        options: its sizes and switches.
        pretraining: share of the training in which it learns its own t steps alone.
    """

    method: str = "trajectorycnn"
    steps: int = Field(5, ge=1, le=1000)
    options: dict[str, Any] = {}
    pretraining: float = Field(0.5, ge=0, le=1)


class Aggregated(Network):
    """Any predictor's network, made to predict few steps, and chained to predict many.

    Its loss has two stages: at first the network within learns its own steps with its own loss,
    then the position error over the whole horizon. Unobserved joints: as that network has it.

    Attributes:
        inner: the network within.

    Raises:
        ConfigError: there is no such predictor, it has no network, or an option is wrong.
    """

    options_model = AggregatedOptions
    any_horizon = True

    def __init__(self, shape: Shape, options: AggregatedOptions) -> None:
        super().__init__(shape)
        self.options: AggregatedOptions = options
        network_class = getattr(registry.load("predictors", options.method), "network_class", None)
        if network_class is None:
            raise ConfigError(
                f"options.method '{options.method}': has no network; name a trained predictor"
            )
        own = validated(network_class.options_model, options.options, "options.options")
        self.inner: Network = network_class(replace(shape, horizon_steps=options.steps), own)
        self.inner.rest = (
            self.rest
        )  # one tensor: set or loaded for the whole, it is the inner one's

    @classmethod
    def around(cls, inner: LoadedWeights, steps: int, horizon_steps: int) -> "Aggregated":
        """A network trained by itself, of whose forecast the first ``steps`` are used each time."""
        network = inner.network
        options = AggregatedOptions(
            method=inner.method, steps=steps, options=network.options.model_dump()
        )
        whole = cls(replace(network.shape, horizon_steps=horizon_steps), options)
        whole.inner, whole.rest = network, network.rest
        return whole.eval().requires_grad_(False)

    def forward(self, window: Window) -> Tensor:
        """Predict (B, H, J, 3) in the body frame."""
        return aggregate(self._operator, window, self.shape.horizon_steps)

    def _operator(self, window: Window) -> Tensor:
        predicted: Tensor = self.inner(window)
        return predicted[:, : self.options.steps]  # one that was trained by itself goes further

    def loss(self, window: Window, target: Target, progress: float) -> Tensor:
        """Return the inner network's loss on its own steps, later the error over all."""
        if self._pretraining(progress):
            return self.inner.loss(window, self._near(target), self._inner_progress(progress))
        return mpjpe(self(window), target)

    def critic_loss(self, window: Window, target: Target, progress: float) -> Tensor | None:
        """Return the loss of the inner network's adversary while that network learns alone."""
        if not self._pretraining(progress):
            return None
        return self.inner.critic_loss(window, self._near(target), self._inner_progress(progress))

    def critic_parameters(self) -> Iterator[nn.Parameter]:
        """Yield the parameters of the inner network's adversary."""
        return self.inner.critic_parameters()

    def _pretraining(self, progress: float) -> bool:
        enough = self.shape.horizon_steps >= self.options.steps
        return enough and progress < self.options.pretraining

    def _inner_progress(self, progress: float) -> float:
        return progress / self.options.pretraining

    def _near(self, target: Target) -> Target:
        steps = self.options.steps
        return Target(target.positions[:, :steps], target.observed[:, :steps])


class AggregatedSettings(NeuralSettings):
    """Settings of the aggregated predictor."""

    inner: str = Field("trajectorycnn", description="trained predictor whose network is repeated")
    steps: int = Field(5, ge=1, le=1000, description="steps that are used of each repetition")


class AggregatedPredictor(NeuralPredictor):
    """Repeats another trained predictor on its own first steps (SINN's temporal aggregation).

    Its weights are those of the inner predictor, by default the shipped ones; or those of a
    training of ``aggregated`` itself, which say what they wrap and how. It takes any predictor to
    any horizon. Within the inner predictor's own it is no gain unless that was trained for it: the
    shipped trajectorycnn, repeated every 5 steps, is 246 mm off after 1 s on the validation
    recordings, by itself 188.
    """

    method = "aggregated"
    network_class = Aggregated
    settings_model = AggregatedSettings

    def _weights_method(self, settings: NeuralSettings) -> str:
        assert isinstance(settings, AggregatedSettings)
        trained = getattr(registry.load("predictors", settings.inner), "network_class", None)
        if trained is None:
            raise ConfigError(
                f"predictor.inner '{settings.inner}': has no network; name a trained predictor"
            )
        return settings.inner

    def _load(
        self, path: Path, header: Header, settings: NeuralSettings, horizon_steps: int
    ) -> LoadedWeights:
        assert isinstance(settings, AggregatedSettings)
        if header.method == self.method:
            _check_same(settings, header, path)
            return load_weights(path, horizon_steps)
        any_horizon = registry.load("predictors", header.method).network_class.any_horizon
        inner = load_weights(path, settings.steps if any_horizon else None)
        reach = inner.network.shape.horizon_steps
        if reach < settings.steps:
            raise ConfigError(
                f"predictor.steps {settings.steps}: '{settings.inner}' predicts {reach} at a time "
                f"by its weights {path}; use {reach} at most"
            )
        whole = Aggregated.around(inner, settings.steps, horizon_steps)
        return LoadedWeights(whole, self.method, inner.card)


def _check_same(settings: AggregatedSettings, header: Header, path: Path) -> None:
    """What the configuration says must be what its weights were trained with."""
    trained = AggregatedOptions.model_validate(header.options)
    for key, value in (("inner", trained.method), ("steps", trained.steps)):
        if key in settings.model_fields_set and getattr(settings, key) != value:
            raise ConfigError(
                f"predictor.{key} {getattr(settings, key)}: its weights {path} were trained with "
                f"{value}; leave the key out, or give other weights"
            )
