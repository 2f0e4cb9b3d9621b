"""SINN: momentum, its operator, the stages of its training, its switches."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Network, Shape, Target
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.predictors.neural.weights import save_weights
from hri_predict.predictors.sinn.model import SINN, SINNOptions, SINNPredictor
from hri_predict.predictors.sinn.symplectic import Critic, momentum, momentum_error, velocity

SHAPE = Shape(skeleton=BODY, history_steps=12, horizon_steps=10, rate_hz=25.0)


def small(shape: Shape = SHAPE, **options: object) -> SINN:
    torch.manual_seed(0)
    return SINN(shape, SINNOptions.model_validate({"hidden": 16, "critic_steps": 10} | options))


def stirred(network: SINN) -> SINN:
    """Give the heads, which start at zero, some weight."""
    torch.manual_seed(1)
    for parameter in network.operator.heads.parameters():
        torch.nn.init.normal_(parameter, std=0.05)
    return network


def motion(batch: int = 3, seen: float = 0.8) -> tuple[BodyFrames, Target]:
    generator = torch.Generator().manual_seed(3)
    walk = torch.randn(batch, 22, 28, 3, generator=generator).cumsum(1) * 0.02
    observed = torch.rand(batch, 22, 28, generator=generator) < seen
    return BodyFrames(walk[:, :12], observed[:, :12]), Target(walk[:, 12:], observed[:, 12:])


metres_per_second = st.floats(-20, 20, allow_nan=False, width=32)


@given(st.tuples(*[metres_per_second] * 3))
def test_magnitude_times_sine_is_the_velocity(v):
    given_v = torch.tensor(v, dtype=torch.float64)
    torch.testing.assert_close(velocity(momentum(given_v)), given_v, rtol=1e-12, atol=1e-15)
    single = velocity(momentum(given_v.float()))
    torch.testing.assert_close(
        single, given_v.float(), rtol=1e-5, atol=1e-6 * (1 + max(map(abs, v)))
    )


def test_angles_fade_to_zero_at_rest_and_are_right_at_speed():
    assert (momentum(torch.zeros(3))[..., 1] == 0).all()
    tiny = momentum(torch.tensor([1e-5, 0.0, 0.0]))[0, 1]
    assert 0 < tiny < 1e-3
    fast = momentum(torch.tensor([3.0, 4.0, 0.0]))
    torch.testing.assert_close(fast[:, 0], torch.full((3,), 5.0), rtol=1e-3, atol=0)
    expected = torch.tensor([0.6, 0.8, 0.0]).asin()
    torch.testing.assert_close(fast[:, 1], expected, rtol=1e-3, atol=1e-6)


def test_momentum_has_a_finite_gradient_everywhere():
    for v in ([0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [1e-9, -5.0, 0.0]):
        at = torch.tensor(v, requires_grad=True)
        momentum(at).sum().backward()
        assert at.grad is not None
        assert at.grad.isfinite().all()


def test_three_magnitudes_are_averaged():
    zeta = torch.tensor([[1.0, 0.3], [2.0, 0.0], [6.0, -0.2]])
    expected = 3.0 * torch.tensor([0.3, 0.0, -0.2]).sin()
    torch.testing.assert_close(velocity(zeta), expected)


@pytest.mark.parametrize("kind", ["symplectic", "displacement", "position"])
def test_what_is_read_of_a_motion_integrates_back_to_it(kind):
    network = small(representation=kind)
    _, target = motion()
    last, ahead = target.positions[:, :1], target.positions[:, 1:]
    again = network.representation.integrate(last, network.representation.truth(last, ahead))
    torch.testing.assert_close(again, ahead, rtol=1e-5, atol=1e-5)


def test_untrained_it_keeps_the_last_velocity():
    start, step = torch.randn(2, 1, 28, 3), torch.randn(2, 1, 28, 3) * 0.03
    line = start + step * torch.arange(22).view(1, -1, 1, 1)
    window = BodyFrames(line[:, :12], torch.ones(2, 12, 28, dtype=torch.bool))
    torch.testing.assert_close(small()(window), line[:, 12:], rtol=0, atol=1e-4)


def test_moves_with_the_person():
    network = stirred(small())
    window, _ = motion()
    away = torch.tensor([3.0, -2.0, 0.5])
    moved = BodyFrames(window.positions + away, window.observed)
    torch.testing.assert_close(network(moved), network(window) + away, rtol=0, atol=1e-4)


def test_directions_are_told_apart():
    network = stirred(small(pose="none"))
    window, _ = motion(seen=1.1)
    turned = BodyFrames(window.positions.roll(1, -1), window.observed)
    assert not torch.allclose(network(turned), network(window).roll(1, -1), atol=1e-4)


def test_the_mask_is_read():
    network = stirred(small())
    window, _ = motion(seen=1.1)
    hidden = BodyFrames(window.positions, window.observed.clone())
    hidden.observed[:, -3:, 5] = False
    assert not torch.equal(network(hidden), network(window))


@pytest.mark.parametrize(("horizon_s", "steps"), [(2.0, 10), (0.2, 5)])
def test_without_aggregation_the_node_has_the_horizon_of_the_weights(
    tmp_path, caplog, horizon_s, steps
):
    path = tmp_path / "sinn.safetensors"
    save_weights(path, "sinn", small(aggregation=False), {})
    asked = NeuralSettings(name="sinn", weights=str(path), horizon_s=horizon_s)
    assert SINNPredictor(asked).horizon_steps == steps
    assert ("its weights reach 0.4 s" in caplog.text) == (steps == 10)


def test_runs_to_two_seconds_by_the_same_weights():
    network = stirred(small())
    longer = small(Shape(skeleton=BODY, history_steps=12, horizon_steps=50, rate_hz=25.0))
    longer.load_state_dict(network.state_dict())
    window, _ = motion()
    with torch.no_grad():
        far = longer(window)
        assert far.shape == (3, 50, 28, 3)
        assert far.isfinite().all()
        torch.testing.assert_close(far[:, :10], network(window), rtol=0, atol=0)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"shared": False},
        {"splitting": "joint"},
        {"splitting": "joint", "shared": False},
        {"splitting": "none"},
        {"splitting": "none", "pose": "direction"},
        {"pose": "none"},
        {"pose": "direction"},
        {"representation": "displacement"},
        {"representation": "position"},
        {"representation": "position", "splitting": "none"},
        {"aggregation": False},
        {"adversarial_weight": 0},
        {"momentum_weight": 0},
        {"operator_steps": 3},
    ],
)
@pytest.mark.parametrize("progress", [0.0, 0.9])
def test_a_step_of_every_switch_lowers_the_loss(options, progress):
    network = stirred(small(**options))
    window, target = motion()
    adam = torch.optim.Adam(network.model_parameters(), 1e-3)
    critic = network.critic_loss(window, target, progress)
    assert (critic is None) == (progress < 0.4 or options.get("adversarial_weight") == 0)
    before = network.loss(window, target, progress)
    before.backward()
    assert all(p.grad is not None and p.grad.isfinite().all() for p in network.model_parameters())
    adam.step()
    assert network.loss(window, target, progress) < before


def test_aggregation_and_splitting_change_the_network():
    def outputs(**options: object) -> int:
        head = small(SHAPE, **options).operator.heads[0]
        assert isinstance(head, torch.nn.Linear)
        return head.out_features

    assert outputs() == 5 * 28 * 2
    assert outputs(aggregation=False) == 10 * 28 * 2
    assert outputs(splitting="none") == 5 * 28 * 6
    assert outputs(splitting="joint") == 5 * 2
    assert outputs(representation="displacement") == 5 * 28
    assert len(small(shared=False).operator.grus) == 3


def test_pretraining_sees_five_steps_from_anywhere_and_the_same_at_the_same_progress():
    network = stirred(small())
    window, target = motion(seen=1.1)
    losses = [network.loss(window, target, p).item() for p in (0.0, 0.01, 0.02, 0.03, 0.04, 0.0)]
    assert losses[0] == losses[-1]
    assert len(set(losses)) > 2
    near, ahead = network._anywhere(window, target, 0.01)
    assert near.positions.shape == (3, 12, 28, 3)
    assert ahead.positions.shape == (3, 5, 28, 3)
    both = torch.cat([near.positions, ahead.positions], 1)
    whole = torch.cat([window.positions, target.positions], 1)
    assert any(torch.equal(both, whole[:, k : k + 17]) for k in range(6))


@pytest.mark.parametrize("progress", [0.0, 0.9])
def test_what_is_not_known_of_the_future_does_not_count(progress):
    network = stirred(small())
    window, target = motion()
    other = Target(torch.where(target.observed[..., None], target.positions, 7.0), target.observed)
    assert network.loss(window, target, progress) == network.loss(window, other, progress)


def test_critic_and_network_train_only_their_own():
    network = stirred(small())
    window, target = motion()
    critic_loss = network.critic_loss(window, target, 0.9)
    assert critic_loss is not None
    critic_loss.backward()
    assert all(p.grad is None for p in network.model_parameters())
    assert all(p.grad is not None for p in network.critic_parameters())
    network.zero_grad()
    network.loss(window, target, 0.9).backward()
    assert all(p.grad is None for p in network.critic_parameters())


def test_rolling_out_once_for_both_losses_changes_neither():
    network = stirred(small())
    window, target = motion()
    alone = network.loss(window, target, 0.9)
    network.critic_loss(window, target, 0.9)
    torch.testing.assert_close(network.loss(window, target, 0.9), alone, rtol=0, atol=0)


def test_critic_learns_to_tell_two_kinds_of_motion_with_a_bounded_slope():
    torch.manual_seed(0)
    critic = Critic(40, 32)
    adam = torch.optim.Adam(critic.parameters(), 1e-2)
    real, generated = torch.randn(64, 40), torch.randn(64, 40) + 1.0
    for _ in range(150):
        adam.zero_grad()
        critic.loss(real, generated, 10.0, mix=0.5).backward()
        adam.step()
    gap = (critic(generated) - critic(real)).mean().item()
    distance = float((generated - real).norm(dim=1).mean() / 40**0.5)
    assert 0.3 < gap < 2.0 * distance  # Eq. 12's sign: real motion scores low


def test_momentum_errors_by_hand():
    truth = torch.zeros(1, 1, 2, 3, 2)
    predicted = torch.full_like(truth, 2.0)
    known = torch.tensor([[[True, False]]])
    predicted[0, 0, 1] = 9.0  # not known
    assert float(momentum_error(predicted, truth, known, squared=True)) == pytest.approx(4.0)
    assert float(momentum_error(predicted, truth, known, squared=False)) == pytest.approx(2.0)


def test_benchmark_bodies_are_read_as_they_come():
    network = stirred(
        small(Shape(skeleton=BODY, history_steps=12, horizon_steps=10, rate_hz=25.0, framed=True))
    )
    window, _ = motion()
    assert network(window).isfinite().all()
    torch.testing.assert_close(network._pose(window), window.positions, rtol=0, atol=0)


def test_is_a_network_of_the_contract():
    network = small()
    assert isinstance(network, Network)
    window, target = motion()
    first, second = network(window), network(window)
    assert first.numpy(force=True).tobytes() == second.numpy(force=True).tobytes()
    part = network(BodyFrames(window.positions[:1], window.observed[:1]))
    torch.testing.assert_close(part, first[:1], rtol=0, atol=1e-5)
    assert first.shape == target.positions.shape
