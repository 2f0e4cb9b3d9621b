"""STB: a temporal and a spatial branch of graph convolutions on motion increments.

Source: Wang, Zhou, Qiang, Ba, Su and Wen, "Spatio-Temporal Branching for Motion Prediction using
Motion Increments", ACM Multimedia 2023; Sec. 3 and 4, Fig. 4.

Where this differs from the paper, or the paper leaves it open:

- Eq. 4's increment x(t+1) - x(t) contains the first future frame at the last observed one. Here
  it is causal: x(t) - x(t-1), 0 at the first frame. Padded frames repeat the last pose, so their
  increments are 0, too; with ``padding: held`` they repeat the last increment, as in the authors'
  code, where that increment contains the first future frame.
- Unobserved joints: increments are taken over filled-in values, and the observed mask is a further
  input (0 for padded frames). The loss over the past counts observed joints only.
- Eqs. 12-15 need one value per joint, but the output has three coordinates. The value is the length
  of the joint's change in decimetres, like all lengths inside, including the losses of Eq. 19.
- Neither side of Eq. 16 is detached: each branch is teacher and student of the other.
- Eqs. 17-18 print a squared norm but are called the average L2 distance: they are MPJPE here.
- The paper does not describe the inside of a layer. Here a graph layer is (learnt adjacency) x
  features x weights. A block normalises its input, applies two layers with ReLU and dropout in
  between, and adds the result to its input. Connectivity starts near the identity. The outputs of
  a block and of the decoder start at zero, so an untrained network predicts the last pose. The
  decoder's input isn't normalised, because the speed of the body would be lost.
"""

from functools import partial
from typing import Literal

import torch
from pydantic import Field
from torch import Tensor, nn

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


class STBOptions(NetworkOptions):
    """Sizes and switches of STB; 512 channels and 6 blocks make it as large as the paper's.

    Attributes:
        width: C, channels of a frame (temporal branch) or of a coordinate (spatial branch).
        blocks: number of blocks of each branch's encoder.
        inputs: Table 5: increments, or the positions themselves; ``both`` isn't in the paper.
        padding: increments of the padded frames: those of a body that is ``still``, or the last one
            ``held``.
        branches: Table 5: one branch alone, or the mean of both.
        distillation: lambda of Eq. 19 (Table 6); 0 leaves the distillation out (Table 5).
    """

    width: int = Field(320, ge=1, le=2048)
    blocks: int = Field(6, ge=1, le=64)
    dropout: float = Field(0.1, ge=0, lt=1)
    inputs: Literal["increments", "positions", "both"] = "increments"
    padding: Literal["still", "held"] = "still"
    branches: Literal["both", "temporal", "spatial"] = "both"
    distillation: float = Field(0.1, ge=0, le=1000)


