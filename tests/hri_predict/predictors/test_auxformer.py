"""AuxFormer: what it reads, what it ignores, and every switch."""

from typing import Literal

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.predictors.auxformer import AuxFormer
from hri_predict.predictors.auxformer_attention import Attention, AuxFormerOptions
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target, mpjpe

HISTORY, HORIZON, JOINTS = 6, 7, len(BODY.joints)
SMALL = {
    "features": 8,
    "heads": 2,
    "layers": 2,
    "hidden": 8,
    "future_stride": 3,
    "auxiliary_share": 1.0,
}
SHAPE = Shape(skeleton=BODY, history_steps=HISTORY, horizon_steps=HORIZON, rate_hz=25.0)


def _network(**options: object) -> AuxFormer:
    """A small network; its heads, zero before training, are given weights."""
    torch.manual_seed(0)
    network = AuxFormer(SHAPE, AuxFormerOptions.model_validate(SMALL | options))
    with torch.no_grad():
        network.rest.copy_(torch.randn(JOINTS, 3))
        for head in (network.predict, network.unmask, network.denoise, network.unmask_future):
            if head is not None:
                head.weight.normal_(std=0.3)
    return network


def _window(count: int, missing: float = 0.3) -> BodyFrames:
    generator = torch.Generator().manual_seed(1)
    positions = torch.randn(count, HISTORY, JOINTS, 3, generator=generator)
    observed = torch.rand(count, HISTORY, JOINTS, generator=generator) >= missing
    return BodyFrames(positions, observed)


def _target(count: int) -> Target:
    generator = torch.Generator().manual_seed(2)
    positions = torch.randn(count, HORIZON, JOINTS, 3, generator=generator)
    return Target(positions, torch.rand(count, HORIZON, JOINTS, generator=generator) >= 0.1)


def _scrambled(window: BodyFrames) -> BodyFrames:
    other = 100 * torch.randn(window.positions.shape)
    return BodyFrames(
        torch.where(window.observed[..., None], window.positions, other), window.observed
    )


def test_forecast_has_the_contract_s_shape() -> None:
    assert _network()(_window(3)).shape == (3, HORIZON, JOINTS, 3)


def test_untrained_it_predicts_zero_velocity() -> None:
    window = _window(2, missing=0.0)
    network = AuxFormer(SHAPE, AuxFormerOptions.model_validate(SMALL))
    assert torch.equal(network(window), window.positions[:, -1:].expand(-1, HORIZON, -1, -1))


def test_with_velocity_no_hidden_value_is_read() -> None:
    network, window = _network(velocity=True), _window(3)
    assert network.coordinate.in_features == 9
    assert torch.equal(network(window), network(_scrambled(window)))


def test_unobserved_values_do_not_matter_at_all() -> None:
    network, window = _network(), _window(3)
    assert torch.equal(network(_scrambled(window)), network(window))


def test_unobserved_values_do_not_matter_to_the_loss() -> None:
    network, window, target = _network(), _window(3), _target(3)
    torch.manual_seed(5)
    expected = network.loss(window, target, 0.0)
    scrambled = _scrambled(window)
    torch.manual_seed(5)
    assert torch.equal(network.loss(scrambled, target, 0.0), expected)


def test_unknown_future_does_not_matter_to_the_loss() -> None:
    network, window, target = _network(auxiliary_future=True), _window(3), _target(3)
    torch.manual_seed(5)
    expected = network.loss(window, target, 0.0)
    other = torch.where(target.observed[..., None], target.positions, 100.0)
    torch.manual_seed(5)
    assert torch.equal(network.loss(window, Target(other, target.observed), 0.0), expected)


def test_each_observed_value_matters() -> None:
    network, window = _network(), _window(1)
    positions = window.positions.clone().requires_grad_()
    network(BodyFrames(positions, window.observed)).sum().backward()
    assert positions.grad is not None
    assert torch.equal((positions.grad != 0).any(-1), window.observed)


def test_people_are_independent_of_their_batch() -> None:
    network, window = _network(), _window(4)
    window.observed[2] = True  # complete windows take a path of their own when alone
    window.observed[3] = False
    together = network(window)
    for i in range(4):
        alone = network(BodyFrames(window.positions[i : i + 1], window.observed[i : i + 1]))
        torch.testing.assert_close(alone[0], together[i], atol=1e-5, rtol=0)


def test_same_batch_same_bytes() -> None:
    network, window = _network(), _window(2)
    assert torch.equal(network(window), network(window))


def test_nobody_observed_is_finite_with_finite_gradients() -> None:
    network, target = _network(), _target(2)
    nobody = BodyFrames(torch.randn(2, HISTORY, JOINTS, 3), torch.zeros(2, HISTORY, JOINTS).bool())
    assert network(nobody).isfinite().all()
    network.loss(nobody, target, 0.0).backward()
    assert all(p.grad is None or p.grad.isfinite().all() for p in network.parameters())


