"""Short predictions chained to long ones, around any network."""

import pytest
import torch
from torch import Tensor, nn

from hri_predict.predictors.aggregation import Aggregated, aggregate, forget
from hri_predict.predictors.body import BODY
from hri_predict.predictors.network import (
    Network,
    NetworkOptions,
    Shape,
    Target,
    Window,
    last_pose,
    mpjpe,
)


class GoesOn(Network):
    """Repeats the mean displacement over its whole window, times a learnt factor."""

    def __init__(self, shape: Shape) -> None:
        super().__init__(shape)
        self.options = NetworkOptions()
        self.factor = nn.Parameter(torch.tensor(0.5))

    def forward(self, window: Window) -> Tensor:
        mean = window.positions.diff(dim=1).mean(1, keepdim=True)
        count = torch.arange(1, self.shape.horizon_steps + 1).view(1, -1, 1, 1)
        return last_pose(window) + self.factor * count * mean


def window(steps: int = 6, batch: int = 2, seed: int = 0) -> Window:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.randn(batch, steps, 28, 3, generator=generator)
    return Window(positions, torch.rand(batch, steps, 28, generator=generator) < 0.7)


def test_forget_unit_drops_the_oldest_and_appends_what_was_predicted():
    before = window(steps=6)
    predicted = torch.randn(2, 2, 28, 3)
    after = forget(before, predicted)
    torch.testing.assert_close(after.positions[:, :4], before.positions[:, 2:], rtol=0, atol=0)
    torch.testing.assert_close(after.positions[:, 4:], predicted, rtol=0, atol=0)
    assert (after.observed[:, :4] == before.observed[:, 2:]).all()
    assert after.observed[:, 4:].all()


def test_forget_unit_keeps_the_window_length_if_more_is_predicted_than_it_holds():
    predicted = torch.randn(2, 9, 28, 3)
    after = forget(window(steps=6), predicted)
    torch.testing.assert_close(after.positions, predicted[:, 3:], rtol=0, atol=0)


def test_equals_applying_the_network_by_hand_and_cuts_at_the_horizon():
    inner = GoesOn(Shape(BODY, 6, 2, 25.0))
    whole = Aggregated(inner, 5)
    first = window()
    with torch.no_grad():
        one = inner(first)
        two = inner(forget(first, one))
        three = inner(forget(forget(first, one), two))
        predicted = whole(first)
    assert whole.shape.horizon_steps == 5
    expected = torch.cat([one, two, three], 1)[:, :5]
    torch.testing.assert_close(predicted, expected, rtol=0, atol=0)


def test_operator_is_applied_no_more_often_than_needed():
    calls = []

    def stay(current: Window) -> Tensor:
        calls.append(current)
        return last_pose(current).expand(-1, 5, -1, -1)

    assert aggregate(stay, window(), 10).shape == (2, 10, 28, 3)
    assert len(calls) == 2


@pytest.mark.parametrize("progress", [0.1, 0.9])
def test_learns_its_own_horizon_first_and_then_the_whole(progress):
    inner = GoesOn(Shape(BODY, 6, 2, 25.0))
    whole = Aggregated(inner, 4, pretraining=0.5)
    past = window()
    target = Target(torch.randn(2, 4, 28, 3), torch.rand(2, 4, 28) < 0.8)
    near = Target(target.positions[:, :2], target.observed[:, :2])
    expected = mpjpe(inner(past), near) if progress < 0.5 else mpjpe(whole(past), target)
    loss = whole.loss(past, target, progress)
    torch.testing.assert_close(loss, expected)
    loss.backward()
    assert inner.factor.grad is not None
    assert inner.factor.grad.abs() > 0


def test_rest_pose_of_the_whole_is_that_of_the_network_within():
    inner = GoesOn(Shape(BODY, 6, 2, 25.0))
    whole = Aggregated(inner, 4)
    whole.rest.copy_(torch.randn(28, 3))
    torch.testing.assert_close(inner.rest, whole.rest, rtol=0, atol=0)
    other = Aggregated(GoesOn(Shape(BODY, 6, 2, 25.0)), 8)  # a longer horizon, the same weights
    other.load_state_dict(whole.state_dict())
    torch.testing.assert_close(other.inner.rest, whole.rest, rtol=0, atol=0)
