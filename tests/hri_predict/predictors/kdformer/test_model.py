"""KD-Former: one training step under every switch, what it reads, and what it gives."""

from typing import Any

import pytest
import torch
from pydantic import ValidationError

from hri_predict.base.errors import PredictorError
from hri_predict.base.skeleton import make_skeleton
from hri_predict.predictors.kdformer.model import KDFormer, KDFormerOptions
from hri_predict.predictors.kdformer.rotations import matrix
from hri_predict.predictors.kdformer.transformer import Attention
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.cmu_skeleton import CMU38
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target, last_pose

T, H = 6, 3
POSITIONS = Shape(skeleton=BODY, history_steps=T, horizon_steps=H, rate_hz=25.0)
ROTATIONS = Shape(skeleton=CMU38, history_steps=T, horizon_steps=H, rate_hz=25.0, framed=True)
SMALL: dict[str, Any] = {"layers": 1, "width": 2, "heads": 2}


def network(shape: Shape = POSITIONS, **options: Any) -> KDFormer:
    torch.manual_seed(0)
    net = KDFormer(shape, KDFormerOptions(**{**SMALL, **options}))
    net.rest.copy_(torch.randn(shape.joints, 3) * 0.3)
    return net


def stirred(net: KDFormer) -> KDFormer:
    """With an output layer that says something; it starts at zero."""
    generator = torch.Generator().manual_seed(3)
    torch.nn.init.normal_(net.decoder.out.weight, std=0.05, generator=generator)
    return net


