"""KD-Former: joint rotations and forces, encoded separately, decoded in one pass.

Dai, Li, Zeng, Bai, Zhou, Pan, "KD-Former: Kinematic and dynamic coupled transformer network for 3D
human motion prediction", Pattern Recognition 143, 2023; equation numbers are the paper's.

Where this differs from the paper, and why:

- The newest force uses a backward difference: Eq. 2 would read a future step there. The query and
  the residual's base are the last *observed* pose; the published code gives the decoder the first
  future one.
- ``space: positions`` (a node's sensors give no twist): rotations are computed from positions and
  the rest pose (``rotations``). Forward kinematics with the person's own bone lengths converts
  them back. An extra token holds the root's travel, in metres. The loss adds the position error,
  which evaluations measure: a rotation error near the root moves a whole limb, and Eq. 28 does not
  account for that.
- ``space: rotations`` (the benchmarks): the window holds exponential maps of the 38 joints of CMU,
  or the 32 of Human3.6M; the forces come from its skeleton, which is the same for all people.
- Quaternions q and -q are the same rotation, so Eq. 28 uses the nearer of the two.
- Each step's residual has a learnt gain, initialised in proportion to the step's horizon, so an
  untrained network keeps the next steps near the last pose.
- These layers normalise their input only, so their residual sum is unbounded. It is normalised
  again before the last layer, as is usual today.
- A joint that was not observed is filled in and marked by a learnt token; a step with no observed
  joint is never attended to.
"""

from typing import Literal

import torch
from pydantic import Field, model_validator
from torch import Tensor, nn

from hri_predict.base.errors import PredictorError
from hri_predict.predictors.kdformer.dynamics import Dynamics, PartCount
from hri_predict.predictors.kdformer.rotations import KinematicTree, quaternion, shortest
from hri_predict.predictors.kdformer.transformer import CrossLayer, PositionEmbedding, SelfLayer
from hri_predict.predictors.neural.cmu_skeleton import CMU38, OFFSETS
from hri_predict.predictors.neural.human_skeleton import HUMAN32, OFFSETS_MM
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    NetworkOptions,
    Shape,
    Target,
    mpjpe,
)
from hri_predict.predictors.neural.predictor import NeuralPredictor

METRES_PER_UNIT = 0.0254 / 0.45  # true length of the unit of CMU's skeleton files
_BONES_M = {CMU38.joints: METRES_PER_UNIT * OFFSETS, HUMAN32.joints: OFFSETS_MM / 1000.0}
"""Bone vectors (J, 3) by the joints that windows of rotations hold."""


class KDFormerOptions(NetworkOptions):
    """Sizes and switches; the defaults are the paper's, except where the node needs others.

    Attributes:
        space: content of windows: positions, or exponential maps (CMU's sign, y up).
        width: d, the width of a joint's embedding; a step's embedding has tokens times d.
        layers: L, the number of layers of each transformer.
        feed_forward: width of the feed-forward layers divided by the embedding's; 2 gives the 8.5
            million parameters of the paper's Table 6.
        quaternion_weight: weight of the quaternion loss, added to the position error, metres
            (positions only).
        inputs, decoding, position_embedding, quaternion_loss: Table 3.
        body_parts: Table 4.
        fusion: Table 5; the paper's serial fusion attends to forces, then to rotations.
        true_rate_hz: steps per second for the forces, where the data's rate is nominal.
    """

    space: Literal["positions", "rotations"] = "positions"
    width: int = Field(8, ge=1, le=64)
    layers: int = Field(4, ge=1, le=32)
    heads: int = Field(8, ge=1, le=64)
    feed_forward: int = Field(2, ge=1, le=16)
    dropout: float = Field(0.0, ge=0, lt=1)
    quaternion_weight: float = Field(0.1, ge=0)
    inputs: Literal["kinematic", "dynamic", "both"] = "both"
    decoding: Literal["parallel", "autoregressive"] = "parallel"
    position_embedding: Literal["learnable", "absolute"] = "learnable"
    quaternion_loss: bool = True
    body_parts: PartCount = 5
    fusion: Literal["serial", "parallel", "flat"] = "serial"
    true_rate_hz: float | None = Field(None, gt=0)
    cutoff_hz: float = Field(6.0, gt=0)

    @model_validator(mode="after")
    def _heads_divide(self) -> "KDFormerOptions":
        if self.width % self.heads:
            raise ValueError(f"width {self.width} must be a multiple of heads {self.heads}")
        return self


class Spatial(nn.Module):
    """Embeds each joint of each step and lets the joints of a step attend to each other.

    Eqs. 12, 15, 16; for the query Eqs. 19 to 21 with the same weights.
    """

    def __init__(self, tokens: int, options: KDFormerOptions) -> None:
        super().__init__()
        o = options
        self.embed = nn.Linear(3, o.width)
        self.place = PositionEmbedding(tokens, o.width, o.position_embedding == "learnable")
        self.missing = nn.Parameter(torch.zeros(tokens, o.width))
        self.layers = nn.ModuleList(
            SelfLayer(o.width, o.heads, o.feed_forward, o.dropout) for _ in range(o.layers)
        )

    def forward(self, x: Tensor, missing: Tensor | None) -> Tensor:
        """Embed (B, T, J', 3) as (B, T, J' d); (B, T, J') marks what was not observed."""
        batch, steps = x.shape[:2]
        y = self.place(self.embed(x))
        if missing is not None:
            y = y + missing[..., None] * self.missing
        y = y.flatten(0, 1)
        for layer in self.layers:
            y = layer(y)
        return y.view(batch, steps, -1)


