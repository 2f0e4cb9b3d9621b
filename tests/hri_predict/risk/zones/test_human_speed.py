"""How fast people move, as measured from their history."""

import numpy as np
import pytest
from numpy.typing import ArrayLike

from hri_predict.arrays import Bools, Floats
from hri_predict.risk.settings import HumanLimits
from hri_predict.risk.zones.human_speed import (
    Velocities,
    growth_speeds,
    joint_speeds,
    joint_velocities,
    measure_people,
)
from hri_predict.skeleton import CANONICAL

RATE_HZ = 25.0
JOINTS = len(CANONICAL.joints)


def moving(velocity: ArrayLike, steps: int = 25) -> tuple[Floats, Bools]:
    """One person, every joint at ``velocity`` (3,) or (J, 3)."""
    time = np.arange(1 - steps, 1) / RATE_HZ
    start = np.random.default_rng(3).normal(size=(JOINTS, 3))
    history = start + time[:, None, None] * np.asarray(velocity)
    return history[None], np.ones((1, steps, JOINTS), bool)


def velocities(velocity: ArrayLike) -> Velocities:
    return joint_velocities(*moving(velocity), RATE_HZ)


def test_constant_velocity_is_measured_exactly():
    velocity, measured = joint_velocities(*moving([3.0, -4.0, 0.0]), RATE_HZ)
    np.testing.assert_allclose(velocity, np.tile([3.0, -4.0, 0.0], (1, JOINTS, 1)), atol=1e-12)
    assert measured.all()
    speed, _ = joint_speeds(*moving([3.0, -4.0, 0.0]), RATE_HZ)
    np.testing.assert_allclose(speed, 5.0)


def test_speed_is_the_mean_over_a_fifth_of_a_second():
    # x = a t^2 / 2 over t in [-0.2, 0]: the slope of least squares of a parabola on evenly spaced
    # points is its derivative in the middle, a x -0.1; a = 10 gives 1.0 m/s
    history, observed = moving([0.0, 0.0, 0.0])
    time = np.arange(-24, 1) / RATE_HZ
    history[0, :, 0, 0] += 10.0 * time**2 / 2
    speed, _ = joint_speeds(history, observed, RATE_HZ)
    assert speed[0, 0] == pytest.approx(1.0)


def test_noise_of_millimetres_is_no_speed():
    history, observed = moving([0.0, 0.0, 0.0])
    history = history + np.random.default_rng(1).normal(scale=0.004, size=history.shape)
    speed, _ = joint_speeds(history, observed, RATE_HZ)
    # slope of 6 points 0.04 s apart: sigma / sqrt(sum (t - mean)^2) = 0.004 / sqrt(0.028) = 24 mm/s
    assert speed.max() < 5 * 0.024 * np.sqrt(3)


@pytest.mark.parametrize("seen", [[], [-1], [-1, -2], [-5, -6]])
def test_what_was_not_observed_long_enough_is_not_measured(seen):
    history, observed = moving([1.0, 0.0, 0.0])
    observed[:, :, 4] = False
    observed[:, seen, 4] = True
    history[:, :, 4] = np.where(observed[:, :, 4, None], history[:, :, 4], np.nan)
    speed, measured = joint_speeds(history, observed, RATE_HZ)
    assert np.isfinite(speed).all()
    assert speed[0, 4] == 0
    assert not measured[0, 4]
    assert measured[0, 3]
    assert speed[0, 3] == pytest.approx(1.0)


def test_only_observed_steps_count():
    history, observed = moving([1.5, 0.0, 0.0])
    observed[:, -3] = False
    history[:, -3] = 100.0
    np.testing.assert_allclose(joint_speeds(history, observed, RATE_HZ)[0], 1.5)


def test_a_short_history_is_not_measured():
    speed, measured = joint_speeds(*moving([1.0, 0.0, 0.0], steps=2), RATE_HZ)
    assert not measured.any()
    assert not speed.any()
    speed, measured = joint_speeds(np.zeros((0, 25, JOINTS, 3)), np.zeros((0, 25, JOINTS), bool), 5)
    assert speed.shape == measured.shape == (0, JOINTS)


def test_a_runner_is_fast_and_a_walker_is_not():
    limits = HumanLimits()
    walker = measure_people(velocities([1.5, 0, 0]), CANONICAL, limits)
    runner = measure_people(velocities([3.0, 0, 0]), CANONICAL, limits)
    assert not walker.fast.any()
    assert runner.fast.all()
    assert runner.trunk[0] == pytest.approx(3.0)
    assert runner.hand[0] == pytest.approx(0.0, abs=1e-9)


def test_a_hand_counts_relative_to_the_trunk():
    limits = HumanLimits()
    velocity = np.zeros((JOINTS, 3))
    velocity[:] = [1.4, 0.0, 0.0]  # walks
    velocity[CANONICAL.index("r_wrist")] = [3.3, 0.0, 0.0]  # swings: 1.9 m/s of its own
    assert not measure_people(velocities(velocity), CANONICAL, limits).fast.any()
    velocity[CANONICAL.index("r_wrist")] = [3.5, 0.0, 0.0]
    fast = measure_people(velocities(velocity), CANONICAL, limits)
    assert fast.fast.all()
    assert fast.hand[0] == pytest.approx(2.1)
    velocity[CANONICAL.index("r_wrist")] = velocity[0]
    velocity[CANONICAL.index("l_foot")] = [6.0, 0.0, 0.0]  # feet are faster than the trunk
    assert not measure_people(velocities(velocity), CANONICAL, limits).fast.any()


def test_a_hand_counts_relative_to_the_room_where_the_trunk_is_not_seen():
    history, observed = moving([2.2, 0, 0])
    for joint in ("waist", "torso"):
        observed[:, :, CANONICAL.index(joint)] = False
    fast = measure_people(joint_velocities(history, observed, RATE_HZ), CANONICAL, HumanLimits())
    assert fast.trunk[0] == 0
    assert fast.hand[0] == pytest.approx(2.2)
    assert fast.fast.all()


def test_who_is_fast_counts_at_what_was_measured_and_a_margin():
    walker = measure_people(velocities([1.5, 0, 0]), CANONICAL, HumanLimits())
    runner = measure_people(velocities([3.0, 0, 0]), CANONICAL, HumanLimits())
    assert walker.beyond_standard_m_s.tolist() == [0.0]
    assert runner.beyond_standard_m_s == pytest.approx([3.4])


def test_zones_without_a_forecast_grow_at_least_at_the_present_speed():
    history, observed = moving([3.0, 0, 0])
    observed[:, :, 7] = False
    speeds = growth_speeds(joint_velocities(history, observed, RATE_HZ), 2.0)
    assert speeds[0, 7] == 2.0
    assert speeds[0, 6] == pytest.approx(3.0)
    assert growth_speeds(velocities([0.5, 0, 0]), 2.0).tolist() == [[2.0] * JOINTS]
