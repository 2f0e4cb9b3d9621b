"""The contract of every trained network: input, output and error.

A network sees a window in the person's own frame (``body_frame``), with unobserved positions filled
in and marked, and returns the future joints in that frame, in metres. It does not depend on rooms,
recordings or training runs.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, runtime_checkable

import torch
from torch import Tensor, nn

from hri_predict.base.settings import Settings
from hri_predict.base.skeleton import Skeleton
from hri_predict.contracts import registry
from hri_predict.predictors.neural.body_frame import (
    BodyFrame,
    body_frame,
    fill,
    neighbour_table,
    no_frame,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """Size of a network's task: joints, T history steps, H horizon steps, steps per second.

    Attributes:
        framed: positions are already in a frame of the body, as in the benchmark; they are then
            neither moved nor turned.
    """

    skeleton: Skeleton
    history_steps: int
    horizon_steps: int
    rate_hz: float
    framed: bool = False

    @property
    def joints(self) -> int:
        """J."""
        return len(self.skeleton.joints)


@dataclass(frozen=True, slots=True)
class BodyFrames:
    """A batch of histories in the body frame.

    Attributes:
        positions: (B, T, J, 3) metres, filled everywhere.
        observed: (B, T, J) bool; false where ``positions`` was filled in.
    """

    positions: Tensor
    observed: Tensor

    def to(self, device: torch.device) -> "BodyFrames":
        """The same on another device."""
        return BodyFrames(self.positions.to(device), self.observed.to(device))


@dataclass(frozen=True, slots=True)
class Target:
    """The true future in the same body frame, (B, H, J, 3), and where it is known.

    Attributes:
        past: the true past, (B, T, J, 3), without the noise that augmentation gave the window;
            ``None``: the window itself is true where it is observed.
        spread: (B, H, J) m, standard deviation per axis between the teachers whose mean the
            positions are; NaN where no teacher says them. ``None``: no teachers.
    """

    positions: Tensor
    observed: Tensor
    past: "Target | None" = None
    spread: Tensor | None = None

    def past_of(self, window: BodyFrames) -> "Target":
        """The truth (B, T, J, 3) of a window, known where its joints are observed."""
        if self.past is None:
            return Target(window.positions, window.observed)
        return Target(self.past.positions, self.past.observed & window.observed)

    def to(self, device: torch.device) -> "Target":
        """The same on another device."""
        past = None if self.past is None else self.past.to(device)
        spread = None if self.spread is None else self.spread.to(device)
        return Target(self.positions.to(device), self.observed.to(device), past, spread)


class NetworkOptions(Settings):
    """Sizes and switches of a network (``options:`` of a training configuration).

    Attributes:
        added: options that only add parts; training with them may start from weights without them.
        training: options that change no weight's shape or meaning, only how they are trained.
    """

    added: ClassVar[tuple[str, ...]] = ()
    training: ClassVar[tuple[str, ...]] = ()


class Network(nn.Module):
    """Base of the networks.

    Attributes:
        shape: size of its task.
        options: options it was built with; every network sets them, and weights files store them.
        rest: (J, 3) mean pose of its training data in the body frame; part of the weights.
        any_horizon: its parameters do not depend on H, so it can predict beyond its trained H.
        exportable: its forward pass has no branch that depends on values, and no loop over people,
            so an exported copy computes the same; see ``engine``.
    """

    options_model: ClassVar[type[NetworkOptions]] = NetworkOptions
    any_horizon: ClassVar[bool] = False
    exportable: ClassVar[bool] = False
    options: NetworkOptions
    rest: Tensor
    nearest: Tensor

    def __init__(self, shape: Shape) -> None:
        super().__init__()
        self.shape = shape
        self.register_buffer("rest", torch.zeros(shape.joints, 3))
        self.register_buffer("nearest", neighbour_table(shape.skeleton), persistent=False)

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) in the body frame.

        A network that states how wrong it may be returns (B, H, J, 4). The fourth number is the
        natural logarithm of the standard deviation per axis in metres; see ``deviation_loss``.
        """
        raise NotImplementedError

    def lean(self) -> Callable[[BodyFrames], Tensor]:
        """Return the forward pass for engines: ``forward`` for filled windows, with less work.

        Its result equals that of ``forward`` except for rounding. It may cache values computed from
        the weights, which must not change afterwards.
        """
        return self

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """The terms of the training loss by name, each a scalar with its weight.

        Args:
            window: the histories.
            target: the true future.
            progress: completed share of the training, 0 to 1; for losses with stages.
        """
        predicted = self(window)
        losses = {"position": mpjpe(predicted, target)}
        if predicted.shape[-1] == 4:
            losses["deviation"] = deviation_loss(predicted, target)
        return losses

    def loss(self, window: BodyFrames, target: Target, progress: float) -> Tensor:
        """The sum of ``losses``."""
        first, *others = self.losses(window, target, progress).values()
        return sum(others, first)

    def critic_loss(self, window: BodyFrames, target: Target, progress: float) -> Tensor | None:
        """Loss of the adversary, or ``None``; it changes only the adversary's parameters."""
        return None

    def critic_parameters(self) -> Iterator[nn.Parameter]:
        """The adversary's parameters; ``critic_loss`` optimises them. They are not shipped."""
        return iter(())

    def model_parameters(self) -> Iterator[nn.Parameter]:
        """All other parameters; ``loss`` optimises them."""
        critic = {id(p) for p in self.critic_parameters()}
        return (p for p in self.parameters() if id(p) not in critic)

    def enter(self, positions: Tensor, observed: Tensor) -> tuple[BodyFrames, BodyFrame]:
        """Bring histories (B, T, J, 3) in the room, and ``observed`` (B, T, J), into body frames.

        Computed in the dtype of ``positions``; the window has the network's dtype.
        """
        if self.shape.framed:
            frame = no_frame(positions)
        else:
            frame = body_frame(positions, observed, self.shape.skeleton)
        clean = torch.where(observed[..., None], frame.enter(positions), 0.0)
        filled = fill(clean, observed, self.rest.to(clean.dtype), self.nearest)
        return BodyFrames(filled.to(self.rest.dtype), observed), frame


