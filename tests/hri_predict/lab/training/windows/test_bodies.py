"""Other bodies keep their motion: bones of constant length, joints displaced by constants."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.lab.training.windows.bodies import BodySettings, draw_bodies
from hri_predict.predictors.neural.body import BODY

COUNT, STEPS, JOINTS = 6, 30, len(BODY.joints)
EXACT_M = 1e-5  # 32-bit floats: 2e-7 m at 3 m, times a chain of ten bones and a few operations


def person(seed: int, turn: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Rigid bodies that walk along y and turn (radians in all), every joint seen."""
    rng = np.random.default_rng(seed)
    pose = rng.normal(size=(COUNT, 1, JOINTS, 3)) * 0.3
    for left, right in BODY.left_right_pairs:
        pose[:, :, right] = pose[:, :, left] * [1, -1, 1]
    pose[:, :, [BODY.index("l_hip"), BODY.index("l_shoulder")], 1] = 0.15
    pose[:, :, [BODY.index("r_hip"), BODY.index("r_shoulder")], 1] = -0.15
    angle = np.linspace(0, turn, STEPS)
    cos, sin = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y, z = np.moveaxis(np.broadcast_to(pose, (COUNT, STEPS, JOINTS, 3)), -1, 0)
    turned = np.stack([cos * x - sin * y, sin * x + cos * y, z], -1)
    turned[..., 1] += 0.04 * np.arange(STEPS)[:, None]
    return turned.astype(np.float32), np.ones((COUNT, STEPS, JOINTS), bool)


def lengths(positions: np.ndarray) -> np.ndarray:
    bones = positions[:, :, 1:] - positions[:, :, list(BODY.parents[1:])]
    result: np.ndarray = np.linalg.norm(bones, axis=-1)
    return result


@settings(max_examples=20)
@given(seed=st.integers(0, 10**6), turn=st.floats(-3, 3))
def test_a_rigid_body_stays_rigid(seed, turn):
    positions, observed = person(seed, turn)
    bodies = draw_bodies(BodySettings(share=1), np.random.default_rng(seed), COUNT)
    bones = lengths(bodies.worn(positions, observed))
    np.testing.assert_allclose(bones, bones[:, :1].repeat(STEPS, 1), atol=EXACT_M)


def test_each_bone_has_the_length_that_was_drawn():
    positions, observed = person(1)
    bodies = draw_bodies(BodySettings(share=1, joints=0), np.random.default_rng(2), COUNT)
    ratio = lengths(bodies.worn(positions, observed)) / lengths(positions)
    expected = np.broadcast_to(bodies.bones[:, None, 1:], ratio.shape)
    np.testing.assert_allclose(ratio, expected, rtol=1e-3)  # 1e-5 m of bones of 2 cm and longer


def test_lengths_spread_as_configured_and_alike_on_both_sides():
    bodies = draw_bodies(BodySettings(share=1, bones=0.1), np.random.default_rng(2), 4000)
    log = np.log(bodies.bones)
    # 0.1 and the sides' 0.03 together; a deviation of 4000 draws is known to 1.1 %
    np.testing.assert_allclose(log.std(0), np.hypot(0.1, 0.03), rtol=0.06)
    for left, right in BODY.left_right_pairs:
        assert (log[:, left] - log[:, right]).std() < 0.05


def test_shoulders_move_inwards_by_up_to_ten_centimetres():
    bodies = draw_bodies(BodySettings(share=1), np.random.default_rng(2), 4000)
    left, right = bodies.joints[:, BODY.index("l_shoulder"), 1], BODY.index("r_shoulder")
    assert -0.1 <= left.min() < -0.095
    assert 0.015 < left.max() <= 0.02
    np.testing.assert_array_equal(bodies.joints[:, right, 1], -left)


def test_displacements_turn_with_the_body():
    positions, observed = person(3, turn=np.pi)
    bodies = draw_bodies(BodySettings(share=1, bones=0), np.random.default_rng(2), COUNT)
    moved = bodies.worn(positions, observed) - positions
    np.testing.assert_allclose(moved[:, -1, :, :2], -moved[:, 0, :, :2], atol=EXACT_M)
    np.testing.assert_allclose(moved[:, 0], bodies.joints, atol=EXACT_M)


def test_longer_legs_go_further():
    positions, observed = person(4)
    bodies = draw_bodies(BodySettings(share=1), np.random.default_rng(2), COUNT)
    worn = bodies.worn(positions, observed)
    went = (worn[:, -1] - worn[:, 0])[..., 1].mean(1)
    legs = bodies.bones[:, [BODY.index(n) for n in ("l_knee", "l_ankle", "r_knee", "r_ankle")]]
    np.testing.assert_allclose(went, 0.04 * (STEPS - 1) * legs.mean(1), rtol=1e-3)


def test_the_recorded_share_keeps_its_body():
    positions, observed = person(5)
    bodies = draw_bodies(BodySettings(share=0), np.random.default_rng(2), COUNT)
    np.testing.assert_allclose(bodies.worn(positions, observed), positions, atol=EXACT_M)


@pytest.mark.parametrize("lost", ["l_knee", "pelvis", "chest"])
def test_nothing_jumps_when_a_joint_vanishes(lost):
    positions, observed = person(6)
    still = positions[:, :1].repeat(STEPS, 1)
    observed[:, STEPS // 2 :, BODY.index(lost)] = False
    bodies = draw_bodies(BodySettings(share=1), np.random.default_rng(2), COUNT)
    worn = bodies.worn(still, observed)
    step = np.abs(np.diff(worn, axis=1))[observed[:, 1:] & observed[:, :-1]]
    assert step.max() < EXACT_M