class Temporal(nn.Module):
    """Lets the steps of a history attend to each other: Eqs. 13, 17, 18."""

    def __init__(self, steps: int, width: int, options: KDFormerOptions) -> None:
        super().__init__()
        o = options
        self.place = PositionEmbedding(steps, width, o.position_embedding == "learnable")
        self.layers = nn.ModuleList(
            SelfLayer(width, o.heads, o.feed_forward, o.dropout) for _ in range(o.layers)
        )

    def forward(self, x: Tensor, mask: Tensor | None) -> Tensor:
        """Map (B, T, J' d) to the same shape; ``mask`` (B, T) marks the observed steps."""
        y: Tensor = self.place(x)
        for layer in self.layers:
            y = layer(y, mask)
        return y


class Decoder(nn.Module):
    """Attends from the future steps to the history's features: Eqs. 14, 22 to 25 (and Table 5)."""

    def __init__(self, steps: int, width: int, options: KDFormerOptions) -> None:
        super().__init__()
        o = options
        self.place = PositionEmbedding(steps, width, o.position_embedding == "learnable")
        self.fusion = o.fusion
        self.memories = 2 if o.inputs == "both" else 1
        stages = self.memories if o.fusion == "serial" else 1
        attended = self.memories if o.fusion == "parallel" else 1
        self.stages = nn.ModuleList(
            nn.ModuleList(
                CrossLayer(
                    width=width,
                    heads=o.heads,
                    ratio=o.feed_forward,
                    dropout=o.dropout,
                    memories=attended,
                )
                for _ in range(o.layers)
            )
            for _ in range(stages)
        )
        self.gain = nn.Parameter(torch.arange(1.0, steps + 1) / steps)
        self.norm = nn.LayerNorm(width)
        self.out = nn.Linear(width, width // o.width * 3)
        nn.init.zeros_(self.out.weight)  # an untrained network repeats the last pose
        nn.init.zeros_(self.out.bias)

    def forward(self, y: Tensor, memories: list[Tensor], mask: Tensor | None) -> Tensor:
        """Residuals (B, Q, J', 3), before ``gain``, of placed queries (B, Q, J' d).

        Args:
            y: the queries, with their places already added.
            memories: (B, T, J' d) each; the one of forces comes first.
            mask: (B, T) true for the steps to attend to.
        """
        if self.fusion == "serial":
            rounds = [[memory] for memory in memories]
        elif self.fusion == "parallel":
            rounds = [memories]
        else:
            rounds = [[torch.cat(memories, 1)]]
            mask = None if mask is None else mask.repeat(1, len(memories))
        for layers, attended in zip(self.stages, rounds, strict=True):
            assert isinstance(layers, nn.ModuleList)
            for layer in layers:
                y = layer(y, attended, mask)
        residual: Tensor = self.out(self.norm(y))
        return residual.unflatten(2, (-1, 3))


class KDFormer(Network):
    """The network: reads rotations and forces of a window, predicts in the window's own space."""

    options_model = KDFormerOptions
    exportable = True
    options: KDFormerOptions
    offsets: Tensor

    def __init__(self, shape: Shape, options: KDFormerOptions) -> None:
        super().__init__(shape)
        o = self.options = options
        self.tree = KinematicTree(shape.skeleton)
        positions = o.space == "positions"
        if not positions and shape.skeleton.joints not in _BONES_M:
            raise PredictorError(
                f"kdformer: space 'rotations' works on skeletons {CMU38.name} and {HUMAN32.name}, "
                f"not on {shape.skeleton.name}; use space: positions"
            )
        bones_m = _BONES_M.get(shape.skeleton.joints, _BONES_M[CMU38.joints])
        self.register_buffer("offsets", torch.from_numpy(bones_m).float(), persistent=False)
        tokens = shape.joints + positions  # one more for travel
        width = tokens * o.width
        self.dynamics = Dynamics(
            skeleton=shape.skeleton,
            steps=shape.history_steps,
            rate_hz=o.true_rate_hz or shape.rate_hz,
            parts=o.body_parts,
            up="z" if positions else "y",
            cutoff_hz=o.cutoff_hz,
        )
        self.kinematic_spatial = Spatial(tokens, o)  # the decoder's too, so it is always there
        self.decoder = Decoder(shape.horizon_steps, width, o)
        if o.inputs != "dynamic":
            self.kinematic_temporal = Temporal(shape.history_steps, width, o)
        if o.inputs != "kinematic":
            self.dynamic_spatial = Spatial(tokens, o)
            self.dynamic_temporal = Temporal(shape.history_steps, width, o)

    def forward(self, window: BodyFrames) -> Tensor:
        """Predict (B, H, J, 3): positions in the body frame, metres, or exponential maps."""
        if self.options.space == "rotations":
            return self._predict_rotations(window)
        return self._predict(window)[1]

    def losses(self, window: BodyFrames, target: Target, progress: float) -> dict[str, Tensor]:
        """The quaternion loss (Eq. 28); in position space, the position error is added."""
        if self.options.space == "rotations":
            rotations = self._predict_rotations(window)
            return {"rotation": self._rotation_loss(rotations, target, target.observed)}
        rotations, positions = self._predict(window)
        true = Target(self.tree.rotations(target.positions, self.rest), target.observed)
        known = self.tree.known(target.observed)
        turned = self._rotation_loss(rotations, true, known)
        weighted = self.options.quaternion_weight * turned
        return {"position": mpjpe(positions, target), "rotation": weighted}

    def forward_core(self, rotations: Tensor, forces: Tensor, observed: Tensor) -> Tensor:
        """Future rotations (B, H, J', 3).

        Args:
            rotations: (B, T, J', 3) exponential maps (and travel, metres), continuous in time.
            forces: (B, T, J', 3).
            observed: (B, T, J') which of them were observed.
        """
        missing: Tensor | None = None
        mask: Tensor | None = None
        # Without gaps attention is faster. An exported copy has one path, which serves both.
        if torch.jit.is_tracing() or not bool(observed.all()):
            missing = ~observed
            # the query's own step counts always; attention to nothing is undefined
            mask = torch.cat([observed[:, :-1].any(2), torch.ones_like(observed[:, -1:, 0])], 1)
        memories = []
        if self.options.inputs != "kinematic":
            memories.append(self.dynamic_temporal(self.dynamic_spatial(forces, missing), mask))
        last = rotations[:, -1:]
        if self.options.inputs == "dynamic":
            mark = None if missing is None else missing[:, -1:]
            query = self.kinematic_spatial(last, mark)
        else:
            features = self.kinematic_spatial(rotations, missing)
            memories.append(self.kinematic_temporal(features, mask))
            query = features[:, -1:]  # Eqs. 19 to 21: same weights, same pose, same result
        if self.options.decoding == "autoregressive":
            return self._decode_stepwise(last, query, memories, mask)
        residual = self.decoder(self.decoder.place(query), memories, mask)  # Eq. 14
        return last + self.decoder.gain[:, None, None] * residual  # Eq. 26

    def _decode_stepwise(
        self, pose: Tensor, query: Tensor, memories: list[Tensor], mask: Tensor | None
    ) -> Tensor:
        """Each step's query is the pose predicted before it (Table 3, AR): (B, H, J', 3)."""
        future: list[Tensor] = []
        for place, gain in zip(self.decoder.place.table, self.decoder.gain, strict=True):
            if future:
                query = self.kinematic_spatial(pose, None)
            pose = pose + gain * self.decoder(query + place, memories, mask)
            future.append(pose)
        return torch.cat(future, 1)

    def _predict(self, window: BodyFrames) -> tuple[Tensor, Tensor]:
        """Future rotations (B, H, J, 3) and positions (B, H, J, 3) of a window of positions."""
        tree, root = self.tree, self.tree.root
        with torch.no_grad():
            rotations = tree.rotations(window.positions, self.rest)
            lengths = tree.lengths(window.positions, window.observed)
            here = window.positions[:, :, root]
            travel = here - here[:, -1:]
            forces = self.dynamics(window.positions, lengths)
            forces = torch.cat([forces, self.dynamics.of_root(here)[:, :, None]], 2)
        observed = torch.cat([window.observed, window.observed[:, :, [root]]], 2)
        future = self.forward_core(torch.cat([rotations, travel[:, :, None]], 2), forces, observed)
        turned, moved = future[:, :, :-1], future[:, :, -1]
        return turned, tree.positions(turned, self.rest, lengths, here[:, -1:] + moved)

    def _predict_rotations(self, window: BodyFrames) -> Tensor:
        """Future exponential maps (B, H, J, 3) of a window of them."""
        with torch.no_grad():
            rotations = shortest(window.positions)
            # the benchmarks' files hold minus the rotation vector
            positions = self.tree.offsets_positions(-rotations, self.offsets)
            lengths = self.offsets.norm(dim=1).expand(rotations.shape[0], -1)
            forces = self.dynamics(positions, lengths)
        return self.forward_core(rotations, forces, window.observed)

    def _rotation_loss(self, predicted: Tensor, true: Target, known: Tensor) -> Tensor:
        """Eq. 28 over the known joints: L1 between quaternions (exponential maps without QT)."""
        if self.options.quaternion_loss:
            q, r = quaternion(predicted), quaternion(true.positions)
            r = torch.where((q * r).sum(-1, keepdim=True) < 0, -r, r)
            error = (q - r).abs().sum(-1)
        else:
            error = (predicted - true.positions).abs().sum(-1)
        return (error * known).sum() / known.sum().clamp(min=1)


class KDFormerPredictor(NeuralPredictor):
    """A transformer over joints' rotations and forces (KD-Former)."""

    method = "kdformer"
    network_class = KDFormer
