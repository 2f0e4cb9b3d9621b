"""The losses that every network has."""

import pytest
import torch
from torch import nn

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import (
    BodyFrames,
    Network,
    Shape,
    Target,
    deviation_loss,
    last_pose,
    mpjpe,
)

SHAPE = Shape(skeleton=BODY, history_steps=4, horizon_steps=3, rate_hz=25.0)


class Unsure(Network):
    """Nothing moves; a learnt offset, and a learnt deviation of each joint."""

    def __init__(self):
        super().__init__(SHAPE)
        self.offset = nn.Parameter(torch.zeros(3))
        self.deviation = nn.Parameter(torch.zeros(28, 1))

    def forward(self, window):
        ahead = (last_pose(window) + self.offset).expand(-1, 3, -1, -1)
        return torch.cat([ahead, self.deviation.expand(len(ahead), 3, 28, 1)], -1)


def futures(people=400):
    """Joint j is off by (j + 1) cm per axis; half of the future is known."""
    generator = torch.Generator().manual_seed(0)
    off = 0.01 * torch.arange(1.0, 29.0)[:, None]
    future = off * torch.randn(people, 3, 28, 3, generator=generator)
    known = torch.rand(people, 3, 28, generator=generator) < 0.5
    future[~known] = 9.0
    window = BodyFrames(torch.zeros(people, 4, 28, 3), torch.ones(people, 4, 28).bool())
    return window, Target(future, known)


def test_the_likelihood_is_that_of_a_normal_distribution():
    window, target = futures()
    network = Unsure()
    with torch.no_grad():
        network.deviation.uniform_(-4.0, -1.0)
        predicted = network(window)
    normal = torch.distributions.Normal(predicted[..., :3], predicted[..., 3:].exp())
    exact = -normal.log_prob(target.positions).sum(-1)[target.observed].mean()
    constant = 1.5 * torch.log(torch.tensor(2 * torch.pi))
    assert float(deviation_loss(predicted, target) + constant) == pytest.approx(
        float(exact), rel=1e-4
    )


def test_a_stated_deviation_is_learnt_and_leaves_the_positions_alone():
    window, target = futures()
    network = Unsure()
    losses = network.losses(window, target, 0.0)
    assert list(losses) == ["position", "deviation"]
    assert losses["position"] == mpjpe(network(window)[..., :3], target)
    losses["deviation"].backward()
    assert network.offset.grad is None or not network.offset.grad.any()
    adam = torch.optim.Adam([network.deviation], lr=0.05)
    for _ in range(200):
        adam.zero_grad()
        network.losses(window, target, 0.0)["deviation"].backward()
        adam.step()
    # 1800 known numbers per joint: a standard error of 1.7 %
    learnt = network.deviation.detach().exp()[:, 0]
    torch.testing.assert_close(learnt, 0.01 * torch.arange(1.0, 29.0), rtol=0.08, atol=0)
