"""Reasons are steady: the milder of two waits, a stricter one and another level do not."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.steady_reason import SteadyReason

NEAR, APPROACHING = Reason.PERSON_NEAR, Reason.PERSON_APPROACHING
PENDING = Reason.RELEASE_PENDING


def given_for(reasons, level=Level.STOP, captures=3):
    steady = SteadyReason(captures)
    return [steady.update(level, reason, k) for k, reason in enumerate(reasons)]


def changes(values):
    return sum(a != b for a, b in itertools.pairwise(values))


def test_alternating_reasons_give_the_stricter():
    assert given_for([APPROACHING, NEAR] * 50) == [APPROACHING] + [NEAR] * 99


def test_the_milder_is_given_after_enough_captures():
    assert given_for([NEAR, *[APPROACHING] * 4]) == [NEAR] * 3 + [APPROACHING] * 2


def test_repeated_captures_do_not_count():
    steady = SteadyReason(3)
    assert steady.update(Level.STOP, NEAR, 0) is NEAR
    for _ in range(10):
        assert steady.update(Level.STOP, APPROACHING, 1) is NEAR


def test_each_return_of_the_stricter_doubles_the_wait():
    found = given_for(([NEAR] + [APPROACHING] * 9) * 20)
    assert changes(found) <= 5  # 3, 6 and 12 captures: the third time it stays


def test_of_several_milder_reasons_the_severest_is_given():
    assert given_for([NEAR, PENDING, APPROACHING, PENDING])[-1] is APPROACHING


def test_another_level_brings_its_reason_at_once():
    steady = SteadyReason(3)
    steady.update(Level.STOP, NEAR, 0)
    assert steady.update(Level.SLOW, PENDING, 1) is PENDING
    assert steady.update(Level.STOP, APPROACHING, 2) is APPROACHING


@pytest.mark.parametrize("fault", [Reason.INPUT_STALE, Reason.PERSON_LOST, Reason.LATCHED])
def test_a_fault_is_given_and_replaced_at_once(fault):
    assert given_for([NEAR, fault, APPROACHING]) == [NEAR, fault, APPROACHING]


@given(st.lists(st.sampled_from([NEAR, APPROACHING, PENDING, Reason.NONE]), min_size=1))
def test_it_is_never_milder_than_the_tick_s_own_reason(reasons):
    order = [Reason.NONE, PENDING, APPROACHING, NEAR]
    for own, found in zip(reasons, given_for(reasons), strict=True):
        assert order.index(found) >= order.index(own)


@given(st.integers(0, 1000))
def test_noise_at_a_threshold_changes_it_seldom(seed):
    # 10 s at 30 Hz of a person at the edge of "too close", with 2 cm of noise about it
    noise = np.random.default_rng(seed).normal(0.0, 0.02, 300)
    found = given_for([NEAR if n < 0 else APPROACHING for n in noise], captures=15)
    assert changes(found) <= 2
