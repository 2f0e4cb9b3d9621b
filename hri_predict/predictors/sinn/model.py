"""SINN: short GRU predictions of how joints move, direction by direction, chained into long ones.

Source: Chen, Lyu, Liu, Yin, Yang and Lyu, "Rethinking Human Motion Prediction with Symplectic
Integral", CVPR 2024.

Where this differs from the paper, or the paper leaves it open:

- Angles at rest. The angles of a displacement of zero length are undefined, and those of a tiny one
  are noise. Here the magnitude is sqrt(|v|^2 + e^2), as if there were always a displacement e
  perpendicular to all three directions. Angles fade to 0 towards rest, everything is smooth, and
  magnitude times sine of an angle is still exactly that coordinate of v.
- Splitting (Eq. 3) is by direction, with all joints of one direction together; a GRU per joint
  would read J times as many sequences (``splitting: joint``). The paper has "multiple GRUs"; here
  one GRU reads the three directions as a batch with a label for each. ``shared: false`` gives each
  direction its own GRU: three times the weights, and a forecast for one person takes several times
  as long.
- Besides momentum the operator reads, per joint, whether it was observed and where it is relative
  to the pelvis: momentum alone does not determine the pose.
- The output is a change to the last momentum, which fades by a learnt factor per step.
- The first momentum and the last pose may be filtered from the last frames, and the whole change
  gated (``start_frames``, ``gate``; see ``start``). The paper's first momentum is the difference of
  the last two frames (``start_frames: 0``).
- Errors in momentum (Eqs. 10-11) are means over joints and channels, magnitudes in m/s. MPJPE is
  added, because evaluations measure it and it weights angles by how far they move a joint. A weight
  of zero disables the respective term.
- The critic is kept Lipschitz by a gradient penalty (Gulrajani et al., NeurIPS 2017). By Eq. 12 its
  score is low for real motion, so the operator learns to lower the score of its forecasts.
- The network is trained on all actions together and pre-trained on windows that start anywhere.

Unobserved joints are filled in; their momentum is that of the filled track: zero before the first
observation. A mask channel marks each momentum with an unobserved end.
"""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import ClassVar, Literal, Self

import torch
import torch.nn.functional as F
from pydantic import Field, model_validator
from torch import Tensor, nn

from hri_predict.predictors.neural.body_frame import fill
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    last_pose,
    mpjpe,
    stated_loss,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.predictors.neural.weights import Header, LoadedWeights, load_weights
from hri_predict.predictors.sinn.side_by_side import SideBySide, fits
from hri_predict.predictors.sinn.spread import Spread
from hri_predict.predictors.sinn.start import Start, Started, gated
from hri_predict.predictors.sinn.symplectic import (
    Critic,
    Operator,
    Representation,
    momentum_error,
)
from hri_predict.predictors.temporal_aggregation import aggregate

_SPREAD_WEIGHT = 0.01  # it trains the spread alone; of metres, as the others are
_START_UNITS = 64  # as many as suffice for a few numbers of one joint


class SINNOptions(NetworkOptions):
    """Sizes and switches of SINN.

    Attributes:
        hidden: GRU units; 256 as in the paper.
        operator_steps: t, steps that the operator predicts at a time; 5 as in the paper.
        aggregation: Table 4, without STA: one GRU predicts the whole horizon directly.
        representation: Table 4, without SRE: ``displacement`` or ``position`` instead.
        splitting: Eq. 3 by ``direction``; by ``joint`` as well; or ``none``, one GRU for all.
        shared: use one GRU for all three directions instead of one for each.
        pose: coordinates relative to the pelvis that each GRU also receives: along its own
            ``direction``, along ``all`` three, or ``none``.
        start_frames: frames from which the first momentum and the last pose are filtered; 0: the
            paper's difference of the last two.
        gate: with ``start_frames``: scale each joint's change by a gate on its recent motion.
        spread: with ``start_frames``: foresee how far the teachers differ (``train.teachers``).
        pretraining: share of the training in which the operator alone learns (L_so).
        momentum_weight: weight of L_so and L_g.
        position_weight: weight of the MPJPE, per metre, in both stages.
        adversarial_weight: weight of the critic's score in the second stage; 0 for no adversary.
        critic_steps: horizon steps that the critic reads; it does not depend on the horizon.
        gradient_penalty: weight of the critic's gradient penalty.
    """

    hidden: int = Field(256, ge=1, le=4096)
    operator_steps: int = Field(5, ge=1, le=1000)
    aggregation: bool = True
    representation: Literal["symplectic", "displacement", "position"] = "symplectic"
    splitting: Literal["direction", "joint", "none"] = "direction"
    shared: bool = True
    pose: Literal["none", "direction", "all"] = "all"
    start_frames: int = Field(0, ge=0, le=25)
    gate: bool = False
    spread: bool = False
    pretraining: float = Field(0.4, ge=0, le=1)
    momentum_weight: float = Field(0.2, ge=0)
    position_weight: float = Field(1.0, ge=0)
    adversarial_weight: float = Field(1e-4, ge=0)
    critic_steps: int = Field(25, ge=1, le=1000)
    gradient_penalty: float = Field(10.0, ge=0)

    added: ClassVar[tuple[str, ...]] = ("start_frames", "gate", "spread")
    training: ClassVar[tuple[str, ...]] = (
        "pretraining", "momentum_weight", "position_weight", "adversarial_weight",
        "gradient_penalty",
    )  # fmt: skip

    @model_validator(mode="after")
    def _start_fits(self) -> Self:
        if self.start_frames == 1:
            raise ValueError("start_frames 1: one frame has no velocity; use 0, or 2 or more")
        if self.start_frames and self.representation == "position":
            raise ValueError("start_frames: positions have no first velocity; use 0")
        for name in ("gate", "spread"):
            if getattr(self, name) and not self.start_frames:
                raise ValueError(f"{name}: needs the last frames; set start_frames (7)")
        return self


