"""TrajectoryCNN: convolutions over joints and coordinates, with the frames as channels.

Source: Liu, Yin, Liu, Ding, Liu and Liu, "TrajectoryCNN: A New Spatio-Temporal Feature Learning
Network for Human Motion Prediction", IEEE TCSVT 31(6), 2021; Sec. III-C and Fig. 2.

Where this differs from the paper, or the paper leaves it open:

- The observed mask forms further input channels (broadcast over the coordinates), so unobserved
  joints are filled in *and* marked. The paper considers complete bodies only.
- The input is the frames' displacements from the last pose, and the last pose itself
  (``relative: true``). This is an invertible linear change of the paper's raw positions before a
  linear layer: the same network, but it trains faster. Lengths are in decimetres inside.
- The text does not say where the 1x1 branches leave and join. ``paths: nested`` has the three of
  the authors' code (https://github.com/lily2lab/TrajectoryCNN, layers/TrajBlock.py), each inside
  the one before: around the block, from layer 1 to the input of layer 5, from layer 2 to that of
  layer 4; each with its own LeakyReLU, as after the trajectory space. The default, ``paths:
  pairs``, is an older reading: around layers 2 and 3, and around 4 and 5.
- The paper does not give LeakyReLU's slope. The authors' code has TensorFlow's 0.2; the default is
  PyTorch's 0.01.
- The shipped weights were trained with ``paths: nested`` and ``slope: 0.2``, as in the authors'
  code.
- The paper does not give the dropout rate. (The authors' code has 0.25 for CMU.)
- The authors' code trains on each batch a second time, reversed in time: ``data.reverse: 0.5`` of
  the benchmark, ``data.augment.reverse`` of recordings. The paper does not say so.
- Eq. 5 prints a squared norm but is called, and evaluated as, MPJPE; here the loss is MPJPE.
"""

from typing import ClassVar, Literal

import torch
from pydantic import Field
from torch import Tensor, nn
from torch.nn import functional

from hri_predict.base.skeleton import Skeleton
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

PART_ORDER = ("right_arm", "left_arm", "torso", "right_leg", "left_leg")
"""Sec. III-C; joints of one part are adjacent rows."""

_KERNELS = {"3x3": (3, 3), "1x3": (1, 3), "1x1": (1, 1)}
_LAYERS = 5  # of a trajectory block


class TrajectoryCNNOptions(NetworkOptions):
    """Sizes and switches of TrajectoryCNN; the defaults are the paper's 64 channels, 4 blocks.

    Attributes:
        kernel: Table VI: ``1x1`` (w/o C-ST #1) sees one coordinate of one joint, ``1x3`` (#2) one
            joint; this applies to the whole network.
        layout: Table VII: ``trajectory`` has the frames as channels; ``pose`` (w/o GTC) has the
            frames as width, the joints as height, the coordinates as channels.
        residual: Table VIII: use the 1x1 branches of the blocks; false is "w/o DLG".
        paths: arrangement of the branches: the three ``nested`` ones, or around two ``pairs`` of
            layers.
        slope: slope of LeakyReLU below zero.
        relative: feed displacements from the last pose, not raw positions.
        mirrored: average with the forecast of the mirror image, as the mixer does; not in the
            paper.
        decoder: channels between the decoder's layers; default: as many as predicted frames. With
            few frames this is a bottleneck.
        bone_weight: weight of the error of bone vectors (from parent to joint) in the loss; 0 in
            the paper.
        early: how much more the first steps weigh in the loss: step h (from 1) weighs as h to the
            power of minus this; 0 in the paper. Relative errors are larger there.
    """

    training: ClassVar[tuple[str, ...]] = ("bone_weight", "early")

    channels: int = Field(64, ge=1, le=1024)
    blocks: int = Field(4, ge=1, le=32)
    dropout: float = Field(0.05, ge=0, lt=1)
    kernel: Literal["3x3", "1x3", "1x1"] = "3x3"
    layout: Literal["trajectory", "pose"] = "trajectory"
    residual: bool = True
    paths: Literal["pairs", "nested"] = "pairs"
    slope: float = Field(0.01, ge=0, le=1)
    relative: bool = True
    mirrored: bool = False
    decoder: int | None = Field(None, ge=1, le=1024)
    bone_weight: float = Field(0.0, ge=0, le=100)
    early: float = Field(0.0, ge=0, le=2)


