"""Mixer: perceptrons over time and over joints that predict how each joint's velocity continues.

No paper describes this network; it is small enough to train and run on two cores. It builds on

- Guo et al., "Back to MLP: A Simple Baseline for Human Motion Prediction" (siMLPe), WACV 2023:
  fully connected layers over a cosine transform of time forecast as well as attention does, and the
  loss should include velocity errors;
- Tolstikhin et al., "MLP-Mixer", NeurIPS 2021: layers over time and over channels in turn.

New here:

- A joint's forecast is its last position, plus its own velocities times factors from the network,
  plus a remainder. The velocities are over 1, 3 and 10 steps. A factor of 0 means standing still,
  and a factor equal to the time ahead means constant velocity, at any speed: the network learns
  *how long* a motion continues, which generalises to motion faster than its training data.
- Symmetry: the forecasts of the body and of its mirror image are averaged, so left and right are
  treated alike by construction (``mirrored``).

Unobserved joints are filled in and marked, as for every network.
"""

import math

import torch
from pydantic import Field
from torch import Tensor, nn

from hri_predict.predictors.neural.mirror import Mirror
from hri_predict.predictors.neural.network import (
    DECIMETRES,
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    last_pose,
    mpjpe,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor

BACK_STEPS = (1, 3, 10)
"""Numbers of steps over which velocities are measured."""
_PER_JOINT = len(BACK_STEPS) + 3  # a factor for each velocity, and the rest


class MixerOptions(NetworkOptions):
    """Sizes and switches of the mixer.

    Attributes:
        width: channels of a step.
        blocks: pairs of a layer over time and one over channels.
        dropout: share of channels left out in training.
        velocity_weight: weight of the error of velocities in the loss, seconds.
        mirrored: average with the forecast of the mirror image; y must point to the left, as in
            body frames and in the benchmark's. A skeleton without left-right pairs is not mirrored.
    """

    width: int = Field(192, ge=1, le=4096)
    blocks: int = Field(6, ge=1, le=64)
    dropout: float = Field(0.1, ge=0, lt=1)
    velocity_weight: float = Field(0.04, ge=0)
    mirrored: bool = True


class Mixer(Network):
    """Cosine transform, blocks over time and channels, factors and remainder per joint and step."""

    options_model = MixerOptions
    exportable = True
    options: MixerOptions
    cosines: Tensor
    ahead: Tensor

    def __init__(self, shape: Shape, options: MixerOptions) -> None:
        super().__init__(shape)
        self.options = options
        self.mirrors = options.mirrored and bool(shape.skeleton.left_right_pairs)
        steps, width = shape.history_steps, options.width
        self.register_buffer("cosines", cosine_matrix(steps), persistent=False)
        ahead = torch.arange(1, shape.horizon_steps + 1, dtype=torch.float32)
        self.register_buffer("ahead", ahead[:, None, None], persistent=False)
        self.mirror = Mirror(shape.skeleton)
        self.moved = nn.Linear(4 * shape.joints, width)
        self.pose = nn.Linear(4 * shape.joints, width)
        self.blocks = nn.Sequential(
            *(Block(steps, width, options.dropout) for _ in range(options.blocks))
        )
        self.norm = nn.LayerNorm(width)
        self.to_future = nn.Linear(steps, shape.horizon_steps)
        self.head = nn.Linear(width, _PER_JOINT * shape.joints)
        nn.init.zeros_(self.head.weight)  # an untrained network stands still
        nn.init.zeros_(self.head.bias)

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) metres in the body frame."""
        if not self.mirrors or self.training:
            return self._ahead(window)
        return self.mirror.averaged(self._ahead, window)

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """MPJPE of the positions, plus that of the velocities."""
        predicted = self(window)
        losses = {"position": mpjpe(predicted, target)}
        if self.options.velocity_weight == 0 or predicted.shape[1] < 2:
            return losses
        known = target.observed[:, 1:] & target.observed[:, :-1]
        velocity = Target(target.positions.diff(dim=1) * self.shape.rate_hz, known)
        wrong = mpjpe(predicted.diff(dim=1) * self.shape.rate_hz, velocity)
        return losses | {"velocity": self.options.velocity_weight * wrong}

    def _ahead(self, window: BodyFrames) -> Tensor:
        last = last_pose(window)
        seen = window.observed.to(last.dtype)
        moved = (window.positions - last) * DECIMETRES
        over_time = torch.cat([moved.flatten(2), seen], dim=2).transpose(1, 2) @ self.cosines
        pose = torch.cat([last[:, 0].flatten(1) * DECIMETRES, seen[:, -1]], dim=1)
        features = self.moved(over_time.transpose(1, 2)) + self.pose(pose)[:, None]
        features = self.norm(self.blocks(features)).transpose(1, 2)
        future = self.to_future(features).transpose(1, 2)
        said = self.head(future).unflatten(2, (self.shape.joints, _PER_JOINT))
        change = said[..., -3:] / DECIMETRES
        for index, back in enumerate(BACK_STEPS):
            steps = min(back, window.positions.shape[1] - 1)
            velocity = (last - window.positions[:, -1 - steps :][:, :1]) / steps
            change = change + said[..., index, None] * self.ahead * velocity
        return last + change


class Block(nn.Module):
    """A perceptron over time and one over channels, each with a residual connection."""

    def __init__(self, steps: int, width: int, dropout: float) -> None:
        super().__init__()
        self.time = nn.Sequential(
            nn.Linear(steps, 2 * steps), nn.GELU(), nn.Linear(2 * steps, steps)
        )
        self.channels = nn.Sequential(
            nn.Linear(width, 2 * width), nn.GELU(), nn.Dropout(dropout), nn.Linear(2 * width, width)
        )
        self.before_time, self.before_channels = nn.LayerNorm(width), nn.LayerNorm(width)

    def forward(self, features: Tensor) -> Tensor:
        """Map (B, T, C) to the same shape."""
        over_time = self.time(self.before_time(features).transpose(1, 2)).transpose(1, 2)
        features = features + over_time
        mixed: Tensor = features + self.channels(self.before_channels(features))
        return mixed


def cosine_matrix(steps: int) -> Tensor:
    """(T, T) matrix with the orthonormal cosines of DCT-II as columns."""
    time = torch.arange(steps, dtype=torch.float64)[:, None] + 0.5
    frequency = torch.arange(steps, dtype=torch.float64)[None]
    matrix = torch.cos(math.pi / steps * time * frequency) * math.sqrt(2 / steps)
    matrix[:, 0] /= math.sqrt(2)
    return matrix.float()


class MixerPredictor(NeuralPredictor):
    """Perceptrons over time and joints: how each joint's velocity continues (ours)."""

    method = "mixer"
    network_class = Mixer