class SINN(Network):
    """SINN (Fig. 2): representation, symplectic operator, temporal aggregation."""

    options_model = SINNOptions
    any_horizon = True  # with aggregation
    exportable = True

    def __init__(self, shape: Shape, options: SINNOptions) -> None:
        super().__init__(shape)
        self.options: SINNOptions = options
        self.steps = options.operator_steps if options.aggregation else shape.horizon_steps
        self.representation = Representation(options.representation, shape.rate_hz)
        self.operator = Operator(
            joints=shape.joints,
            steps=self.steps,
            channels=self.representation.channels,
            hidden=options.hidden,
            splitting=options.splitting,
            shared=options.shared,
            pose=options.pose,
        )
        frames = min(options.start_frames, shape.history_steps)
        self.start = (
            Start(shape.joints, frames, _START_UNITS, options.gate) if frames >= 2 else None
        )
        self.spread = Spread(_START_UNITS) if options.spread and self.start else None
        per_step = shape.joints * (2 + self.representation.channels)
        self.critic = Critic(options.critic_steps * per_step, options.hidden)
        self._rolled: tuple[BodyFrames, Tensor, Tensor, Tensor] | None = None

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3 or 4) in the body frame, integrated from the last pose."""
        return self._roll(window, self.shape.horizon_steps)[0]

    def lean(self) -> Callable[[BodyFrames], Tensor]:
        """The forward pass with side-by-side readings, if the options allow it."""
        if not fits(self.operator, self.options.representation, self.shape.history_steps):
            return self
        root = None if self.shape.framed else self.shape.skeleton.parents.index(-1)
        rolled = SideBySide(self.operator, self.shape.history_steps, self.shape.rate_hz, root)

        def ahead(window: BodyFrames) -> Tensor:
            window, first, started = self._started(window)
            positions = rolled(window.positions, window.observed, first, self.shape.horizon_steps)
            return self._ended(positions, started)

        return ahead

    def _roll(self, window: BodyFrames, horizon_steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """Forecast (B, H, J, 3 or 4); its momenta (B, H, J, 3, C); the pose it starts from."""
        zetas: list[Tensor] = []
        window, first, started = self._started(window)
        last = last_pose(window)

        def operate(current: BodyFrames) -> Tensor:
            read = self.representation.read(current)
            begin = None if zetas else first
            zetas.append(self.operator(read, current.observed, self._pose(current), begin))
            return self.representation.integrate(last_pose(current), zetas[-1])

        forecast = self._ended(aggregate(operate, window, horizon_steps), started)
        return forecast, torch.cat(zetas, 1)[:, :horizon_steps], last

    def _started(self, window: BodyFrames) -> tuple[BodyFrames, Tensor | None, Started | None]:
        """The window with its last pose filtered, the first momentum, and what it starts from."""
        if self.start is None:
            return window, None, None
        started: Started = self.start(window, self.shape.rate_hz)
        first = self.representation.of_velocity(started.velocity)
        window = BodyFrames(torch.cat([window.positions[:, :-1], started.last], 1), window.observed)
        return window, first, started

    def _ended(self, positions: Tensor, started: Started | None) -> Tensor:
        """The forecast, gated and with its spread where the options ask for them."""
        if started is None:
            return positions
        if started.gate is not None:
            positions = gated(started.last, positions, started.gate)
        if self.spread is None:
            return positions
        spread = self.spread(started.known, started.last, positions)
        return torch.cat([positions, spread], -1)

    def _pose(self, window: BodyFrames) -> Tensor:
        if self.shape.framed:
            return window.positions
        root = self.shape.skeleton.parents.index(-1)
        return window.positions - window.positions[:, :, root : root + 1]

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """L_so over the operator's steps, later L_g over all; both with the position error."""
        pretraining = progress < self.options.pretraining
        if pretraining:
            window, target = self._anywhere(window, target, progress)
        adversarial = self.options.adversarial_weight * (not pretraining)
        if not pretraining and adversarial == self.options.momentum_weight == 0:
            return self._of_positions(self.lean()(window), target)  # a third less time
        forecast, zeta, last = self._rolled_out(window, target.positions.shape[1])
        truth, known = self._truth(window, last, target)
        momentum = momentum_error(zeta, truth, known, not pretraining)  # Eq. 10, later Eq. 11
        losses = {"momentum": self.options.momentum_weight * momentum}
        losses |= self._of_positions(forecast, target)
        if adversarial == 0:
            return losses
        score = self.critic(self._motion(zeta, known), frozen=True).mean()
        return losses | {"adversarial": adversarial * score}

    def _of_positions(self, forecast: Tensor, target: Target) -> dict[str, Tensor]:
        losses = {"position": self.options.position_weight * mpjpe(forecast, target)}
        if forecast.shape[-1] == 4:
            losses["spread"] = _SPREAD_WEIGHT * stated_loss(forecast, target)
        return losses

    def critic_loss(self, window: BodyFrames, target: Target, progress: float) -> Tensor | None:
        """L_c (Eq. 12) with a gradient penalty; ``None`` while the operator alone learns."""
        if progress < self.options.pretraining or self.options.adversarial_weight == 0:
            return None
        forecast, zeta, last = self._roll(window, target.positions.shape[1])
        self._rolled = (window, forecast, zeta, last)
        truth, known = self._truth(window, last, target)
        return self.critic.loss(
            self._motion(truth, known),
            self._motion(zeta.detach(), known),
            self.options.gradient_penalty,
            mix=float(torch.rand((), generator=_generator(progress))),
        )

    def critic_parameters(self) -> Iterator[nn.Parameter]:
        """Yield the parameters of the critic."""
        return self.critic.parameters()

    def _rolled_out(self, window: BodyFrames, horizon_steps: int) -> tuple[Tensor, Tensor, Tensor]:
        """Return the rollout of ``_roll``; reuse that of ``critic_loss`` for the same window."""
        rolled, self._rolled = self._rolled, None
        if rolled is not None and rolled[0] is window:
            return rolled[1:]
        return self._roll(window, horizon_steps)

    def _anywhere(
        self, window: BodyFrames, target: Target, progress: float
    ) -> tuple[BodyFrames, Target]:
        """A window that starts anywhere in history and future, and the operator's next steps."""
        positions = torch.cat([window.positions, target.positions], 1)
        observed = torch.cat([window.observed, target.observed], 1)
        spare = target.positions.shape[1] - self.steps
        start = int(torch.randint(max(spare, 0) + 1, (), generator=_generator(progress)))
        end = start + window.positions.shape[1]
        filled = fill(
            positions[:, start:end].cpu(),
            observed[:, start:end].cpu(),
            self.rest.cpu(),
            self.nearest.cpu(),
        ).to(positions.device)
        ahead = slice(end, end + self.steps)
        return (
            BodyFrames(filled, observed[:, start:end]),
            Target(positions[:, ahead], observed[:, ahead]),
        )

    def _truth(self, window: BodyFrames, last: Tensor, target: Target) -> tuple[Tensor, Tensor]:
        """The true momenta from the pose ``last`` on, and (B, H, J) where they are known."""
        truth = self.representation.truth(last.detach(), target.positions)
        before = torch.cat([window.observed[:, -1:], target.observed[:, :-1]], 1)
        return truth, target.observed & before

    def _motion(self, zeta: Tensor, known: Tensor) -> Tensor:
        """The critic's input: (B, inputs), zero where unknown or beyond the horizon."""
        flat = (self.representation.tuples(zeta) * known[..., None]).flatten(1)
        missing = self.critic.inputs - flat.shape[1]
        return F.pad(flat, (0, missing))  # cuts where negative


def _generator(progress: float) -> torch.Generator:
    """Random numbers that are the same in all processes of a run, and in a resumed run."""
    return torch.Generator().manual_seed(int(progress * 2**40))


class SINNPredictor(NeuralPredictor):
    """Short GRU predictions of how joints move, chained into long ones (SINN)."""

    method = "sinn"
    network_class = SINN

    def _load(
        self, path: Path, header: Header, settings: NeuralSettings, horizon_steps: int
    ) -> LoadedWeights:
        if header.options.get("aggregation") is False:  # its horizon is in the weights
            return load_weights(path)
        return super()._load(path, header, settings, horizon_steps)
