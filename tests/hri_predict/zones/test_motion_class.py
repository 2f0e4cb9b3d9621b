"""Speed classes: the trunk's speed tells people apart, and no speed seen counts as slow."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.zones.human_speed import joint_velocities
from hri_predict.zones.motion_class import (
    BRISK_M_S,
    SPEED_CLASSES,
    STILL_M_S,
    speed_class,
    trunk_speed,
)

RATE_HZ = 25.0
ARMS = [JOINTS.index(f"{side}_{n}") for side in "lr" for n in ("elbow", "wrist", "hand")]


def walk(velocity=(0.0, 0.0, 0.0), steps=15, seed=1):
    """One body that moves in one piece, (1, T, J, 3) and (1, T, J)."""
    body = np.random.default_rng(seed).normal(size=(len(JOINTS), 3))
    along = np.arange(steps)[:, None, None] / RATE_HZ * np.array(velocity)
    return (body + along)[None], np.ones((1, steps, len(JOINTS)), bool)


def speed_of(history, observed):
    return trunk_speed(joint_velocities(history, observed, RATE_HZ), CANONICAL)[0]


@pytest.mark.parametrize(
    ("speed", "wanted"),
    [
        (0.0, "still"),
        (0.39, "still"),
        (0.4, "slow"),
        (0.99, "slow"),
        (1.0, "brisk"),
        (5.0, "brisk"),
    ],
)
def test_limits_belong_to_the_upper_class(speed, wanted):
    assert (STILL_M_S, BRISK_M_S) == (0.4, 1.0)
    assert SPEED_CLASSES[speed_class(np.array([speed]))[0]] == wanted


def test_who_has_no_known_speed_is_slow():
    assert speed_class(np.array([np.nan, 0.0, 0.5, 1.0, np.inf])).tolist() == [1, 0, 1, 2, 2]


@given(st.floats(0, 5), st.floats(0, 2))
def test_more_speed_is_never_a_slower_class(speed, more):
    slower, faster = speed_class(np.array([speed, speed + more]))
    assert faster >= slower


def test_speed_of_a_body_in_one_piece():
    assert speed_of(*walk((0.3, 0.0, 0.4))) == pytest.approx(0.5)
    assert speed_of(*walk()) == pytest.approx(0.0, abs=1e-12)


def test_limbs_do_not_count():
    history, observed = walk()
    history[:, :, ARMS] += np.arange(15)[None, :, None, None] * 0.1
    assert speed_of(history, observed) == pytest.approx(0.0, abs=1e-12)


def test_velocities_are_averaged_as_vectors_over_the_joints_that_are_measured():
    # who turns on the spot has shoulders that move apart: the trunk's velocity is zero
    history, observed = walk()
    left, right = JOINTS.index("l_shoulder"), JOINTS.index("r_shoulder")
    turn = np.arange(15)[None, :, None] * np.array([0.04, 0.0, 0.0])  # 1 m/s
    history[:, :, left] += turn
    history[:, :, right] -= turn
    assert speed_of(history, observed) == pytest.approx(0.0, abs=1e-12)
    observed[:, :, right] = False  # six joints are left, one of them at 1 m/s
    assert speed_of(history, observed) == pytest.approx(1 / 6)


def test_a_source_of_arms_alone_has_its_shoulders_for_a_trunk():
    history, observed = walk((0.6, 0.0, 0.0))
    seen = [JOINTS.index(f"{side}_{n}") for side in "lr" for n in ("shoulder", "elbow", "wrist")]
    only = np.zeros_like(observed)
    only[:, :, seen] = True
    assert speed_of(history, only) == pytest.approx(0.6)
    only[:, :, [JOINTS.index("l_shoulder"), JOINTS.index("r_shoulder")]] = False
    assert np.isnan(speed_of(history, only))  # arms alone say nothing of the trunk: slow


def test_nobody_observed_has_no_speed():
    history, observed = walk((1.0, 0.0, 0.0))
    assert np.isnan(speed_of(history, np.zeros_like(observed)))
    observed[:, :-1] = False  # a single step
    assert np.isnan(speed_of(history, observed))


@given(st.integers(0, 2**32 - 1), st.floats(0, 6))
def test_rigid_motion_of_the_room_changes_nothing(seed, speed):
    rng = np.random.default_rng(seed)
    away = rng.normal(size=3)
    history, observed = walk(speed * away / np.linalg.norm(away))
    history = history + rng.normal(0, 0.01, history.shape)
    observed &= rng.random(observed.shape) < 0.8
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    moved = history @ turn.T + rng.normal(0, 3, 3)
    assert speed_of(moved, observed) == pytest.approx(speed_of(history, observed), nan_ok=True)