@pytest.mark.parametrize("over", ["joints", "steps"])
def test_attention_is_a_mean_over_observed_keys(over: str) -> None:
    """With one value on observed tokens and another on the rest, only the first comes through.

    It would come out smaller, were the mask applied after the softmax without normalising again.
    """
    observed = _window(2, missing=0.5).observed
    observed[0, 1] = False  # a step without any
    observed[1, :, 2] = False  # a joint without any
    attention = _transparent(over)
    values = torch.where(observed[..., None], 1.0, -50.0).repeat(1, 1, 1, 8)
    change = attention(values, observed) - values
    torch.testing.assert_close(change[observed], torch.ones_like(change[observed]))
    assert not change[~observed].any()


def _transparent(over: str) -> Attention:
    """Attention with random queries and keys whose values and FFN pass features on."""
    torch.manual_seed(3)
    options = AuxFormerOptions(features=8, heads=2, hidden=8)
    attention = Attention(options, over="joints" if over == "joints" else "steps")
    attention.add_module("norm", torch.nn.Identity())  # it would erase constants
    with torch.no_grad():
        attention.qkv.weight.view(2, 3, 4, 8)[:, 2] = torch.eye(8).view(2, 4, 8)
        attention.qkv.bias.zero_()
        for parameter in attention.ffn.parameters():
            parameter.copy_(torch.eye(8) if parameter.dim() == 2 else torch.zeros(8))
    return attention


@pytest.mark.parametrize(("scale", "width"), [("head", 4), ("features", 8)])
@pytest.mark.parametrize("over", ["joints", "steps"])
def test_attention_equals_its_equation(
    over: str, scale: Literal["head", "features"], width: int
) -> None:
    """Against loops over heads and places (section 4.2, softmax over observed keys)."""
    torch.manual_seed(4)
    options = AuxFormerOptions(features=8, heads=2, hidden=16, scale=scale)
    attention = Attention(options, over="joints" if over == "joints" else "steps")
    tokens, observed = torch.randn(2, 3, 4, 8), torch.rand(2, 3, 4) > 0.4
    expected = tokens.clone()
    q, k, v = attention.qkv(attention.norm(tokens)).view(2, 3, 4, 2, 3, 4).unbind(4)
    for n, t, j in observed.nonzero().tolist():
        row = (n, t) if over == "joints" else (n, slice(None), j)
        seen = observed[row]
        heads = []
        for h in range(2):
            scores = k[row][seen][:, h] @ q[n, t, j, h] / width**0.5
            heads.append(scores.softmax(0) @ v[row][seen][:, h])
        expected[n, t, j] += attention.ffn(torch.cat(heads))
    torch.testing.assert_close(attention(tokens, observed), expected, atol=1e-5, rtol=0)


def test_hidden_coordinates_are_hidden_from_the_masking_task() -> None:
    """Not even through what was filled in from them: all hidden, the input is the rest pose."""
    network, window = _network(mask_ratio=1.0), _window(2, missing=0.0)
    hidden = network._masked(window)
    assert not hidden.observed.any()
    assert torch.equal(network._filled(hidden), network.rest.expand(2, HISTORY, -1, -1))


def test_ratios_and_noise_are_as_set() -> None:
    window = BodyFrames(torch.zeros(40, HISTORY, JOINTS, 3), torch.ones(40, HISTORY, JOINTS).bool())
    torch.manual_seed(0)
    network = _network()
    assert network._masked(window).observed.float().mean() == pytest.approx(0.5, abs=0.03)
    moved = network._noisy(window).positions
    noisy = moved.any(-1)
    assert noisy.float().mean() == pytest.approx(0.3, abs=0.03)
    assert moved[noisy].std() == pytest.approx(0.05, abs=0.003)


def test_loss_is_the_sum_of_its_three_tasks() -> None:
    """With heads at zero each task's error is known without the network."""
    window, target = _window(3), _target(3)
    network = AuxFormer(
        SHAPE,
        AuxFormerOptions.model_validate(SMALL | {"mask_weight": 2.0, "denoise_weight": 3.0}),
    )
    torch.manual_seed(6)
    total = network.loss(window, target, 0.0)
    torch.manual_seed(6)
    masked, noisy = network._masked(window), network._noisy(window)
    last = network._filled(window)[:, -1:].expand_as(target.positions)
    hidden = Target(window.positions, window.observed & ~masked.observed)
    whole = Target(window.positions, window.observed)
    expected = (
        mpjpe(last, target)
        + 2.0 * mpjpe(network._filled(masked), hidden)
        + 3.0 * mpjpe(network._filled(noisy), whole)
    )
    torch.testing.assert_close(total, expected)


