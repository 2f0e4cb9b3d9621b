"""Starting point of a forecast: a pose and a velocity filtered from the last frames, and a gate.

This is not in the paper, whose first momentum is the difference of the last two frames: noise of 2
cm on each is an error of 0.7 m/s at 25 frames a second, carried on through the whole forecast.

One small network, shared by all joints, reads how a joint moved over its last frames and gives the
filters' weights: a clean joint is taken as it is, a noisy one is smoothed. Its inputs do not depend
on axes or body: lengths of velocities, angles between them, and the joint's index.
"""

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from hri_predict.predictors.neural.network import BodyFrames

_REST_SPEED = 0.05  # m/s; as in ``symplectic``
_GATED_STEPS = 25.0  # the far gate holds from here on
_OPEN = 4.0  # an untrained gate lets 98 % of the change through


@dataclass(frozen=True, slots=True)
class Started:
    """Start of a forecast.

    Attributes:
        last: (B, 1, J, 3) m, the last pose.
        velocity: (B, 1, J, 3) m/s.
        gate: (B, J, 2) the gate's logits, or ``None``.
        known: (B, J, hidden) features of how each joint moved.
    """

    last: Tensor
    velocity: Tensor
    gate: Tensor | None
    known: Tensor


class Start(nn.Module):
    """Filters the start of a forecast from the last ``frames`` frames of a window.

    Args:
        joints: J.
        frames: frames that are read; the untrained velocity is their least-squares slope.
        hidden: units of the network's two layers.
        gate: also give a gate (``gated``).
    """

    slope: Tensor

    def __init__(self, joints: int, frames: int, hidden: int, gate: bool) -> None:
        super().__init__()
        self.velocities = frames - 1
        pairs = self.velocities * (self.velocities + 1) // 2
        self.joint = nn.Parameter(torch.zeros(joints, hidden))
        self.first = nn.Linear(pairs + self.velocities + 2, hidden)
        self.second = nn.Linear(hidden, hidden)
        self.head = nn.Linear(hidden, 2 * self.velocities + 2 * gate)
        nn.init.zeros_(self.head.weight)
        nn.init.zeros_(self.head.bias)
        if gate:
            with torch.no_grad():
                self.head.bias[-2:] = _OPEN
        self.gate = gate
        self.register_buffer("slope", least_squares_slope(frames), persistent=False)

    def forward(self, window: BodyFrames, rate_hz: float) -> Started:
        """Filter the end of a window."""
        velocities, known = self._known(window, rate_hz)
        weights = self.head(known)
        count = self.velocities
        back = torch.einsum("bjk,bkjc->bjc", weights[..., :count], velocities) / rate_hz
        ahead = torch.einsum(
            "bjk,bkjc->bjc", self.slope + weights[..., count : 2 * count], velocities
        )
        last = window.positions[:, -1:] + back[:, None]
        return Started(last, ahead[:, None], weights[..., -2:] if self.gate else None, known)

    def _known(self, window: BodyFrames, rate_hz: float) -> tuple[Tensor, Tensor]:
        """The last velocities (B, K, J, 3), oldest first, and features (B, J, hidden)."""
        count = self.velocities
        recent = window.positions[:, -count - 1 :]
        v = (recent[:, 1:] - recent[:, :-1]) * rate_hz
        both = (window.observed[:, -count:] & window.observed[:, -count - 1 : -1]).to(v.dtype)
        by_joint = v.transpose(1, 2)  # (B, J, K, 3)
        size = by_joint.square().sum((-1, -2)) / count + _REST_SPEED**2
        gram = by_joint @ by_joint.transpose(-1, -2) / size[..., None, None]
        row, column = torch.triu_indices(count, count)
        whole = size.mean(1, keepdim=True).expand_as(size)  # is anybody moving at all
        features = torch.cat(
            [
                gram[..., row, column],
                both.transpose(1, 2),
                size.log()[..., None],
                whole.log()[..., None],
            ],
            -1,
        )
        hidden = F.gelu(self.first(features) + self.joint)
        return v, F.gelu(self.second(hidden))


def gated(last: Tensor, positions: Tensor, logits: Tensor) -> Tensor:
    """Last pose + gate x change (B, H, J, 3): a person who moves to and fro stays in place.

    The gate's logit moves from the first of two (B, J, 2) at the first step to the second at step
    25 and later.
    """
    steps = torch.arange(1, positions.shape[1] + 1).to(positions) / _GATED_STEPS
    far = steps.clamp(max=1.0)[None, :, None]
    near_logit, far_logit = logits[:, None, :, 0], logits[:, None, :, 1]
    gate = torch.sigmoid(near_logit + far * (far_logit - near_logit))
    return last + gate[..., None] * (positions - last)


def least_squares_slope(frames: int) -> Tensor:
    """(frames - 1,) weights of velocities, oldest first, that give the slope of a fitted line.

    They add up to 1: w_i = 6 i (n - i) / (n (n^2 - 1)) for the i-th of n - 1 differences.
    """
    i = torch.arange(1, frames, dtype=torch.float64)
    return (6 * i * (frames - i) / (frames * (frames**2 - 1))).float()
