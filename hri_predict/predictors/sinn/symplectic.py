"""The parts of SINN: momentum by direction, the recurrent operator, and the critic.

Section and equation numbers refer to Chen et al., CVPR 2024; see ``sinn``.
"""

import math
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from hri_predict.predictors.neural.network import BodyFrames

REST_SPEED = 0.05  # m/s; the momentum of a joint at rest; about the size of sensor noise
Kind = Literal["symplectic", "displacement", "position"]
Splitting = Literal["direction", "joint", "none"]
Pose = Literal["none", "direction", "all"]


def momentum(velocity: Tensor) -> Tensor:
    """Momentum of velocities (..., 3) m/s by direction (Eqs. 2-4): (..., 3, 2).

    The first channel is the magnitude M, m/s, the same in all directions. The second is the angle
    D_i between the velocity and the hyperplane perpendicular to direction i, rad, so M sin(D_i) is
    the velocity's coordinate i. M is sqrt(|v|^2 + e^2): angles fade to 0 at rest, all is smooth.
    """
    square = velocity.square()
    whole = square.sum(-1, keepdim=True) + REST_SPEED**2
    across = (whole - square).clamp(min=REST_SPEED**2).sqrt()
    return torch.stack([whole.sqrt().expand_as(velocity), torch.atan2(velocity, across)], -1)


def velocity(zeta: Tensor) -> Tensor:
    """Velocities (..., 3) m/s of a momentum (..., 3, 2), its magnitudes averaged (Eq. 5)."""
    return zeta[..., 0].mean(-1, keepdim=True) * zeta[..., 1].sin()


def differences(positions: Tensor) -> Tensor:
    """Backward differences (B, T, J, 3) of positions; zero at the first step."""
    return F.pad(positions[:, 1:] - positions[:, :-1], (0, 0, 0, 0, 1, 0))


class Representation(nn.Module):
    """The C channels that the operator reads and predicts for each joint and direction.

    ``symplectic``: momentum; C = 2. Without it (Table 4): ``displacement``, velocities in m/s, or
    ``position``, relative to the window's last, dm; C = 1.
    """

    def __init__(self, kind: Kind, rate_hz: float) -> None:
        super().__init__()
        self.kind = kind
        self.rate_hz = rate_hz
        self.channels = 2 if kind == "symplectic" else 1

    def read(self, window: BodyFrames) -> Tensor:
        """(B, T, J, 3, C) of a window."""
        if self.kind == "position":
            return (window.positions - window.positions[:, -1:])[..., None] * 10.0
        return self.of_velocity(differences(window.positions) * self.rate_hz)

    def truth(self, last: Tensor, positions: Tensor) -> Tensor:
        """(B, H, J, 3, C) of the steps that follow ``last`` (B, 1, J, 3)."""
        if self.kind == "position":
            return (positions - last)[..., None] * 10.0
        return self.of_velocity(torch.cat([last, positions], 1).diff(dim=1) * self.rate_hz)

    def integrate(self, last: Tensor, zeta: Tensor) -> Tensor:
        """Rec: positions (B, t, J, 3) that follow ``last`` (B, 1, J, 3)."""
        if self.kind == "position":
            return last + zeta[..., 0] / 10.0
        v = velocity(zeta) if self.kind == "symplectic" else zeta[..., 0]
        return last + v.cumsum(1) / self.rate_hz

    def tuples(self, zeta: Tensor) -> Tensor:
        """(B, H, J, 4) magnitude and three angles (Eq. 2); (B, H, J, 3) without momentum."""
        if self.kind == "symplectic":
            return torch.cat([zeta[..., 0].mean(-1, keepdim=True), zeta[..., 1]], -1)
        return zeta[..., 0]

    def of_velocity(self, v: Tensor) -> Tensor:
        """(..., 3, C) of velocities (..., 3) m/s, unless the kind is ``position``."""
        return momentum(v) if self.kind == "symplectic" else v[..., None]


