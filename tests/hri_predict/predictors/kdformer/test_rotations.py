"""Rotations: conversions against closed forms, and positions there and back through the tree."""

import math

import pytest
import torch

from hri_predict.base.errors import PredictorError
from hri_predict.base.skeleton import make_skeleton
from hri_predict.predictors.kdformer.rotations import (
    KinematicTree,
    between,
    conjugate,
    continuous,
    expmap,
    matrix,
    multiply,
    quaternion,
    rotate,
    shortest,
)
from hri_predict.predictors.neural.body import BODY

TREE = KinematicTree(BODY)


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(seed)).double()


def unit(x: torch.Tensor) -> torch.Tensor:
    return x / x.norm(dim=-1, keepdim=True)


def test_quaternion_is_equation_27():
    e = random(20, 3)
    angle = e.norm(dim=-1)
    q = quaternion(e)
    torch.testing.assert_close(q[:, 0], (angle / 2).cos())
    torch.testing.assert_close(q[:, 1:], ((angle / 2).sin() / angle)[:, None] * e)


def test_no_rotation_has_a_value_and_a_gradient():
    e = torch.zeros(2, 3, requires_grad=True)
    q = quaternion(e)
    torch.testing.assert_close(q, torch.tensor([[1.0, 0, 0, 0]] * 2))
    q.sum().backward()
    assert e.grad is not None
    torch.testing.assert_close(e.grad, torch.full((2, 3), 0.5))  # sin(a/2)/a at 0


def test_matrix_is_rodrigues_formula():
    e = random(20, 3)
    cross = torch.zeros(20, 3, 3).double()
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cross[:, j, k], cross[:, k, j] = -e[:, i], e[:, i]
    torch.testing.assert_close(matrix(e), torch.matrix_exp(cross))


def test_expmap_inverts_quaternion():
    e = random(50, 3)
    torch.testing.assert_close(expmap(quaternion(e)), e)
    torch.testing.assert_close(expmap(quaternion(torch.zeros(1, 3))), torch.zeros(1, 3))


def test_product_turns_twice():
    a, b, x = quaternion(random(9, 3)), quaternion(random(9, 3, seed=1)), random(9, 3, seed=2)
    torch.testing.assert_close(rotate(multiply(a, b), x), rotate(a, rotate(b, x)))
    torch.testing.assert_close(rotate(conjugate(a), rotate(a, x)), x)


def test_between_is_the_shortest_turn():
    a, b = unit(random(30, 3)), unit(random(30, 3, seed=1))
    q = between(a, b)
    torch.testing.assert_close(rotate(q, a), b)
    torch.testing.assert_close(expmap(q).norm(dim=-1), (a * b).sum(-1).acos())


def test_between_opposite_directions_turns_half_about_the_axis_given():
    a = unit(random(5, 3))
    torch.testing.assert_close(rotate(between(a, -a), a), -a)
    x, y = torch.tensor([1.0, 0, 0]), torch.tensor([0, 1.0, 0])
    torch.testing.assert_close(expmap(between(x, -x, y)), math.pi * y)


@pytest.mark.filterwarnings("ignore::torch.jit.TracerWarning")
def test_a_traced_copy_of_between_turns_opposite_directions_too():
    """An exported network must not depend on what the example that was traced happened to hold."""
    a, b = unit(random(5, 3)), unit(random(5, 3, seed=1))
    traced = torch.jit.trace(between, (a, b), check_trace=False)
    torch.testing.assert_close(traced(a, -a), between(a, -a))
    torch.testing.assert_close(traced(a, b), between(a, b))


def test_wraps_by_a_whole_turn_are_undone():
    angle = torch.linspace(2.0, 5.0, 40).double()  # past half a turn, and about a fixed axis
    axis = unit(random(3))
    wrapped = torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
    assert (wrapped.diff().abs() > 3).any()
    mended = shortest((wrapped[:, None] * axis)[None, :, None])[0, :, 0]
    assert mended.diff(dim=0).norm(dim=-1).max() < 0.2
    assert mended[-1].norm() <= math.pi
    torch.testing.assert_close(matrix(mended), matrix(angle[:, None] * axis))


