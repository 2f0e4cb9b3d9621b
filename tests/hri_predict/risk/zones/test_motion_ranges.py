"""Ranges of speeds, bones and first errors, and who is outside of them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.risk.zones.human_speed import joint_velocities
from hri_predict.risk.zones.motion_ranges import (
    MotionRanges,
    bone_lengths,
    is_out_of_range,
    motion_ranges,
    short_ratio,
)
from hri_predict.skeleton import CANONICAL, PARENTS

RATE_HZ = 25.0
JOINTS = len(CANONICAL.joints)
BODY = np.random.default_rng(2).normal(0, 0.4, (JOINTS, 3))
MARGIN, TOLERANCE = 1.2, 0.2


def window(body=BODY, velocity=(1.0, 0.0, 0.0), steps=25):
    time = np.arange(1 - steps, 1) / RATE_HZ
    history = body + time[:, None, None] * np.asarray(velocity)
    return history[None], np.ones((1, steps, JOINTS), bool)


def bones_of(history, observed):
    return bone_lengths(history, observed, RATE_HZ, PARENTS)


def ranges():
    history, observed = window()
    return motion_ranges(history, observed, RATE_HZ, PARENTS, ratio_short=1.0)


def out(history, observed, limits=None):
    limits = limits or ranges()
    velocities = joint_velocities(history, observed, RATE_HZ)
    bones = bones_of(history, observed)
    return bool(
        is_out_of_range(velocities, bones, limits, speed_margin=MARGIN, bone_tolerance=TOLERANCE)[0]
    )


def test_bones_are_distances_to_the_parents():
    lengths = bones_of(*window())[0]
    assert np.isnan(lengths[0])
    expected = [np.linalg.norm(BODY[j] - BODY[PARENTS[j]]) for j in range(1, JOINTS)]
    np.testing.assert_allclose(lengths[1:], expected)


def test_bones_are_means_over_what_was_seen_of_the_last_400_ms():
    history, observed = window(velocity=(0.0, 0.0, 0.0))
    elbow, shoulder = CANONICAL.index("l_elbow"), CANONICAL.index("l_shoulder")
    history[0, :, elbow] = history[0, :, shoulder]
    history[0, -10:, elbow, 2] += np.linspace(0.1, 1.0, 10)  # mean of the last ten: 0.55
    history[0, :-10, elbow] += 50.0
    assert bones_of(history, observed)[0, elbow] == pytest.approx(0.55)
    observed[0, -10:-2, elbow] = False
    history[0, -10:-2, elbow] = np.nan
    assert bones_of(history, observed)[0, elbow] == pytest.approx(0.95)
    observed[0, :, shoulder] = False
    assert np.isnan(bones_of(history, observed)[0, elbow])


def test_ranges_are_the_extremes_and_unknown_where_never_measured():
    slow, seen = window(velocity=(0.5, 0.0, 0.0))
    fast, _ = window(body=1.1 * BODY, velocity=(0.0, 2.0, 0.0))
    seen = np.concatenate([seen, seen])
    seen[:, :, 8] = False
    found = motion_ranges(np.concatenate([slow, fast]), seen, RATE_HZ, PARENTS, ratio_short=1.5)
    bones = bones_of(*window())[0]
    known = np.arange(JOINTS) != 8
    np.testing.assert_allclose(found.speed_m_s[known], 2.0)
    np.testing.assert_allclose(found.bone_m[1:][known[1:], 0], bones[1:][known[1:]])
    np.testing.assert_allclose(found.bone_m[1:][known[1:], 1], 1.1 * bones[1:][known[1:]])
    assert np.isnan(found.speed_m_s[8])
    assert np.isnan(found.bone_m[[0, 8]]).all()
    assert found.ratio_short == 1.5


@pytest.mark.parametrize(("scale", "expected"), [(1.4, True), (0.7, True), (1.15, False)])
def test_a_wrong_body_scale_is_out_of_range(scale, expected):
    assert out(*window(body=scale * BODY)) is expected


@pytest.mark.parametrize(("speed", "expected"), [(1.25, True), (1.15, False)])
def test_one_joint_too_fast_is_out_of_range(speed, expected):
    velocity = np.tile([1.0, 0.0, 0.0], (JOINTS, 1))
    velocity[8] = [0.0, speed, 0.0]
    # bones are measured on the same window: the hand's alone changes
    assert out(*window(velocity=velocity)) is expected


def test_nothing_known_is_never_exceeded():
    for bones in ((np.nan, np.nan), (0.0, np.inf)):
        for speed in (np.nan, np.inf):
            limits = MotionRanges(np.full(JOINTS, speed), np.tile(bones, (JOINTS, 1)), 1.0)
            history, observed = window(body=3 * BODY, velocity=(9.0, 0, 0))
            assert not out(history, observed, limits)


@given(st.floats(-np.pi, np.pi), st.lists(st.floats(-50, 50), min_size=3, max_size=3))
def test_place_and_heading_change_nothing(angle, shift):
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    )
    moved = BODY @ turn.T + shift
    lengths = bones_of(*window(body=moved, velocity=(0, 0, 0)))
    np.testing.assert_allclose(lengths, bones_of(*window(velocity=(0, 0, 0))), atol=1e-9)


def test_short_ratio_is_the_upper_median_of_the_judged():
    ratio = np.array([[1.0, 5.0, 3.0, np.inf], [1.0, 2.0, -np.inf, -np.inf], [9.0] * 4])
    judged = np.array([[True, True, True, False], [True, True, False, False], [False] * 4])
    np.testing.assert_array_equal(short_ratio(ratio, judged), [3.0, 2.0, np.nan])
    assert short_ratio(np.zeros((0, 4)), np.zeros((0, 4), bool)).shape == (0,)