class Operator(nn.Module):
    """The symplectic operator: GRUs that read a window and predict its next t steps at once.

    Args:
        joints: J.
        steps: t.
        channels: C, the channels of each joint and direction.
        hidden: units of each GRU.
        splitting: ``direction``: a GRU per direction reads its channels of all joints (Eq. 3);
            ``joint``: the same for one joint at a time; ``none``: one GRU reads everything.
        shared: use one GRU for all directions.
        pose: coordinates relative to the root that each GRU also receives: along its own
            ``direction``, along ``all`` three, or ``none``.
    """

    def __init__(
        self,
        *,
        joints: int,
        steps: int,
        channels: int,
        hidden: int,
        splitting: Splitting,
        shared: bool,
        pose: Pose,
    ) -> None:
        super().__init__()
        self.steps, self.joints, self.channels = steps, joints, channels
        self.splitting, self.pose = splitting, pose
        self.directions = 3 if splitting != "none" else 1
        per_joint = 1 + (3 // self.directions) * channels  # the mask, and the predicted channels
        if pose == "all" or (pose == "direction" and splitting == "none"):
            per_joint += 3
        elif pose == "direction":
            per_joint += 1
        together = 1 if splitting == "joint" else joints
        outputs = steps * together * (3 // self.directions) * channels
        models = 1 if shared else self.directions
        inputs = together * per_joint + (self.directions if models < self.directions else 0)
        self.grus = nn.ModuleList(nn.GRU(inputs, hidden) for _ in range(models))
        self.heads = nn.ModuleList(nn.Linear(hidden, outputs) for _ in range(models))
        for parameter in self.heads.parameters():
            nn.init.zeros_(parameter)  # an untrained operator continues the last momentum
        self.carry = nn.Parameter(torch.ones(steps, 1, 1, channels))

    def forward(
        self, zeta: Tensor, observed: Tensor, pose: Tensor, first: Tensor | None = None
    ) -> Tensor:
        """Predict (B, t, J, 3, C) from (B, T, J, 3, C), (B, T, J) and poses (B, T, J, 3), m.

        It continues from ``first`` (B, 1, J, 3, C), if given, instead of the last of ``zeta``.
        """
        both = observed & F.pad(observed[:, :-1], (0, 0, 1, 0))
        mask = both.to(zeta.dtype)[..., None]
        sequences = [self._sequence(zeta, mask, pose, i) for i in range(self.directions)]
        if len(self.grus) < self.directions:
            sequences = [torch.cat(sequences, 1)]  # all directions in one batch
        outputs = torch.cat(
            [
                head(gru(sequence)[1][0])
                for gru, head, sequence in zip(self.grus, self.heads, sequences, strict=True)
            ]
        )
        batch, width = zeta.shape[0], 3 // self.directions
        if self.splitting == "joint":
            change = outputs.view(3, batch, self.joints, self.steps, self.channels)
            change = change.permute(1, 3, 2, 0, 4)
        else:
            change = outputs.view(
                self.directions, batch, self.steps, self.joints, width, self.channels
            )
            change = change.permute(1, 2, 3, 0, 4, 5).flatten(3, 4)
        return (zeta[:, -1:] if first is None else first) * self.carry + change

    def _sequence(self, zeta: Tensor, mask: Tensor, pose: Tensor, direction: int) -> Tensor:
        """The input of a direction's GRU: (T, B or B*J, features)."""
        own = slice(None) if self.directions == 1 else slice(direction, direction + 1)
        parts = [zeta[:, :, :, own].flatten(3), mask]
        if self.pose != "none":
            parts.append(pose if self.pose == "all" else pose[..., own])
        features = torch.cat(parts, -1).transpose(0, 1)  # (T, B, J, per joint)
        sequence = features.flatten(1, 2) if self.splitting == "joint" else features.flatten(2)
        if len(self.grus) < self.directions:  # label the direction: up differs from ahead
            which = F.one_hot(torch.tensor(direction), self.directions).to(sequence)
            sequence = torch.cat([sequence, which.expand(*sequence.shape[:2], -1)], -1)
        return sequence


class Critic(nn.Module):
    """Three fully connected layers that score a motion; kept Lipschitz by a gradient penalty."""

    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.inputs = inputs
        self.first = nn.Linear(inputs, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.third = nn.Linear(hidden, 1)

    def forward(self, motion: Tensor, frozen: bool = False) -> Tensor:
        """Score (B,) of motions (B, inputs); ``frozen`` blocks gradients to the critic."""
        value = motion / math.sqrt(self.inputs)
        for layer in (self.first, self.second, self.third):
            if layer is not self.first:
                value = F.leaky_relu(value, 0.2)
            value = (
                F.linear(value, layer.weight.detach(), layer.bias.detach())
                if frozen
                else layer(value)
            )
        return value[:, 0]

    def loss(self, real: Tensor, generated: Tensor, penalty: float, mix: float) -> Tensor:
        """Return L_c (Eq. 12) plus the gradient penalty between the two kinds of motion.

        Args:
            real: (B, inputs) from recordings.
            generated: (B, inputs) from the operator.
            penalty: weight of the gradient penalty.
            mix: position between the two, 0 to 1.
        """
        between = (mix * real + (1 - mix) * generated).detach().requires_grad_()
        slope = torch.autograd.grad(self(between).sum(), between, create_graph=True)[0]
        slope = slope.norm(dim=1) * math.sqrt(self.inputs)
        gap = self(real).mean() - self(generated).mean()
        return gap + penalty * (slope - 1).square().mean()


def momentum_error(predicted: Tensor, truth: Tensor, known: Tensor, squared: bool) -> Tensor:
    """Mean over known joints of the (squared) length of the error over a joint's channels.

    Args:
        predicted: (B, H, J, 3, C).
        truth: the same.
        known: (B, H, J) bool.
        squared: square the length as in Eq. 11, not as in Eq. 10.
    """
    error = (predicted - truth).square().flatten(3).mean(-1)
    if not squared:
        error = error.add(1e-12).sqrt()
    return (error * known).sum() / known.sum().clamp(min=1)