def test_continuous_keeps_the_rotation_and_ends_shortest():
    q = quaternion(random(4, 10, 6, 3) * 2)
    result = continuous(q)
    assert ((result == q).all(-1) | (result == -q).all(-1)).all()
    assert (result[:, -1, :, 0] >= 0).all()
    assert (result[..., 0] > -0.7072).all()  # three quarters of a turn at most


def test_positions_come_back():
    rest, positions = random(28, 3), random(3, 4, 28, 3, seed=1)
    bones = TREE.bones(positions).norm(dim=-1)
    rotations = TREE.rotations(positions, rest)
    for t in range(4):
        back = TREE.positions(rotations[:, [t]], rest, bones[:, t], positions[:, [t], TREE.root])
        torch.testing.assert_close(back, positions[:, [t]])


def test_a_body_turned_as_a_whole_has_turned_at_the_root_alone():
    rest = random(28, 3)
    e = torch.tensor([0.1, -0.2, 0.8]).double()
    turned = (rest @ matrix(e).T)[None, None] + 3.0
    rotations = TREE.rotations(turned, rest)[0, 0]
    torch.testing.assert_close(rotations[TREE.root], e)
    others = [j for j in range(28) if j != TREE.root]
    torch.testing.assert_close(rotations[others], torch.zeros(27, 3).double(), atol=1e-7, rtol=0)


def test_a_bent_elbow_is_the_swing_of_the_forearm():
    rest = random(28, 3)
    wrist, elbow = BODY.index("l_wrist"), BODY.index("l_elbow")
    below = [j for j in range(28) if TREE.ancestors[wrist, j]]
    e = torch.linalg.cross(unit(rest[wrist] - rest[elbow]), unit(random(3, seed=3)))
    bent = rest.clone()
    bent[below] = (rest[below] - rest[elbow]) @ matrix(e).T + rest[elbow]
    rotations = TREE.rotations(bent[None, None], rest)[0, 0]
    torch.testing.assert_close(rotations[wrist], e)
    others = [j for j in range(28) if j != wrist]
    assert rotations[others].abs().max() < 1e-7


def test_bone_lengths_are_the_median_of_what_was_observed():
    positions = random(2, 5, 28, 3)
    observed = torch.ones(2, 5, 28, dtype=torch.bool)
    observed[0, 3:, 4] = False
    observed[1, :, 7] = False
    lengths = TREE.lengths(positions, observed)
    parent = BODY.parents[4]
    bone = (positions[0, :3, 4] - positions[0, :3, parent]).norm(dim=-1)
    torch.testing.assert_close(lengths[0, 4], bone.median())
    never = (positions[1, -1, 7] - positions[1, -1, BODY.parents[7]]).norm()
    torch.testing.assert_close(lengths[1, 7], never)
    assert lengths[0, TREE.root] == 0


def test_a_rotation_is_known_with_all_joints_above_it():
    observed = torch.ones(1, 1, 28, dtype=torch.bool)
    elbow = BODY.index("l_elbow")
    observed[..., elbow] = False
    known = TREE.known(observed)[0, 0]
    lost = {BODY.joints[j] for j in range(28) if not known[j]}
    assert lost == {"l_elbow", "l_wrist", "l_knuckles", "l_hand", "l_thumb"}
    observed[..., BODY.index("r_hip")] = False  # tells the root's orientation
    assert not TREE.known(observed).any()


def test_offsets_hang_on_their_parents_rotation():
    chain = make_skeleton("chain", list("abc"), [-1, 0, 1])
    offsets = torch.tensor([[9.0, 9, 9], [1, 0, 0], [0, 2, 0]])
    e = random(1, 1, 3, 3).float()
    root, first = matrix(e[0, 0, 0]), matrix(e[0, 0, 1])
    b = root @ offsets[1]
    expected = torch.stack([torch.zeros(3), b, b + root @ first @ offsets[2]])
    found = KinematicTree(chain).offsets_positions(e, offsets)[0, 0]
    torch.testing.assert_close(found, expected)


def test_degenerate_bodies_stay_finite():
    rotations = TREE.rotations(torch.zeros(1, 2, 28, 3), torch.zeros(28, 3))
    assert rotations.isfinite().all()


def test_a_forest_is_refused():
    forest = make_skeleton("forest", list("ab"), [-1, -1])
    with pytest.raises(PredictorError, match="forest has 2 roots"):
        KinematicTree(forest)