class STB(Network):
    """The two branches; each maps the padded sequence to all its T + H frames."""

    options_model = STBOptions
    exportable = True
    options: STBOptions

    def __init__(self, shape: Shape, options: STBOptions) -> None:
        super().__init__(shape)
        self.options = options
        frames, coordinates = shape.history_steps + shape.horizon_steps, 3 * shape.joints
        kinds = 3 if options.inputs == "both" else 2  # kinds of features, including the mask
        make = partial(Branch, width=options.width, blocks=options.blocks, dropout=options.dropout)
        self.branches = nn.ModuleDict()
        if options.branches != "spatial":
            features = (kinds - 1) * coordinates + shape.joints
            self.branches["temporal"] = make(nodes=frames, inputs=features, outputs=coordinates)
        if options.branches != "temporal":
            self.branches["spatial"] = make(
                nodes=coordinates, inputs=kinds * frames, outputs=frames
            )

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) metres in the body frame: the mean of the branches (Eq. 20)."""
        changes = torch.stack(list(self._changes(window).values())).mean(0)
        return last_pose(window) + changes[:, self.shape.history_steps :] / DECIMETRES

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """Eq. 19, converted from decimetres to metres."""
        padded = self._padded(window)
        past = target.past_of(window)
        sequence = Target(
            torch.cat([past.positions, target.positions], dim=1) * DECIMETRES,
            torch.cat([past.observed, target.observed], dim=1),
        )
        changes = self._changes(window)
        losses = {k: mpjpe(padded + change, sequence) for k, change in changes.items()}  # 17, 18
        if len(changes) == 2 and self.options.distillation > 0:
            divergence = distillation(changes["temporal"], changes["spatial"])
            losses["distillation"] = self.options.distillation * divergence
        return {name: loss / DECIMETRES for name, loss in losses.items()}

    def _padded(self, window: BodyFrames) -> Tensor:
        """X of Sec. 3.1: (B, T + H, J, 3) decimetres, the last pose repeated H times."""
        future = last_pose(window).expand(-1, self.shape.horizon_steps, -1, -1)
        return torch.cat([window.positions, future], dim=1) * DECIMETRES

    def _changes(self, window: BodyFrames) -> dict[str, Tensor]:
        """Return what each branch adds to the padded sequence, (B, T + H, J, 3) decimetres."""
        features = self._features(window)
        mask = window.observed.to(features[0].dtype)
        mask = nn.functional.pad(mask, (0, 0, 0, self.shape.horizon_steps))
        changes = {}
        if "temporal" in self.branches:
            changes["temporal"] = self._by_time(features, mask)
        if "spatial" in self.branches:
            changes["spatial"] = self._by_space(features, mask)
        return changes

    def _features(self, window: BodyFrames) -> list[Tensor]:
        """Return the features in the options, each (B, T + H, J, 3)."""
        padded = self._padded(window)
        if self.options.inputs == "positions":
            return [padded]
        # Eq. 4 made causal: the increment at t does not contain frame t + 1.
        increments = nn.functional.pad(padded[:, 1:] - padded[:, :-1], (0, 0, 0, 0, 1, 0))
        if self.options.padding == "held":
            past, horizon = self.shape.history_steps, self.shape.horizon_steps
            last = increments[:, past - 1 : past].expand(-1, horizon, -1, -1)
            increments = torch.cat([increments[:, :past], last], 1)
        return [increments] if self.options.inputs == "increments" else [increments, padded]

    def _by_time(self, features: list[Tensor], mask: Tensor) -> Tensor:
        """Nodes are frames (Eqs. 7-9)."""
        nodes = torch.cat([*(f.flatten(2) for f in features), mask], dim=2).transpose(0, 1)
        changes: Tensor = self.branches["temporal"](nodes)
        return changes.transpose(0, 1).unflatten(2, (-1, 3))

    def _by_space(self, features: list[Tensor], mask: Tensor) -> Tensor:
        """Nodes are the coordinates of the joints (Eqs. 10-11)."""
        seen = mask[..., None].expand_as(features[0])
        nodes = torch.cat([*features, seen], dim=1).flatten(2).permute(2, 0, 1)
        changes: Tensor = self.branches["spatial"](nodes)
        return changes.permute(1, 2, 0).unflatten(2, (-1, 3))


class Branch(nn.Module):
    """Embedding (Eq. 7), encoder (Eqs. 8, 10) and one-layer decoder (Eqs. 9, 11) of one domain."""

    def __init__(
        self, *, nodes: int, inputs: int, outputs: int, width: int, blocks: int, dropout: float
    ) -> None:
        super().__init__()
        self.embedding = nn.Sequential(nn.Linear(inputs, width), nn.ReLU(), nn.Linear(width, width))
        self.encoder = nn.Sequential(*(GraphBlock(nodes, width, dropout) for _ in range(blocks)))
        self.decoder = GraphLayer(nodes, width, outputs, silent=True)

    def forward(self, nodes: Tensor) -> Tensor:
        """Map (N, B, inputs) to (N, B, outputs)."""
        decoded: Tensor = self.decoder(self.encoder(self.embedding(nodes)))
        return decoded


class GraphBlock(nn.Module):
    """Two graph layers around a residual connection."""

    def __init__(self, nodes: int, width: int, dropout: float) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.first = GraphLayer(nodes, width, width)
        self.second = GraphLayer(nodes, width, width, silent=True)
        self.dropout = nn.Dropout(dropout)

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, B, C) to the same shape."""
        inner = self.first(self.norm(features)).relu()
        if self.training:  # drop a channel at all nodes: needs 1/100 of the random numbers
            inner = inner * self.dropout(torch.ones_like(inner[:1]))
        change: Tensor = self.second(inner)
        return features + change


class GraphLayer(nn.Module):
    """A x W of a graph whose connectivity A (N, N) is learnt; a ``silent`` one starts at zero."""

    def __init__(self, nodes: int, inputs: int, outputs: int, silent: bool = False) -> None:
        super().__init__()
        noise = torch.randn(nodes, nodes) / nodes**0.5
        self.adjacency = nn.Parameter(torch.eye(nodes) + 0.1 * noise)
        self.weights = nn.Linear(inputs, outputs)
        if silent:
            nn.init.zeros_(self.weights.weight)
            nn.init.zeros_(self.weights.bias)

    def forward(self, features: Tensor) -> Tensor:
        """Map (N, B, inputs) to (N, B, outputs); with nodes first, both products are plain."""
        weighted = self.weights(features)
        return (self.adjacency @ weighted.flatten(1)).view_as(weighted)


def distillation(temporal: Tensor, spatial: Tensor) -> Tensor:
    """L_KL of Eq. 16, a mean over the batch, from two (B, N, J, 3) changes.

    A joint's motion energy is the length of its change. It is normalised to a distribution over the
    joints of each frame (Eqs. 12, 14) to compare the temporal branch to the spatial one, and to a
    distribution over the frames of each joint (Eqs. 13, 15) to compare the spatial branch to the
    temporal one.
    """
    t, s = _energy(temporal), _energy(spatial)
    over_joints = _divergence(t.log_softmax(2), s.log_softmax(2))
    over_frames = _divergence(s.log_softmax(1), t.log_softmax(1))
    return (over_joints + over_frames) / len(t)


def _energy(change: Tensor) -> Tensor:
    return change.square().sum(-1).add(1e-12).sqrt()


def _divergence(p: Tensor, q: Tensor) -> Tensor:
    """The sum of KL(p || q), from the logarithms of p and q."""
    return (p.exp() * (p - q)).sum()


class STBPredictor(NeuralPredictor):
    """Graph branches over time and over the body, from motion increments (STB)."""

    method = "stb"
    network_class = STB