class TrajectoryCNN(Network):
    """TrajectoryCNN (Fig. 2): trajectory space, encoder of trajectory blocks, decoder."""

    options_model = TrajectoryCNNOptions
    exportable = True
    options: TrajectoryCNNOptions
    order: Tensor
    place: Tensor
    step_weights: Tensor
    bones: Tensor

    def __init__(self, shape: Shape, options: TrajectoryCNNOptions) -> None:
        super().__init__(shape)
        self.options = options
        self.mirrors = options.mirrored and bool(shape.skeleton.left_right_pairs)
        self.mirror = Mirror(shape.skeleton)
        order = torch.tensor(part_order(shape.skeleton))
        self.register_buffer("order", order, persistent=False)
        self.register_buffer("place", order.argsort(), persistent=False)
        kernel = _KERNELS[options.kernel]
        if options.layout == "trajectory":
            inputs, outputs = 2 * shape.history_steps, shape.horizon_steps
        else:
            inputs, outputs = 4, 3  # coordinates and the mask; coordinates
        width = options.channels
        block = NestedBlock if options.paths == "nested" else TrajectoryBlock
        steps = torch.arange(1.0, shape.horizon_steps + 1) ** -options.early
        self.register_buffer("step_weights", steps / steps.mean(), persistent=False)
        bones = [(i, parent) for i, parent in enumerate(shape.skeleton.parents) if parent >= 0]
        self.register_buffer("bones", torch.tensor(bones).T, persistent=False)
        self.trajectory_space = _convolution(inputs, width)  # Eq. 1
        self.encoder = nn.Sequential(  # Eq. 3
            *(block(width, kernel, options) for _ in range(options.blocks))
        )
        between = options.decoder or outputs
        self.decoder = nn.Sequential(  # Eq. 4: a layer over local joints, then over single points
            _convolution(width, between, kernel),
            nn.LeakyReLU(options.slope),
            _convolution(between, outputs),
        )

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3) metres in the body frame."""
        if self.mirrors and not self.training:
            return self.mirror.averaged(self._ahead, window)
        return self._ahead(window)

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """MPJPE of the positions, and of the bones if they have a weight."""
        predicted, weights = self(window), self.step_weights
        losses = {"position": mpjpe(predicted, target, weights)}
        if self.options.bone_weight:
            joint, parent = self.bones
            known = target.observed[:, :, joint] & target.observed[:, :, parent]
            true = target.positions[:, :, joint] - target.positions[:, :, parent]
            bones = predicted[:, :, joint] - predicted[:, :, parent]
            wrong = mpjpe(bones, Target(true, known), weights)
            losses["bones"] = self.options.bone_weight * wrong
        return losses

    def _ahead(self, window: BodyFrames) -> Tensor:
        """The last frame repeated, plus a change."""
        last = last_pose(window)
        observed = window.observed[:, :, self.order].to(last.dtype)
        positions = window.positions[:, :, self.order] * DECIMETRES
        if self.options.relative:
            newest = positions[:, -1:]
            positions = torch.cat([positions[:, :-1] - newest, newest], dim=1)
        if self.options.layout == "trajectory":
            change = self._by_trajectory(positions, observed)
        else:
            change = self._by_pose(positions, observed)
        return last + change[:, :, self.place] / DECIMETRES

    def _by_trajectory(self, positions: Tensor, observed: Tensor) -> Tensor:
        """Map (B, T, J, 3) and (B, T, J) to (B, H, J, 3); frames are channels already."""
        mask = observed[..., None].expand_as(positions)
        return self._convolve(torch.cat([positions, mask], dim=1))

    def _by_pose(self, positions: Tensor, observed: Tensor) -> Tensor:
        """The same with an image of joints by frames (Table VII).

        Such a network outputs as many frames as it reads. A history shorter than the horizon is
        padded with its last frame, and the last H columns are the future.
        """
        image = torch.cat([positions, observed[..., None]], dim=3).permute(0, 3, 2, 1)
        missing = max(0, self.shape.horizon_steps - image.shape[3])
        image = torch.cat([image, image[..., -1:].expand(-1, -1, -1, missing)], dim=3)
        change = self._convolve(image)[..., -self.shape.horizon_steps :]
        return change.permute(0, 3, 2, 1)

    def _convolve(self, image: Tensor) -> Tensor:
        # Channels last is nearly twice as fast on a CPU.
        image = image.contiguous(memory_format=torch.channels_last)
        space = self.trajectory_space(image)
        if self.options.paths == "nested":
            space = functional.leaky_relu(space, self.options.slope)
        decoded: Tensor = self.decoder(self.encoder(space))
        return decoded


class TrajectoryBlock(nn.Module):
    """Five convolutions, each with LeakyReLU and dropout; 1x1 branches join lower to deeper ones.

    The branches carry point-level features past the layers that mix neighbours (Sec. III-C, Dynamic
    local-global features).
    """

    def __init__(self, width: int, kernel: tuple[int, int], options: TrajectoryCNNOptions) -> None:
        super().__init__()
        self.layers = _layers(width, kernel, options)
        self.branches = nn.ModuleList(
            _convolution(width, width) for _ in range((_LAYERS - 1) // 2 if options.residual else 0)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Map (B, C, J, W) to the same shape."""
        first, *deeper = self.layers
        features = first(features)
        for i in range(0, len(deeper), 2):
            lower = features
            features = deeper[i + 1](deeper[i](features))
            if self.branches:
                features = features + self.branches[i // 2](lower)
        return features


class NestedBlock(nn.Module):
    """The same with the three nested branches of the authors' code."""

    def __init__(self, width: int, kernel: tuple[int, int], options: TrajectoryCNNOptions) -> None:
        super().__init__()
        self.layers = _layers(width, kernel, options)
        self.branches = nn.ModuleList(
            nn.Sequential(_convolution(width, width), nn.LeakyReLU(options.slope))
            for _ in range(_LAYERS // 2 + 1 if options.residual else 0)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Map (B, C, J, W) to the same shape."""
        lower = [features]
        for layer in self.layers[:2]:
            lower.append(layer(lower[-1]))
        features = self.layers[2](lower[-1])
        for layer in self.layers[3:]:
            features = layer(self._joined(features, lower))
        return self._joined(features, lower)

    def _joined(self, features: Tensor, lower: list[Tensor]) -> Tensor:
        """Join the newest open branch, so that the innermost joins first."""
        below = lower.pop()
        if not self.branches:
            return features
        joined: Tensor = features + self.branches[len(lower)](below)
        return joined


def _layers(width: int, kernel: tuple[int, int], options: TrajectoryCNNOptions) -> nn.ModuleList:
    return nn.ModuleList(
        nn.Sequential(
            _convolution(width, width, kernel),
            nn.LeakyReLU(options.slope),
            nn.Dropout(options.dropout),
        )
        for _ in range(_LAYERS)
    )


def _convolution(inputs: int, outputs: int, kernel: tuple[int, int] = (1, 1)) -> nn.Conv2d:
    layer = nn.Conv2d(inputs, outputs, kernel, padding="same")
    nn.init.xavier_uniform_(layer.weight)  # the default of TensorFlow, the paper's framework
    assert layer.bias is not None
    nn.init.zeros_(layer.bias)
    return layer


def part_order(skeleton: Skeleton) -> list[int]:
    """Each joint once, sorted by part (Sec. III-C); joints that belong to no part come last."""
    parts = [skeleton.parts.get(name, ()) for name in PART_ORDER]
    parts.append(tuple(range(len(skeleton.joints))))
    return list(dict.fromkeys(joint for part in parts for joint in part))


class TrajectoryCNNPredictor(NeuralPredictor):
    """Convolutions over joints' trajectories (TrajectoryCNN)."""

    method = "trajectorycnn"
    network_class = TrajectoryCNN
