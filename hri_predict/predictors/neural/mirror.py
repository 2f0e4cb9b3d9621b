"""The mirror image of windows and forecasts: left and right exchanged."""

from collections.abc import Callable

import torch
from torch import Tensor, nn

from hri_predict.base.skeleton import Skeleton
from hri_predict.predictors.neural.network import BodyFrames


class Mirror(nn.Module):
    """Exchanges left and right in a frame whose y axis points to the left."""

    order: Tensor

    def __init__(self, skeleton: Skeleton) -> None:
        super().__init__()
        order = list(range(len(skeleton.joints)))
        for left, right in skeleton.left_right_pairs:
            order[left], order[right] = right, left
        self.register_buffer("order", torch.tensor(order), persistent=False)

    def forward(self, positions: Tensor) -> Tensor:
        """Map (..., J, 3) to its mirror image."""
        swapped = positions[..., self.order, :]
        return torch.cat([swapped[..., :1], -swapped[..., 1:2], swapped[..., 2:]], dim=-1)

    def averaged(self, ahead: Callable[[BodyFrames], Tensor], window: BodyFrames) -> Tensor:
        """Average the forecasts (B, H, J, 3) of a body and of its mirror image."""
        positions = torch.cat([window.positions, self(window.positions)])
        observed = torch.cat([window.observed, window.observed[..., self.order]])
        own, other = ahead(BodyFrames(positions, observed)).chunk(2)
        mean: Tensor = 0.5 * (own + self(other))
        return mean
