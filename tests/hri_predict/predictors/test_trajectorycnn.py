"""TrajectoryCNN: its layout, its switches, and that it learns."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.base.skeleton import make_skeleton
from hri_predict.predictors.neural.body import BODY
from hri_predict.predictors.neural.network import BodyFrames, Shape, Target, last_pose
from hri_predict.predictors.trajectorycnn import (
    PART_ORDER,
    NestedBlock,
    TrajectoryCNN,
    TrajectoryCNNOptions,
    part_order,
)

SHAPE = Shape(skeleton=BODY, history_steps=6, horizon_steps=9, rate_hz=25.0)
SMALL: dict[str, Any] = {"channels": 8, "blocks": 1}
ELBOW = BODY.index("l_elbow")


def network(shape: Shape = SHAPE, **options: Any) -> TrajectoryCNN:
    torch.manual_seed(0)
    return TrajectoryCNN(shape, TrajectoryCNNOptions(**options))


def window(people: int = 3, shape: Shape = SHAPE) -> BodyFrames:
    generator = torch.Generator().manual_seed(1)
    size = (people, shape.history_steps, shape.joints)
    positions = torch.randn(*size, 3, generator=generator)
    return BodyFrames(positions, torch.rand(*size, generator=generator) > 0.1)


def target(people: int = 3) -> Target:
    generator = torch.Generator().manual_seed(2)
    size = (people, SHAPE.horizon_steps, SHAPE.joints)
    return Target(torch.randn(*size, 3, generator=generator), torch.ones(*size, dtype=torch.bool))


def changed(net: TrajectoryCNN, coordinate: int) -> torch.Tensor:
    """(J, 3): which outputs depend on one coordinate of the left elbow before the last step."""
    net.eval()
    before = window(1)
    moved = before.positions.clone()
    moved[:, :-1, ELBOW, coordinate] += 1.0
    after = BodyFrames(moved, before.observed)
    return ((net(after) - net(before)).abs().amax((0, 1)) > 1e-7).detach()


def test_joints_are_sorted_by_part_as_in_the_paper() -> None:
    order = part_order(BODY)
    assert sorted(order) == list(range(28))
    start = 0
    for part in PART_ORDER:
        joints = BODY.parts[part]
        assert order[start : start + len(joints)] == list(joints)
        start += len(joints)
    assert start == 28


def test_joints_of_no_part_come_last() -> None:
    skeleton = make_skeleton("s", list("abcd"), [-1, 0, 1, 2], parts={"right_arm": (2,)})
    assert part_order(skeleton) == [2, 0, 1, 3]


def test_default_has_the_layers_of_the_paper() -> None:
    net = network(Shape(skeleton=BODY, history_steps=10, horizon_steps=25, rate_hz=25.0))
    sizes = [
        tuple(layer.weight.shape) for layer in net.modules() if isinstance(layer, torch.nn.Conv2d)
    ]
    assert sizes.count((64, 64, 3, 3)) == 4 * 5
    assert sizes[0] == (64, 20, 1, 1)  # ten frames and their mask
    assert sizes[-2:] == [(25, 64, 3, 3), (25, 25, 1, 1)]


def test_without_a_change_the_last_frame_is_repeated() -> None:
    net = network(**SMALL).eval()
    last_layer = net.decoder[-1]
    assert isinstance(last_layer, torch.nn.Conv2d)
    torch.nn.init.zeros_(last_layer.weight)
    given = window()
    assert torch.equal(net(given), last_pose(given).expand(-1, 9, -1, -1))


def test_kernels_reach_as_far_as_table_vi_says() -> None:
    single = torch.zeros(28, 3, dtype=torch.bool)
    single[ELBOW, 1] = True
    assert torch.equal(changed(network(**SMALL, kernel="1x1"), 1), single)
    single[ELBOW] = True
    assert torch.equal(changed(network(**SMALL, kernel="1x3"), 1), single)
    around = changed(network(**SMALL), 1).any(1)
    order = part_order(BODY)
    rows = [order.index(j) for j in range(28) if around[j]]
    reach = 5 + 1  # five layers and the decoder's, each a row further
    middle = order.index(ELBOW)
    assert sorted(rows) == [r for r in range(28) if abs(r - middle) <= reach]


def test_residual_branches_are_two_point_wise_convolutions_a_block() -> None:
    def count(net: TrajectoryCNN) -> int:
        return sum(p.numel() for p in net.parameters())

    assert count(network()) - count(network(residual=False)) == 4 * 2 * (64 * 64 + 64)


def test_nested_branches_are_three_a_block_each_inside_the_one_before() -> None:
    def count(net: TrajectoryCNN) -> int:
        return sum(p.numel() for p in net.parameters())

    nested, bare = network(paths="nested"), network(paths="nested", residual=False)
    assert count(nested) - count(bare) == 4 * 3 * (64 * 64 + 64)
    block = NestedBlock(8, (3, 3), TrajectoryCNNOptions(paths="nested")).eval()
    layers = [m for m in block.layers.modules() if isinstance(m, torch.nn.Conv2d)]
    for parameter in (p for layer in layers for p in layer.parameters()):
        torch.nn.init.zeros_(parameter)  # what is left goes through the branches alone
    given = torch.randn(1, 8, 28, 3)
    outer = block.branches[0](given)
    torch.testing.assert_close(block(given), outer)
    assert layers[4].bias is not None
    torch.nn.init.constant_(layers[4].bias, 1.0)
    torch.testing.assert_close(block(given), outer + 1.0)


def test_displacements_feed_the_same_network_as_raw_positions() -> None:
    raw, relative = network(**SMALL, relative=False).eval(), network(**SMALL).eval()
    relative.load_state_dict(raw.state_dict())
    with torch.no_grad():  # a position is the last one plus the displacement from it
        weight = relative.trajectory_space.weight
        weight[:, 5] = weight[:, :6].sum(1)
    given = window()
    torch.testing.assert_close(relative(given), raw(given), rtol=0, atol=1e-5)


def test_mask_matters_where_positions_are_the_same() -> None:
    net, given = network(**SMALL).eval(), window()
    seen = BodyFrames(given.positions, torch.ones_like(given.observed))
    assert (net(seen) - net(given)).abs().max() > 1e-4


@pytest.mark.parametrize("steps", [4, 9, 12])
def test_pose_layout_takes_any_history(steps: int) -> None:
    shape = replace(SHAPE, history_steps=steps)
    net = network(shape, **SMALL, layout="pose").eval()
    given = window(2, shape)
    predicted = net(given)
    assert predicted.shape == (2, 9, 28, 3)
    moved = given.positions.clone()
    moved[:, -2, ELBOW] += 1.0
    assert (net(BodyFrames(moved, given.observed)) - predicted).abs().max() > 1e-4


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"kernel": "1x1"},
        {"kernel": "1x3"},
        {"layout": "pose"},
        {"residual": False},
        {"relative": False},
        {"dropout": 0.5},
        {"paths": "nested", "slope": 0.2},
        {"paths": "nested", "residual": False},
        {"decoder": 5},
        {"bone_weight": 0.5, "early": 0.3},
    ],
)
def test_every_switch_takes_a_step(options: dict[str, Any]) -> None:
    net = network(**SMALL, **options)
    before = [p.detach().clone() for p in net.parameters()]
    optimizer = torch.optim.SGD(net.parameters(), 0.1)
    loss = net.loss(window(), target(), 0.0)
    loss.backward()
    optimizer.step()
    assert loss.isfinite()
    assert all(not torch.equal(a, b) for a, b in zip(before, net.parameters(), strict=True))


@pytest.mark.long
def test_learns_a_constant_velocity() -> None:
    net = network(channels=16, blocks=1, dropout=0.0)
    generator = torch.Generator().manual_seed(3)
    optimizer = torch.optim.Adam(net.parameters(), 3e-3)
    losses = []
    for _ in range(120):
        start = torch.randn(16, 1, 28, 3, generator=generator)
        speed = torch.randn(16, 1, 1, 3, generator=generator) * 0.05
        path = start + speed * torch.arange(15).view(1, -1, 1, 1)
        known = torch.ones(16, 15, 28, dtype=torch.bool)
        given = BodyFrames(path[:, :6], known[:, :6])
        loss = net.loss(given, Target(path[:, 6:], known[:, 6:]), 0.0)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        losses.append(float(loss.detach()))
    still = (speed * torch.arange(1, 10).view(1, -1, 1, 1)).norm(dim=-1).mean()
    assert losses[-1] < 0.5 * float(still)


def test_same_bytes_and_independent_of_the_batch() -> None:
    net, given = network(**SMALL).eval(), window(5)
    predicted = net(given)
    assert torch.equal(net(given), predicted)
    alone = net(BodyFrames(given.positions[2:3], given.observed[2:3]))
    torch.testing.assert_close(alone, predicted[2:3], rtol=0, atol=1e-5)


def test_mirrored_treats_left_and_right_alike_once_trained() -> None:
    net, given = network(**SMALL, mirrored=True), window()
    image = BodyFrames(net.mirror(given.positions), given.observed[..., net.mirror.order])
    net.eval()
    torch.testing.assert_close(net(image), net.mirror(net(given)), rtol=1e-5, atol=1e-5)
    plain = network(**SMALL).eval()
    assert (net(given) - plain(given)).abs().max() > 1e-3
    net.train()
    torch.manual_seed(3)
    one = net(given)
    torch.manual_seed(3)
    assert torch.equal(one, plain.train()(given))  # training draws mirror images instead


def test_a_moved_body_has_wrong_positions_and_right_bones() -> None:
    net, given = network(**SMALL, bone_weight=0.5).eval(), window()
    with torch.no_grad():
        moved = Target(net(given) + torch.tensor([0.3, 0.0, 0.4]), target().observed)
        losses = net.losses(given, moved, 0.0)
    assert set(losses) == {"position", "bones"}
    torch.testing.assert_close(losses["position"], torch.tensor(0.5), rtol=1e-5, atol=1e-5)
    assert losses["bones"] < 1e-5


def test_bones_count_only_where_both_ends_are_known() -> None:
    net, given = network(**SMALL, bone_weight=0.5).eval(), window()
    known = target().observed
    known[:, :, ELBOW] = False
    with torch.no_grad():
        future = net(given)
        wild = future.clone()
        wild[:, :, ELBOW] += 100.0
        assert net.losses(given, Target(wild, known), 0.0)["bones"] < 1e-5
        assert net.losses(given, Target(wild, target().observed), 0.0)["bones"] > 1.0


def test_early_steps_weigh_more_with_the_same_mean() -> None:
    given = window()
    net = network(**SMALL, early=0.5).eval()
    assert net.step_weights.mean().item() == pytest.approx(1.0)
    with torch.no_grad():
        future = net(given)
        for step, share in ((0, net.step_weights[0]), (8, net.step_weights[8])):
            wrong = future.clone()
            wrong[:, step, :, 0] += 0.9
            loss = net.losses(given, Target(wrong, target().observed), 0.0)["position"]
            torch.testing.assert_close(loss, 0.1 * share, rtol=1e-4, atol=1e-5)
    assert net.step_weights[0] == pytest.approx(3.0 * net.step_weights[8].item())


def test_unknown_kernel_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match=r"x\.yaml: kernel: .*'3x3'"):
        validated(TrajectoryCNNOptions, {"kernel": "5x5"}, "x.yaml")
