"""Long predictions from short ones: temporal aggregation with a forget unit.

Chen et al., "Rethinking Human Motion Prediction with Symplectic Integral", CVPR 2024, section 3.2.
A network that predicts t steps is applied again and again with the same weights until the whole
horizon is covered (Eqs. 8-9); before each time a forget unit drops the t oldest steps of its window
and appends the t just predicted. It works with any network (the paper's Table 5 wraps six others).

The window is read again each time. A recurrent network could continue from its last state at a
fifth of the cost, but would then remember steps that the forget unit drops.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from pydantic import Field
from torch import Tensor, nn

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    network_class_of,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor
from hri_predict.predictors.neural.settings import AggregatedSettings, NeuralSettings
from hri_predict.predictors.neural.weights import Header, LoadedWeights, load_weights


def forget(window: BodyFrames, predicted: Tensor) -> BodyFrames:
    """Drop the t oldest steps, and append those ``predicted`` (B, t, J, 3).

    Predicted joints count as observed: nothing better is known about them.
    """
    steps = window.positions.shape[1]
    seen = window.observed.new_ones(predicted.shape[:3])
    return BodyFrames(
        torch.cat([window.positions, predicted], 1)[:, -steps:],
        torch.cat([window.observed, seen], 1)[:, -steps:],
    )


def aggregate(
    operator: Callable[[BodyFrames], Tensor], window: BodyFrames, horizon_steps: int
) -> Tensor:
    """Apply ``operator``, a window to (B, t, J, 3), until (B, horizon_steps, J, 3) are predicted.

    If the horizon is not a multiple of t, only the start of the last application is used.
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
    """Options: the wrapped network, and how it is trained.

    Attributes:
        method: name of the predictor whose network is wrapped.
        steps: t, number of steps that the network predicts at a time.
        options: the network's sizes and switches.
        pretraining: share of the training in which it learns only its own t steps.
    """

    method: str = "trajectorycnn"
    steps: int = Field(5, ge=1, le=1000)
    options: dict[str, Any] = {}
    pretraining: float = Field(0.5, ge=0, le=1)


class Aggregated(Network):
    """Any predictor's network that predicts a few steps, chained to predict many.

    Its loss has two stages: first the inner network learns its own steps with its own loss, then
    the position error over the whole horizon. The inner network handles unobserved joints.

    Attributes:
        inner: the inner network.

    Raises:
        ConfigError: the predictor does not exist, it has no network, or an option is wrong.
    """

    options_model = AggregatedOptions
    any_horizon = True

    def __init__(self, shape: Shape, options: AggregatedOptions) -> None:
        super().__init__(shape)
        self.options: AggregatedOptions = options
        network_class = network_class_of(options.method)
        if network_class is None:
            raise ConfigError(
                f"options.method '{options.method}': no network; name a trained predictor"
            )
        own = validated(network_class.options_model, options.options, "options.options")
        self.inner = network_class(replace(shape, horizon_steps=options.steps), own)
        self.inner.rest = (
            self.rest
        )  # one tensor: setting or loading the outer one sets the inner one

    @classmethod
    def around(cls, inner: LoadedWeights, steps: int, horizon_steps: int) -> "Aggregated":
        """Wrap a network trained on its own; each application uses its first ``steps``."""
        network = inner.network
        options = AggregatedOptions(
            method=inner.method, steps=steps, options=network.options.model_dump()
        )
        whole = cls(replace(network.shape, horizon_steps=horizon_steps), options)
        whole.inner, whole.rest = network, network.rest
        return whole.eval().requires_grad_(False)

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) in the body frame."""
        return aggregate(self._operator, window, self.shape.horizon_steps)

    def _operator(self, window: BodyFrames) -> Tensor:
        predicted: Tensor = self.inner(window)
        # a network trained by itself predicts more steps; its deviation takes its window for seen
        return predicted[:, : self.options.steps, :, :3]

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """Return the inner network's losses on its own steps, later the error over all steps."""
        if self._pretraining(progress):
            return self.inner.losses(window, self._near(target), self._inner_progress(progress))
        return super().losses(window, target, progress)

    def critic_loss(self, window: BodyFrames, target: Target, progress: float) -> Tensor | None:
        """Return the loss of the inner network's adversary during pretraining."""
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
        near = slice(self.options.steps)
        spread = None if target.spread is None else target.spread[:, near]
        return Target(target.positions[:, near], target.observed[:, near], target.past, spread)


class AggregatedPredictor(NeuralPredictor):
    """Repeats another trained predictor on its own first steps (SINN's temporal aggregation).

    Its weights are those of the inner predictor (the shipped ones by default), or come from
    training ``aggregated`` itself, and then name the inner predictor. It extends any predictor to
    any horizon. Within the inner predictor's own horizon it brings no gain, unless the inner
    predictor was trained for it: on the validation recordings the shipped trajectorycnn has an
    error of 246 mm after 1 s when repeated every 5 steps, and of 188 mm by itself. It states no
    deviation, even if the inner predictor does.
    """

    method = "aggregated"
    network_class = Aggregated
    settings_model = AggregatedSettings

    def _weights_method(self, settings: NeuralSettings) -> str:
        assert isinstance(settings, AggregatedSettings)
        if network_class_of(settings.inner) is None:
            raise ConfigError(
                f"predictor.inner '{settings.inner}': no network; name a trained predictor"
            )
        return settings.inner

    def _load(
        self, path: Path, header: Header, settings: NeuralSettings, horizon_steps: int
    ) -> LoadedWeights:
        assert isinstance(settings, AggregatedSettings)
        if header.method == self.method:
            _check_same(settings, header, path)
            return load_weights(path, horizon_steps)
        network_class = network_class_of(header.method)
        any_horizon = network_class is not None and network_class.any_horizon
        inner = load_weights(path, settings.steps if any_horizon else None)
        reach = inner.network.shape.horizon_steps
        if reach < settings.steps:
            raise ConfigError(
                f"predictor.steps {settings.steps}: '{settings.inner}' predicts {reach} steps at a "
                f"time with its weights {path}; use {reach} at most"
            )
        whole = Aggregated.around(inner, settings.steps, horizon_steps)
        return LoadedWeights(whole, self.method, inner.card)


def _check_same(settings: AggregatedSettings, header: Header, path: Path) -> None:
    """Refuse a configuration that contradicts what its weights were trained with."""
    trained = AggregatedOptions.model_validate(header.options)
    for key, value in (("inner", trained.method), ("steps", trained.steps)):
        if key in settings.model_fields_set and getattr(settings, key) != value:
            raise ConfigError(
                f"predictor.{key} {getattr(settings, key)}: its weights {path} were trained with "
                f"{value}; leave the key out, or give other weights"
            )
