"""Bones tell people of different height apart, and never one person from himself."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.skeleton import JOINTS
from hri_predict.people.build import is_same_build
from hri_sim.people.body import Body

LIMBS = np.array([name[0] in "lr" and name[1] == "_" for name in JOINTS])


def bodies(height_m, noise_m, seed, count=20, heading=0.0):
    who = Body(height_m)
    joints = who.joints(who.standing(np.array([1.0, 2.0]), heading))
    return joints + np.random.default_rng(seed).normal(0.0, noise_m, (count, len(JOINTS), 3))


@given(
    height_m=st.floats(1.5, 2.0), noise_m=st.floats(0.0, 0.02), seed=st.integers(0, 999),
    heading=st.floats(-3, 3),
)  # fmt: skip
def test_a_person_is_the_same_in_any_direction_and_with_noise(height_m, noise_m, seed, heading):
    before = bodies(height_m, noise_m, seed)
    after = bodies(height_m, noise_m, seed + 1000, 1, heading)[0]
    seen = np.ones((20, len(JOINTS)), dtype=bool)
    assert is_same_build(before, seen, after, seen[0])


@pytest.mark.parametrize("noise_m", [0.0, 0.004])
@pytest.mark.parametrize("heights_m", [(1.6, 1.85), (1.9, 1.62)])
def test_a_person_of_another_height_is_somebody_else(heights_m, noise_m):
    before, after = bodies(heights_m[0], noise_m, 1), bodies(heights_m[1], noise_m, 2, 1)[0]
    seen = np.ones((20, len(JOINTS)), dtype=bool)
    assert not is_same_build(before, seen, after, seen[0])


@pytest.mark.parametrize("count", [1, 4])
def test_a_few_captures_prove_nothing(count):
    before, after = bodies(1.6, 0.004, 1, count), bodies(1.9, 0.004, 2, 1)[0]
    seen = np.ones((count, len(JOINTS)), dtype=bool)
    assert is_same_build(before, seen, after, seen[0])


def test_without_limbs_in_both_nothing_is_known():
    before, after = bodies(1.6, 0.0, 1), bodies(1.9, 0.0, 2, 1)[0]
    seen = np.ones((20, len(JOINTS)), dtype=bool)
    assert is_same_build(before, seen, after, ~LIMBS)
