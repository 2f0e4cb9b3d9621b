"""STB: its equations against sums written out, its switches, and that it learns."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor, nn

from hri_predict.base.skeleton import make_skeleton
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target, last_pose
from hri_predict.predictors.stb import STB, GraphLayer, STBOptions, distillation

CHAIN = make_skeleton("chain", list("abcd"), [-1, 0, 1, 2])
SHAPE = Shape(skeleton=CHAIN, history_steps=5, horizon_steps=3, rate_hz=25.0)
SMALL: dict[str, Any] = {"width": 16, "blocks": 2, "dropout": 0.0}


def untrained(**options: Any) -> STB:
    torch.manual_seed(0)
    return STB(SHAPE, STBOptions(**{**SMALL, **options}))


def network(**options: Any) -> STB:
    """With no weights at zero, as they are after training."""
    net = untrained(**options)
    with torch.no_grad():
        for parameter in net.parameters():
            parameter.add_(torch.randn(parameter.shape), alpha=0.1)
    return net


def test_untrained_it_predicts_the_last_pose() -> None:
    given = window()
    assert torch.equal(untrained()(given), last_pose(given).expand(-1, 3, -1, -1))


def window(people: int = 3) -> BodyFrames:
    generator = torch.Generator().manual_seed(1)
    positions = torch.randn(people, 5, 4, 3, generator=generator)
    return BodyFrames(positions, torch.rand(people, 5, 4, generator=generator) > 0.2)


def target(people: int = 3) -> Target:
    generator = torch.Generator().manual_seed(2)
    positions = torch.randn(people, 3, 4, 3, generator=generator)
    return Target(positions, torch.rand(people, 3, 4, generator=generator) > 0.2)


def without_change(net: STB) -> STB:
    """Make the decoders give nothing."""
    for branch in net.branches.values():
        decoder = branch.decoder
        assert isinstance(decoder, GraphLayer)
        nn.init.zeros_(decoder.adjacency)
    return net


def test_graph_layer_mixes_nodes_then_features() -> None:
    layer = GraphLayer(3, 2, 5)
    features = torch.randn(3, 7, 2)
    a, w, b = layer.adjacency, layer.weights.weight, layer.weights.bias
    expected = torch.einsum("nm,mbi,oi->nbo", a, features, w) + a.sum(1)[:, None, None] * b
    torch.testing.assert_close(layer(features), expected)


def test_increments_are_causal_and_nothing_in_the_future() -> None:
    given = window()
    (increments,) = network()._features(given)
    assert increments.shape == (3, 8, 4, 3)
    assert not increments[:, 0].any()
    assert not increments[:, 5:].any()
    for t in range(1, 5):
        expected = 10 * (given.positions[:, t] - given.positions[:, t - 1])
        torch.testing.assert_close(increments[:, t], expected)


def test_the_last_increment_may_be_held_over_the_padding() -> None:
    given = window()
    (still,), (held,) = network()._features(given), network(padding="held")._features(given)
    assert torch.equal(held[:, :5], still[:, :5])
    assert torch.equal(held[:, 5:], still[:, 4:5].expand(-1, 3, -1, -1))


@pytest.mark.parametrize(
    ("inputs", "blind"), [("increments", True), ("positions", False), ("both", False)]
)
def test_increments_alone_do_not_tell_where_a_person_is(inputs: str, blind: bool) -> None:
    net, given = network(inputs=inputs).eval(), window()
    moved = BodyFrames(given.positions + 2.0, given.observed)
    difference = net(moved) - net(given) - 2.0
    assert (difference.abs().max() < 1e-5) == blind


def test_without_a_change_the_last_frame_is_repeated() -> None:
    given = window()
    expected = last_pose(given).expand(-1, 3, -1, -1)
    torch.testing.assert_close(without_change(network())(given), expected)


def test_prediction_is_the_mean_of_the_branches() -> None:
    both = network().eval()
    given, total = window(), torch.zeros(3, 3, 4, 3)
    for name in ("temporal", "spatial"):
        single = network(branches=name).eval()
        single.load_state_dict(both.state_dict(), strict=False)
        total = total + single(given)
    torch.testing.assert_close(both(given), total / 2)


def test_distillation_is_equations_12_to_16() -> None:
    generator = torch.Generator().manual_seed(4)
    t, s = torch.randn(2, 2, 8, 4, 3, generator=generator).unbind(0)

    def softmax(values: list[float]) -> list[float]:
        total = sum(math.exp(v) for v in values)
        return [math.exp(v) / total for v in values]

    def kl(p: list[float], q: list[float]) -> float:
        return sum(a * math.log(a / b) for a, b in zip(p, q, strict=True))

    def energy(change: Tensor) -> list[list[float]]:
        return [[math.sqrt(sum(float(x) ** 2 for x in joint)) for joint in f] for f in change]

    expected = 0.0
    for person in range(2):
        a, b = energy(t[person]), energy(s[person])
        expected += sum(kl(softmax(a[n]), softmax(b[n])) for n in range(8))
        for j in range(4):
            of_a, of_b = ([frame[j] for frame in e] for e in (a, b))
            expected += kl(softmax(of_b), softmax(of_a))
    assert float(distillation(t, s)) == pytest.approx(expected / 2, rel=1e-4)


def test_distillation_teaches_both_and_is_finite_at_rest() -> None:
    generator = torch.Generator().manual_seed(4)
    t, s = (torch.randn(2, 8, 4, 3, generator=generator, requires_grad=True) for _ in range(2))
    distillation(t, s).backward()
    assert t.grad is not None
    assert s.grad is not None
    assert t.grad.abs().max() > 0
    assert s.grad.abs().max() > 0
    still = torch.zeros(2, 8, 4, 3, requires_grad=True)
    divergence = distillation(still, still)
    divergence.backward()
    assert float(divergence.detach()) == pytest.approx(0.0, abs=1e-6)
    assert still.grad is not None
    assert still.grad.isfinite().all()


def test_loss_counts_past_and_future_where_they_are_known() -> None:
    net, given, wanted = without_change(network()), window(), target()
    error = (last_pose(given) - wanted.positions).norm(dim=-1)[wanted.observed].sum()
    known = given.observed.sum() + wanted.observed.sum()  # the past's error is 0: X is given
    assert float(net.loss(given, wanted, 0.0).detach()) == pytest.approx(
        2 * float(error / known), rel=1e-4
    )


def test_the_past_s_truth_is_without_the_noise_of_its_window() -> None:
    net, given, wanted = without_change(network()), window(), target()
    past = Target(given.positions + 0.1, torch.ones_like(given.observed))
    nothing = torch.zeros_like(wanted.observed)
    loss = float(net.loss(given, Target(wanted.positions, nothing, past), 0.0).detach())
    assert loss == pytest.approx(2 * 0.1 * 3**0.5, rel=1e-4)


def test_loss_ignores_what_is_not_known() -> None:
    net, given, wanted = network(), window(), target()
    moved = torch.where(wanted.observed[..., None], wanted.positions, 7.0)
    loss = net.loss(given, wanted, 0.0)
    assert torch.equal(net.loss(given, Target(moved, wanted.observed), 0.0), loss)


def test_lambda_weighs_the_distillation() -> None:
    given, wanted = window(), target()
    none, tenth, whole = (
        float(network(distillation=w).loss(given, wanted, 0.0).detach()) for w in (0.0, 0.1, 1.0)
    )
    assert whole > tenth > none
    assert (whole - none) == pytest.approx(10 * (tenth - none), rel=1e-3)


def test_mask_matters_where_positions_are_the_same() -> None:
    net, given = network().eval(), window()
    seen = BodyFrames(given.positions, torch.ones_like(given.observed))
    assert (net(seen) - net(given)).abs().max() > 1e-4


@pytest.mark.parametrize("branch", ["temporal", "spatial"])
def test_each_branch_lets_one_joint_move_all(branch: str) -> None:
    net, given = network(branches=branch).eval(), window()
    moved = given.positions.clone()
    moved[:, 1, 2, 0] += 1.0
    difference = net(BodyFrames(moved, given.observed)) - net(given)
    assert (difference.abs().amax((0, 1, 3)) > 1e-6).all()


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"inputs": "positions"},
        {"inputs": "both"},
        {"padding": "held"},
        {"branches": "temporal"},
        {"branches": "spatial"},
        {"distillation": 0.0},
        {"distillation": 1.0},
        {"dropout": 0.5},
    ],
)
def test_every_switch_takes_a_step(options: dict[str, Any]) -> None:
    net = network(**options)
    before = [p.detach().clone() for p in net.parameters()]
    optimizer = torch.optim.SGD(net.parameters(), 1.0)
    loss = net.loss(window(), target(), 0.0)
    loss.backward()
    optimizer.step()
    assert loss.isfinite()
    assert all(not torch.equal(a, b) for a, b in zip(before, net.parameters(), strict=True))


def test_dropout_is_for_training_alone() -> None:
    net, given = network(dropout=0.5), window()
    assert not torch.equal(net(given), net(given))
    net.eval()
    assert torch.equal(net(given), net(given))


@pytest.mark.long
def test_learns_a_constant_velocity() -> None:
    net = network()
    generator = torch.Generator().manual_seed(3)
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    known = torch.ones(32, 8, 4, dtype=torch.bool)
    for _ in range(200):
        start = torch.randn(32, 1, 4, 3, generator=generator)
        speed = torch.randn(32, 1, 1, 3, generator=generator) * 0.1
        path = start + speed * torch.arange(8).view(1, -1, 1, 1)
        given, wanted = BodyFrames(path[:, :5], known[:, :5]), Target(path[:, 5:], known[:, 5:])
        optimizer.zero_grad()
        net.loss(given, wanted, 0.0).backward()
        optimizer.step()
    net.eval()
    error = (net(given) - wanted.positions).norm(dim=-1).mean().detach()
    still = (last_pose(given) - wanted.positions).norm(dim=-1).mean()
    assert float(error) < 0.5 * float(still)


def test_same_bytes_and_independent_of_the_batch() -> None:
    net, given = network().eval(), window(5)
    predicted = net(given)
    assert torch.equal(net(given), predicted)
    alone = net(BodyFrames(given.positions[2:3], given.observed[2:3]))
    torch.testing.assert_close(alone, predicted[2:3], rtol=0, atol=1e-5)


def test_size_of_the_paper_can_be_reached() -> None:
    net = STB(
        Shape(skeleton=BODY, history_steps=10, horizon_steps=25, rate_hz=25.0),
        STBOptions(width=512),
    )
    millions = sum(p.numel() for p in net.parameters()) / 1e6
    assert 6.8 < millions < 7.8  # Table 8: 7.33
