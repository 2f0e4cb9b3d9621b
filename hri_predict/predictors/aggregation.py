"""Long predictions from short ones: temporal aggregation with a forget unit.

Chen et al., "Rethinking Human Motion Prediction with Symplectic Integral", CVPR 2024, section 3.2.
A network that predicts t steps is applied again and again with the same weights until the whole
horizon is covered (Eqs. 8-9); before each time a forget unit drops the t oldest steps of its window
and appends the t just predicted. It asks nothing of the network (its Table 5 wraps six others).

The window is read anew each time. A recurrent network could go on from its last state at a fifth of
the cost, but would then remember steps that the forget unit drops.
"""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from hri_predict.predictors.network import Network, Target, Window, mpjpe


def forget(window: Window, predicted: Tensor) -> Window:
    """Drop as many of the oldest steps as were ``predicted`` (B, t, J, 3), and append those.

    Predicted joints count as observed: nothing better will be known of them.
    """
    steps = window.positions.shape[1]
    seen = window.observed.new_ones(predicted.shape[:3])
    return Window(
        torch.cat([window.positions, predicted], 1)[:, -steps:],
        torch.cat([window.observed, seen], 1)[:, -steps:],
    )


def aggregate(operator: Callable[[Window], Tensor], window: Window, horizon_steps: int) -> Tensor:
    """Apply ``operator``, a window to (B, t, J, 3), until (B, horizon_steps, J, 3) are predicted.

    The horizon needs not be a multiple of t; of the last application only the start is used then.
    """
    parts: list[Tensor] = []
    done = 0
    while done < horizon_steps:  # Eq. 8: one sub-interval after the other
        if parts:
            window = forget(window, parts[-1])
        parts.append(operator(window))
        done += parts[-1].shape[1]
    return torch.cat(parts, 1)[:, :horizon_steps]  # Eq. 9


class Aggregated(Network):
    """Any network with a short horizon, made to predict a longer one.

    Its loss has two stages: at first ``inner`` learns its own horizon with its own loss, then both
    learn the position error over the whole horizon. Unobserved joints are handled as by ``inner``.

    Args:
        inner: predicts ``inner.shape.horizon_steps`` steps.
        horizon_steps: of the whole, at least as many as ``inner`` has.
        pretraining: share of the training in the first stage.
    """

    def __init__(self, inner: Network, horizon_steps: int, pretraining: float = 0.5) -> None:
        super().__init__(replace(inner.shape, horizon_steps=horizon_steps))
        self.inner = inner
        self.options = inner.options
        self.rest = inner.rest  # one tensor: set or loaded for the whole, it is the inner one's
        self.pretraining = pretraining

    def forward(self, window: Window) -> Tensor:
        """Predict (B, H, J, 3) in the body frame."""
        return aggregate(self.inner, window, self.shape.horizon_steps)

    def loss(self, window: Window, target: Target, progress: float) -> Tensor:
        """Return the loss of ``inner`` on its own horizon, later the error over the whole one."""
        if progress < self.pretraining:
            steps = self.inner.shape.horizon_steps
            near = Target(target.positions[:, :steps], target.observed[:, :steps])
            return self.inner.loss(window, near, progress / self.pretraining)
        return mpjpe(self(window), target)
