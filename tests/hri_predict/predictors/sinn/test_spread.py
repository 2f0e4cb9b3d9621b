"""The spread that a distilled network foresees: from each joint's motion, and for nothing else."""

import pytest
import torch

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target
from hri_predict.predictors.sinn.model import SINN, SINNOptions

SHAPE = Shape(skeleton=BODY, history_steps=12, horizon_steps=10, rate_hz=25.0)
OPTIONS = {"hidden": 16, "critic_steps": 10, "start_frames": 7, "gate": True, "spread": True}


def network(**options):
    torch.manual_seed(0)
    return SINN(SHAPE, SINNOptions.model_validate(OPTIONS | {"pretraining": 0} | options))


def walk(people=3):
    positions = torch.randn(people, 22, 28, 3, generator=torch.Generator().manual_seed(3))
    positions = positions.mul(0.02).cumsum(1)
    window = BodyFrames(positions[:, :12], torch.ones(people, 12, 28, dtype=torch.bool))
    return window, positions[:, 12:]


def learn_spread(told, window, target):
    assert told.spread is not None
    learner = torch.optim.Adam(told.spread.parameters(), lr=0.02)
    for _ in range(300):
        learner.zero_grad()
        told.losses(window, target, 0.5)["spread"].backward()
        learner.step()


def test_it_is_a_fourth_number_and_the_positions_stay():
    window, _ = walk()
    plain = network(spread=False)
    told = network()
    told.load_state_dict(plain.state_dict(), strict=False)
    with torch.inference_mode():
        assert told(window).shape == (3, 10, 28, 4)
        assert torch.equal(told(window)[..., :3], plain(window))


def test_it_learns_the_teachers_spread_and_changes_no_position():
    window, future = walk()
    spread = torch.full((3, 10, 28), 0.02)
    spread[2] = torch.nan  # not taught
    target = Target(future, torch.ones_like(spread, dtype=torch.bool), spread=spread)
    told = network()
    before = told(window)[..., :3].detach()
    told.losses(window, target, 0.5)["spread"].backward()
    untouched = [p for n, p in told.named_parameters() if not n.startswith("spread.")]
    assert all(p.grad is None or not p.grad.any() for p in untouched)
    learn_spread(told, window, target)
    stated = told(window).detach()
    assert torch.equal(stated[..., :3], before)
    assert float(stated[:2, ..., 3].detach().exp().mean()) == pytest.approx(0.02, rel=0.1)


def test_without_teachers_it_learns_how_wrong_it_is():
    window, future = walk()
    target = Target(future, torch.ones(3, 10, 28, dtype=torch.bool))
    told = network()
    learn_spread(told, window, target)
    stated = told(window)
    error = (stated[..., :3] - future).square().mean(-1).sqrt().mean()
    found = float(stated[..., 3].detach().exp().mean())
    assert found == pytest.approx(float(error.detach()), rel=0.2)


@pytest.mark.parametrize("momentum", [0.0, 0.2])
def test_the_shorter_way_to_the_error_trains_alike(momentum):
    """Without a loss on momenta the readings are side by side; gradients are the same."""
    window, future = walk()
    target = Target(future, torch.ones(3, 10, 28, dtype=torch.bool))
    told = network(momentum_weight=momentum, adversarial_weight=0).double()
    window = BodyFrames(window.positions.double(), window.observed)
    target = Target(target.positions.double(), target.observed)
    error = told.losses(window, target, 0.5)["position"]
    error.backward()
    found = {n: p.grad.clone() for n, p in told.named_parameters() if p.grad is not None}
    told.zero_grad()
    plain = (told(window)[..., :3] - target.positions).square().sum(-1).add(1e-12).sqrt().mean()
    plain.backward()
    assert float(error.detach()) == pytest.approx(float(plain.detach()), abs=1e-9)
    for name, parameter in told.named_parameters():
        if parameter.grad is not None and parameter.grad.any():
            torch.testing.assert_close(found[name], parameter.grad, rtol=1e-6, atol=1e-9)
