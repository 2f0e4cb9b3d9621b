"""Ranges of speeds and first errors, and who is outside of them."""

import numpy as np
import pytest

from hri_predict.base.skeleton import CANONICAL
from hri_predict.zones.human_speed import joint_velocities
from hri_predict.zones.motion_ranges import (
    MAX_RATIO_SHORT,
    MAX_SPEED_M_S,
    MotionRanges,
    bounded,
    is_out_of_range,
    motion_ranges,
    short_ratio,
)

RATE_HZ = 25.0
JOINTS = len(CANONICAL.joints)
BODY = np.random.default_rng(2).normal(0, 0.4, (JOINTS, 3))
MARGIN = 1.2


def window(body=BODY, velocity=(1.0, 0.0, 0.0), steps=25):
    time = np.arange(1 - steps, 1) / RATE_HZ
    history = body + time[:, None, None] * np.asarray(velocity)
    return history[None], np.ones((1, steps, JOINTS), bool)


def calibrated():
    history, observed = window()
    return motion_ranges(history, observed, RATE_HZ, ratio_short=1.0)


def out(seen, limits):
    history, observed = seen
    velocities = joint_velocities(history, observed, RATE_HZ)
    return bool(is_out_of_range(velocities, limits, speed_margin=MARGIN)[0])


def test_ranges_are_the_extremes_and_unknown_where_never_measured():
    slow, seen = window(velocity=(0.5, 0.0, 0.0))
    fast, _ = window(velocity=(0.0, 2.0, 0.0))
    seen = np.concatenate([seen, seen])
    seen[:, :, 8] = False
    found = motion_ranges(np.concatenate([slow, fast]), seen, RATE_HZ, ratio_short=1.5)
    np.testing.assert_allclose(found.speed_m_s[np.arange(JOINTS) != 8], 2.0)
    assert np.isnan(found.speed_m_s[8])
    assert found.ratio_short == 1.5


@pytest.mark.parametrize(("speed", "expected"), [(1.25, True), (1.15, False)])
def test_one_joint_too_fast_is_out_of_range(speed, expected):
    limits = calibrated()
    velocity = np.tile([1.0, 0.0, 0.0], (JOINTS, 1))
    velocity[8] = [0.0, speed, 0.0]
    assert out(window(velocity=velocity), limits) is expected


@pytest.mark.parametrize("scale", [0.7, 1.4])
def test_the_size_of_a_body_says_nothing(scale):
    limits = calibrated()
    assert not out(window(body=scale * BODY), limits)


@pytest.mark.parametrize("unknown", [np.nan, np.inf])
def test_nothing_known_is_never_exceeded(unknown):
    assert not out(window(velocity=(9.0, 0, 0)), MotionRanges(np.full(JOINTS, unknown), 1.0))


def test_short_ratio_is_the_upper_median_of_the_judged():
    ratio = np.array([[1.0, 5.0, 3.0, np.inf], [1.0, 2.0, -np.inf, -np.inf], [9.0] * 4])
    judged = np.array([[True, True, True, False], [True, True, False, False], [False] * 4])
    np.testing.assert_array_equal(short_ratio(ratio, judged), [3.0, 2.0, np.nan])
    assert short_ratio(np.zeros((0, 4)), np.zeros((0, 4), bool)).shape == (0,)


def test_ranges_that_are_stored_are_never_so_wide_that_nothing_is_outside():
    found = bounded({"wrist": 1e6, "hip": 3.0}, 1e9)
    assert found == {
        "speed_m_s": {"wrist": MAX_SPEED_M_S, "hip": 3.0},
        "ratio_short": MAX_RATIO_SHORT,
    }
    assert bounded({}, 0.0)["ratio_short"] > 0.0