class NetworkClass(Protocol):
    """A kind of network: a class of ``Network`` objects, built from a shape and options."""

    @property
    def options_model(self) -> type[NetworkOptions]:
        """The model that validates ``options:`` of a training configuration."""

    @property
    def any_horizon(self) -> bool:
        """See ``Network``."""

    def __call__(self, shape: Shape, options: Any, /) -> Network:
        """Make a network with random weights; ``options`` is an instance of ``options_model``."""


@runtime_checkable
class Trained(Protocol):
    """A kind of predictor with a network: it can be trained, and it loads weights."""

    @property
    def network_class(self) -> NetworkClass:
        """The network's class."""


def network_class_of(predictor: str) -> NetworkClass | None:
    """Return the network class of the predictor ``predictor``; ``None`` without a network.

    Raises:
        ConfigError: the predictor does not exist.
    """
    cls = registry.load("predictors", predictor)
    return cls.network_class if isinstance(cls, Trained) else None


_LEAST_SPREAD_M = 1e-3
DECIMETRES = 10.0
"""Per metre: networks work with lengths of about 1, as in section 5.2 of AuxFormer's paper."""


def last_pose(window: BodyFrames) -> Tensor:
    """(B, 1, J, 3) the newest step of the window."""
    return window.positions[:, -1:]


def mpjpe(predicted: Tensor, target: Target, weights: Tensor | None = None) -> Tensor:
    """Mean per joint position error over the known part of the future, metres.

    ``weights``: (H,) weight of each step, with mean 1; default: all alike.
    """
    error = (predicted[..., :3] - target.positions).square().sum(-1).add(1e-12).sqrt()
    known = target.observed if weights is None else target.observed * weights[:, None]
    return (error * known).sum() / known.sum().clamp(min=1)


def deviation_loss(predicted: Tensor, target: Target) -> Tensor:
    """Negative log-likelihood of the known part of the future, predicted as (B, H, J, 4).

    The mean over joints of 3 s + exp(-2 s) |error|^2 / 2, where s is the fourth number: A. Kendall,
    Y. Gal, "What Uncertainties Do We Need in Bayesian Deep Learning for Computer Vision?", NIPS
    2017, eq. 8, for three axes with one deviation. It trains the deviation only, and ``mpjpe``
    trains the positions: the likelihood would hardly train them where errors are large (M. Seitzer
    et al., "On the Pitfalls of Heteroscedastic Uncertainty Estimation with Probabilistic Neural
    Networks", ICLR 2022).
    """
    squared = (predicted[..., :3].detach() - target.positions).square().sum(-1)
    log, known = predicted[..., 3], target.observed
    each = 3.0 * log + 0.5 * squared * (-2.0 * log).exp()
    return (each * known).sum() / known.sum().clamp(min=1)


def stated_loss(predicted: Tensor, target: Target) -> Tensor:
    """Error of the fourth number of (B, H, J, 4): against the teachers' spread, where there is one.

    Logarithms are compared, so that a factor of two is as wrong in a hand as in a hip; a spread
    below a millimetre counts as one. Without teachers: ``deviation_loss``.
    """
    if target.spread is None:
        return deviation_loss(predicted, target)
    known = target.spread.isfinite()
    wanted = torch.where(known, target.spread, 1.0).clamp(min=_LEAST_SPREAD_M).log()
    return ((predicted[..., 3] - wanted).abs() * known).sum() / known.sum().clamp(min=1)