def motion(net: KDFormer, people: int = 2, whole: bool = False) -> tuple[BodyFrames, Target]:
    generator = torch.Generator().manual_seed(1)
    joints = net.shape.joints
    steps = 0.03 * torch.randn(people, T + H, joints, 3, generator=generator).cumsum(1)
    values = net.rest + steps
    observed = torch.rand(people, T, joints, generator=generator) > (0.0 if whole else 0.2)
    observed[0, : T // 2] &= whole  # left-padded
    known = torch.rand(people, H, joints, generator=generator) > 0.1
    return BodyFrames(values[:, :T], observed), Target(values[:, T:], known)


SWITCHES: list[dict[str, Any]] = [
    {},
    {"inputs": "kinematic"},
    {"inputs": "dynamic"},
    {"decoding": "autoregressive"},
    {"position_embedding": "absolute"},
    {"quaternion_loss": False},
    {"body_parts": 3},
    {"body_parts": 7},
    {"fusion": "parallel"},
    {"fusion": "flat"},
    {"inputs": "kinematic", "fusion": "flat"},
    {"width": 6, "heads": 3, "layers": 2, "feed_forward": 1, "dropout": 0.1},
]


@pytest.mark.parametrize("shape", [POSITIONS, ROTATIONS], ids=["positions", "rotations"])
@pytest.mark.parametrize("options", SWITCHES, ids=str)
def test_a_step_of_training_changes_what_is_predicted(shape, options):
    space = "rotations" if shape.framed else "positions"
    net = network(shape, space=space, **options)
    window, target = motion(net)
    optimiser = torch.optim.Adam(net.model_parameters(), 1e-3)
    before = net(window).detach()
    assert before.shape == (2, H, shape.joints, 3)
    for _ in range(2):  # the output layer starts at zero: what is below it moves at the second
        optimiser.zero_grad()
        loss = net.loss(window, target, 0.0)
        loss.backward()
        optimiser.step()
    assert loss.isfinite()
    unmoved = [n for n, p in net.named_parameters() if p.grad is None or not p.grad.any()]
    lone = {"kinematic_spatial.missing"} if options.get("inputs") == "dynamic" else set()
    assert set(unmoved) <= lone | {n for n in unmoved if n.endswith("key_value.bias")}
    assert not torch.equal(net(window), before)


def test_switches_differ():
    outputs = []
    for options in SWITCHES[:4] + SWITCHES[6:10]:
        net = stirred(network(**options))
        outputs.append(net(motion(net)[0]))
    for i, a in enumerate(outputs):
        assert all(not torch.allclose(a, b) for b in outputs[i + 1 :])


def test_it_learns_to_travel():
    net = network()
    track = torch.arange(T + H)[:, None, None] * torch.tensor([0.1, 0.05, 0.0])
    walk = (net.rest + track)[None]
    seen = torch.ones(1, T + H, 28, dtype=torch.bool)
    window, target = BodyFrames(walk[:, :T], seen[:, :T]), Target(walk[:, T:], seen[:, T:])
    # steps so small that the loss falls to a sixth, whatever order float32 sums are taken in
    optimiser = torch.optim.Adam(net.model_parameters(), 3e-3)
    losses = []
    for _ in range(20):
        optimiser.zero_grad()
        loss = net.loss(window, target, 0.0)
        loss.backward()
        optimiser.step()
        losses.append(loss.item())
    assert losses[-1] < 0.5 * losses[0]


def test_untrained_it_repeats_the_last_pose():
    net = network()
    still = net.rest.expand(2, T, 28, 3)
    window = BodyFrames(still, torch.ones(2, T, 28, dtype=torch.bool))
    expected = last_pose(window).expand(-1, H, -1, -1)
    torch.testing.assert_close(net(window), expected, atol=1e-5, rtol=0)


def test_untrained_it_repeats_the_last_rotations():
    net = network(ROTATIONS, space="rotations")
    window, _ = motion(net, whole=True)
    expected = last_pose(window).expand(-1, H, -1, -1)
    torch.testing.assert_close(net(window), expected, atol=1e-5, rtol=0)


def test_bones_keep_the_persons_length():
    net = stirred(network())
    window, _ = motion(net, whole=True)
    lengths = net.tree.lengths(window.positions, window.observed)
    found = net.tree.bones(net(window)).norm(dim=-1)
    torch.testing.assert_close(found, lengths[:, None].expand_as(found), atol=1e-5, rtol=1e-4)


def test_travel_is_a_token():
    net = stirred(network())
    window, _ = motion(net, whole=True)
    there = BodyFrames(window.positions + torch.tensor([3.0, -2.0, 0.5]), window.observed)
    torch.testing.assert_close(  # it does not matter where the body is
        net(there) - there.positions[:, -1:, :1],
        net(window) - window.positions[:, -1:, :1],
        atol=1e-3,
        rtol=0,
    )
    drift = window.positions + torch.linspace(-1, 0, T)[:, None, None]
    assert not torch.allclose(net(BodyFrames(drift, window.observed)), net(window), atol=1e-3)


def test_steps_without_any_observed_joint_are_not_read():
    net = stirred(network())
    window, _ = motion(net, whole=True)
    observed = window.observed.clone()
    observed[:, :3] = False
    positions = window.positions.clone()
    positions[:, :3] = positions[:, 3:4]  # as they are filled in
    rotations = torch.randn(2, T, 29, 3)
    other = rotations.clone()
    other[:, :3] = 5.0
    forces, seen = torch.randn(2, T, 29, 3), torch.cat([observed, observed[..., :1]], 2)
    torch.testing.assert_close(
        net.forward_core(rotations, forces, seen), net.forward_core(other, forces, seen)
    )


def test_a_joint_not_observed_is_told_apart():
    net = stirred(network())
    torch.nn.init.normal_(net.kinematic_spatial.missing)
    window, _ = motion(net, whole=True)
    observed = window.observed.clone()
    observed[:, 2:, 9] = False
    assert not torch.allclose(net(BodyFrames(window.positions, observed)), net(window), atol=1e-4)


def test_nobody_observed_gives_finite_numbers():
    net = stirred(network())
    window, _ = motion(net)
    assert net(BodyFrames(window.positions, torch.zeros_like(window.observed))).isfinite().all()


def test_people_do_not_mix():
    net = stirred(network()).eval()
    window, _ = motion(net, people=3)
    for i in range(3):
        alone = net(BodyFrames(window.positions[i : i + 1], window.observed[i : i + 1]))
        torch.testing.assert_close(alone[0], net(window)[i], atol=1e-5, rtol=0)


def test_wraps_in_the_history_do_not_matter():
    net = stirred(network(ROTATIONS, space="rotations"))
    window, target = motion(net, whole=True)
    e = window.positions.clone()
    length = e.norm(dim=-1, keepdim=True)
    e[:, 2:5] = (e * (1 - 2 * torch.pi / length))[:, 2:5]
    wrapped = BodyFrames(e, window.observed)
    torch.testing.assert_close(matrix(net(wrapped)), matrix(net(window)), atol=1e-3, rtol=0)
    future = target.positions
    around = future * (1 - 2 * torch.pi / future.norm(dim=-1, keepdim=True))
    torch.testing.assert_close(
        net.loss(window, Target(around, target.observed), 0.0),
        net.loss(window, target, 0.0),
        atol=1e-4,
        rtol=0,
    )


def test_the_papers_size():
    """Table 6: 8.53 million parameters on Human3.6M's 32 joints, 50 and 25 steps."""
    joints = 31  # and travel
    skeleton = make_skeleton("h36m", [str(i) for i in range(joints)], [-1] + [0] * (joints - 1))
    net = KDFormer(
        Shape(skeleton=skeleton, history_steps=50, horizon_steps=25, rate_hz=25.0),
        KDFormerOptions(),
    )
    size = sum(p.numel() for p in net.parameters())
    assert size == pytest.approx(8.53e6, rel=0.03)


def test_rotations_need_the_benchmarks_skeleton():
    with pytest.raises(PredictorError, match="cmu38"):
        network(space="rotations")


def test_width_must_fit_the_heads():
    with pytest.raises(ValidationError, match="multiple of heads"):
        KDFormerOptions(width=6)


@pytest.mark.parametrize("size", ["width", "layers", "heads", "feed_forward"])
def test_sizes_that_fill_the_memory_are_refused(size):
    with pytest.raises(ValidationError, match=rf"{size}\n.*less than or equal to"):
        KDFormerOptions.model_validate({size: 10**9})


def test_attention_is_the_same_with_and_without_gradients():
    layer = Attention(8, 8)
    x = torch.randn(3, 6, 8)
    with torch.inference_mode():
        quick = layer(x, x, None)
    torch.testing.assert_close(quick, layer(x, x, None))
    torch.testing.assert_close(quick, layer(x, x, torch.ones(3, 6, dtype=torch.bool)))
