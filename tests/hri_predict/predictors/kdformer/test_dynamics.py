"""Reduced-order dynamics against the paper's recursion written out, and against physics."""

import math

import pytest
import torch

from hri_predict.base.skeleton import CANONICAL
from hri_predict.predictors.kdformer.dynamics import (
    GRAVITY,
    Dynamics,
    acceleration,
    body_parts,
    low_pass,
)
from hri_predict.predictors.kdformer.rotations import KinematicTree
from hri_predict.predictors.neural.body import BODY

RATE = 25.0
STEPS = 15
TREE = KinematicTree(BODY)


def moving(people: int = 2) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    walk = 0.01 * torch.randn(people, STEPS, 28, 3, generator=generator).cumsum(1).cumsum(1)
    return torch.randn(people, 1, 28, 3, generator=generator) + walk


def bone_lengths(positions: torch.Tensor) -> torch.Tensor:
    return TREE.lengths(positions, torch.ones(positions.shape[:3], dtype=torch.bool))


def recursion(positions: torch.Tensor, lengths: torch.Tensor, part: list[int]) -> torch.Tensor:
    """Eqs. 1 to 5 for one person as printed, joint by joint from the ends, unfiltered."""
    gravity = torch.tensor([0.0, 0.0, -GRAVITY])
    masses = lengths / lengths.sum()
    forces = torch.zeros_like(positions)
    for t in range(len(positions)):
        m = min(max(t, 1), len(positions) - 2)
        a = (positions[m - 1] + positions[m + 1] - 2 * positions[m]) * RATE**2
        for j in reversed(range(28)):  # children come after their parents
            # m a = f + m g + (reactions), the reaction of a child being minus its force
            forces[t, j] += masses[j] * (a[j] - gravity)
            parent = BODY.parents[j]
            if parent >= 0 and part[parent] == part[j]:
                forces[t, parent] += forces[t, j]
    return forces * 28 / GRAVITY


@pytest.mark.parametrize("count", [3, 5, 7])
def test_forces_are_the_papers_recursion(count):
    positions = moving()
    lengths = bone_lengths(positions)
    dynamics = Dynamics(
        skeleton=BODY, steps=STEPS, rate_hz=RATE, parts=count, cutoff_hz=RATE
    )  # no filter
    found = dynamics(positions, lengths)
    for person in range(2):
        expected = recursion(positions[person], lengths[person], body_parts(BODY, count))
        torch.testing.assert_close(found[person], expected, atol=2e-3, rtol=1e-3)


def test_standing_still_each_part_carries_its_weight():
    still = moving()[:, :1].expand(-1, STEPS, -1, -1)
    lengths = bone_lengths(still)
    forces = Dynamics(skeleton=BODY, steps=STEPS, rate_hz=RATE)(still, lengths)
    shoulder = BODY.index("l_shoulder")
    arm = lengths[:, list(BODY.parts["left_arm"])].sum(1) / lengths.sum(1)
    torch.testing.assert_close(forces[:, -1, shoulder, 2], 28 * arm, atol=1e-3, rtol=1e-3)
    assert forces[..., :2].abs().max() < 1e-3
    root = Dynamics(skeleton=BODY, steps=STEPS, rate_hz=RATE).of_root(still[:, :, 0])
    # each sum's 15 terms cancel; their sizes add up to 2630 / s^2 times the root's 1.34 m, over g,
    # and each is rounded 17 times in float32 (table, product, sum): 17 * 6e-8 * 2630 * 1.34 / 9.81
    expected = torch.tensor([0.0, 0.0, 1.0]).expand_as(root)
    torch.testing.assert_close(root, expected, rtol=0, atol=4e-4)


def test_free_fall_needs_no_force():
    t = torch.arange(STEPS) / RATE
    fall = moving()[:, :1].repeat(1, STEPS, 1, 1)
    fall[..., 2] -= 0.5 * GRAVITY * t[:, None] ** 2
    forces = Dynamics(skeleton=BODY, steps=STEPS, rate_hz=RATE)(fall, bone_lengths(fall))
    assert forces.abs().max() < 2e-2


def test_gravity_follows_the_axis_that_is_up():
    still = moving()[:, :1].expand(-1, STEPS, -1, -1)
    forces = Dynamics(skeleton=BODY, steps=STEPS, rate_hz=RATE, up="y")(still, bone_lengths(still))
    assert (forces[..., 1:, 1] > 0).all()
    assert forces[..., [0, 2]].abs().max() < 1e-3


def test_acceleration_is_central_inside_and_backward_at_the_end():
    t = torch.arange(6.0).double()
    x = t**3
    found = acceleration(6) @ x
    torch.testing.assert_close(found[1:-1], 6 * t[1:-1])
    torch.testing.assert_close(found[-1], x[5] - 2 * x[4] + x[3])
    assert not acceleration(2).any()


def test_low_pass_keeps_slow_and_stops_fast():
    t = torch.arange(200).double() / 100.0
    smooth = low_pass(200, 100.0, 6.0)

    def amplitude(hz: float) -> float:
        wave = (2 * math.pi * hz * t).sin()
        return float((smooth @ wave)[50:150].abs().max())

    assert amplitude(1.0) == pytest.approx(1.0, abs=0.01)
    assert amplitude(6.0) == pytest.approx(0.5, abs=0.02)  # 1/sqrt(2), forward and backward
    assert amplitude(25.0) < 0.01
    torch.testing.assert_close(smooth.sum(1), torch.ones(200).double())  # a constant stays


def test_low_pass_does_not_delay():
    t = torch.arange(200).double() / 100.0
    wave = (2 * math.pi * 2.0 * t).sin()
    filtered = low_pass(200, 100.0, 6.0) @ wave
    gain = 1 / (1 + (2.0 / 6.0) ** 4)  # Butterworth of second order, twice
    torch.testing.assert_close(filtered[50:150], gain * wave[50:150], atol=2e-3, rtol=0)


def test_low_pass_above_half_the_rate_does_nothing():
    torch.testing.assert_close(low_pass(5, 10.0, 6.0), torch.eye(5).double())


def test_parts_are_chains_of_the_skeletons_own():
    five, three, seven = (body_parts(BODY, n) for n in (5, 3, 7))
    assert [len(set(p)) for p in (three, five, seven)] == [3, 5, 7]
    arm = BODY.parts["left_arm"]
    assert {BODY.joints[j] for j in arm if seven[j] != seven[arm[0]]} == {
        "l_knuckles",
        "l_hand",
        "l_thumb",
    }
    assert (
        len({three[j] for name in ("torso", "left_arm", "right_arm") for j in BODY.parts[name]})
        == 1
    )
    assert len(set(body_parts(CANONICAL, 5))) == 5


def test_no_force_crosses_into_another_part():
    positions = moving()
    lengths = bone_lengths(positions)
    dynamics = Dynamics(skeleton=BODY, steps=STEPS, rate_hz=RATE)
    moved = positions.clone()
    moved[:, 5:, BODY.index("l_hand")] += 0.3
    changed = (dynamics(moved, lengths) - dynamics(positions, lengths)).abs().amax((0, 1, 3)) > 1e-3
    arm = set(BODY.parts["left_arm"])
    assert {j for j in range(28) if changed[j]} == arm - {BODY.index("l_thumb")}