def test_what_is_learnt_of_the_past_is_its_truth() -> None:
    """Noise of augmentation is in the window, and never in what the tasks are to recover."""
    window, known = _window(3), torch.ones(3, HISTORY, JOINTS, dtype=torch.bool)
    past = Target(window.positions + 1.0, known)
    target = Target(_target(3).positions, torch.zeros(3, HORIZON, JOINTS, dtype=torch.bool), past)
    network = AuxFormer(SHAPE, AuxFormerOptions.model_validate(SMALL | {"noise_m": 0.0}))
    masked = past.observed & window.observed
    torch.manual_seed(6)
    hidden = masked & ~network._masked(window).observed
    torch.manual_seed(6)
    total = network.loss(window, target, 0.0)
    filled = network._filled(BodyFrames(window.positions, window.observed & ~hidden))
    expected = mpjpe(filled, Target(past.positions, hidden)) + 3**0.5  # 1 m along each axis
    torch.testing.assert_close(total, expected)


def test_loss_draws_from_the_global_generator() -> None:
    network, window, target = _network(), _window(2), _target(2)
    torch.manual_seed(7)
    first = network.loss(window, target, 0.0)
    torch.manual_seed(7)
    assert torch.equal(network.loss(window, target, 0.0), first)
    assert not torch.equal(network.loss(window, target, 0.0), first)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"masking": False},
        {"denoising": False},
        {"masking": False, "denoising": False},
        {"observed_attention": False},
        {"order": "separate"},
        {"mask_ratio": 0.7, "noise_ratio": 0.6, "noise_m": 0.02},
        {"auxiliary_share": 0.5},
        {"auxiliary_future": True},
        {"auxiliary_future": True, "auxiliary_share": 0.5, "denoising": False},
        {"future_stride": 1},
    ],
)
def test_one_step_with_each_switch_lowers_the_loss(options: dict[str, object]) -> None:
    network, window, target = _network(**options), _window(4), _target(4)
    # the loss falls by 3e-5 of itself or more: 300 of float32's roundings of 1.2e-7
    optimiser = torch.optim.SGD(network.parameters(), lr=0.05)
    torch.manual_seed(8)
    before = network.loss(window, target, 0.0)
    before.backward()
    unmoved = [n for n, p in network.named_parameters() if p.grad is None or not p.grad.any()]
    assert not unmoved
    optimiser.step()
    torch.manual_seed(8)
    assert network.loss(window, target, 0.0) < before


def test_switches_leave_their_parts_out() -> None:
    alone = _network(masking=False, denoising=False, observed_attention=False)
    assert alone.unmask is None
    assert alone.denoise is None
    assert not alone.observed_layers
    iterative, separate = _network(), _network(order="separate")
    assert [seen for _, seen in iterative.order()] == [True, False, True, False]
    assert [seen for _, seen in separate.order()] == [True, True, False, False]


def test_auxiliary_tasks_cost_nothing_at_run_time() -> None:
    """The forecast of a network with the tasks is that of the same weights without their heads."""
    network, bare = _network(), _network(masking=False, denoising=False)
    bare.load_state_dict(network.state_dict(), strict=False)
    assert torch.equal(network(_window(2)), bare(_window(2)))


def test_heads_must_divide_features() -> None:
    with pytest.raises(ConfigError, match=r"multiple of heads") as error:
        validated(AuxFormerOptions, {"features": 10, "heads": 4}, "train.yaml: options")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("size", ["features", "heads", "layers", "hidden", "future_stride"])
def test_sizes_that_fill_the_memory_are_refused(size: str) -> None:
    with pytest.raises(ConfigError, match=rf"options: {size}: .*less than or equal to"):
        validated(AuxFormerOptions, {size: 10**9}, "train.yaml: options")


@pytest.mark.long
def test_a_few_steps_fit_a_swing() -> None:
    """On swinging bodies it learns to be clearly better than standing still."""
    torch.manual_seed(9)
    phase = torch.rand(8, 1) * 6.0 + torch.arange(HISTORY + HORIZON) * 0.25
    swing = 0.3 * torch.stack([phase.sin(), phase.cos(), 0 * phase], -1)
    motion = torch.randn(JOINTS, 3) * 0.3 + swing[:, :, None] * torch.rand(JOINTS, 1)
    seen = torch.ones(motion.shape[:3], dtype=torch.bool)
    window = BodyFrames(motion[:, :HISTORY], seen[:, :HISTORY])
    target = Target(motion[:, HISTORY:], seen[:, HISTORY:])
    network = AuxFormer(SHAPE, AuxFormerOptions.model_validate(SMALL | {"layers": 1}))
    standing = mpjpe(network(window), target)
    optimiser = torch.optim.Adam(network.parameters(), lr=2e-2)
    for _ in range(90):  # to a quarter, whatever order float32 sums are taken in; 60 reach a half
        optimiser.zero_grad()
        network.loss(window, target, 0.0).backward()
        optimiser.step()
    assert mpjpe(network(window), target) < 0.5 * standing
