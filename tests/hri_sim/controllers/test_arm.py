"""The simulated arm against closed forms of uniform acceleration on a one-joint arm."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_sim.controllers.arm import SimulatedArm

MS = 1_000_000
LENGTH = 1.0


class OneJoint:
    """A link of 1 m that turns about one joint: its tip moves at |qd| metres a second."""

    def tip_speed(self, q, qd):
        return np.abs(qd[..., 0]) * LENGTH


class Turning:
    """Turns at 1 rad/s for ever (one cycle: one turn)."""

    duration_s = 2 * math.pi

    def at(self, t_s):
        t = np.asarray(t_s, float)[..., None]
        return t, np.ones_like(t)


class Swinging:
    """Swings to and fro: it stands at both ends for a moment."""

    duration_s = 4.0
    w = 2 * math.pi / 4.0

    def at(self, t_s):
        angle = self.w * np.asarray(t_s, float)[..., None]
        return -np.cos(angle), self.w * np.sin(angle)


class Dwelling:
    """Swings for 2 s, then stands for 1 s."""

    duration_s = 3.0

    def at(self, t_s):
        t = np.minimum(np.asarray(t_s, float)[..., None] % 3.0, 2.0)
        speed = np.where(t < 2.0, math.pi * np.sin(math.pi * t), 0.0)
        return 1 - np.cos(math.pi * t), speed


def moved(arm, permitted, seconds, start_ns=0, period_ns=8 * MS):
    """Run it and return (times, joint angles unwrapped by path, tip speeds)."""
    rows = []
    now = start_ns
    while now <= start_ns + seconds * 1e9:
        arm.step(now, permitted(now * 1e-9) if callable(permitted) else permitted)
        _q, qd = arm.joints()
        rows.append((now * 1e-9, arm.path_s, abs(qd[0])))
        now += period_ns
    return np.array(rows)


def arm_on(path, deceleration_m_s2, acceleration_m_s2=None, **more):
    """One joint on a path; it accelerates as it brakes, unless told otherwise."""
    return SimulatedArm(
        model=OneJoint(),
        trajectory=path,
        deceleration_m_s2=deceleration_m_s2,
        acceleration_m_s2=acceleration_m_s2 or deceleration_m_s2,
        **more,
    )


def test_it_stands_until_permitted():
    arm = arm_on(Turning(), 2.0, 1.0)
    rows = moved(arm, 0.0, 1.0)
    assert arm.at_rest
    assert np.all(rows[:, 1:] == 0.0)


def test_it_accelerates_uniformly_to_full_speed():
    rows = moved(arm_on(Turning(), 2.0, 0.5), 10.0, 4.0)
    np.testing.assert_allclose(rows[:, 2], np.minimum(0.5 * rows[:, 0], 1.0), atol=1e-9)


def test_it_stops_in_the_time_and_distance_of_uniform_deceleration():
    arm = arm_on(Turning(), 2.0, rate=1.0)
    rows = moved(arm, 0.0, 1.0, period_ns=MS)
    assert arm.at_rest
    np.testing.assert_allclose(rows[-1, 1], 1.0**2 / (2 * 2.0), rtol=1e-3)  # v^2 / 2a
    first_at_rest = rows[np.argmax(rows[:, 2] == 0), 0]
    assert first_at_rest == pytest.approx(1.0 / 2.0, abs=2e-3)  # v / a


def test_it_obeys_a_speed_limit_and_never_exceeds_it_once_reached():
    rows = moved(arm_on(Swinging(), 3.0, rate=1.0), 0.25, 30.0)
    settled = rows[rows[:, 0] > 1.6 / 3.0]
    assert settled[:, 2].max() == pytest.approx(0.25, abs=2e-3)


@pytest.mark.parametrize("path", [Swinging(), Dwelling()])
@pytest.mark.parametrize("limit", [0.02, 0.3, 10.0])
def test_it_passes_turning_points_and_dwells_at_every_limit(path, limit):
    arm = arm_on(path, 2.0)
    steps = np.diff(moved(arm, limit, 400.0, period_ns=40 * MS)[:, 1])
    assert np.sum(steps < 0) >= 1  # went round at least once


@pytest.mark.parametrize("path", [Swinging(), Dwelling(), Turning()])
def test_at_full_permission_it_becomes_the_trajectory_itself(path):
    arm = arm_on(path, 20.0, rate=1.0)
    rows = moved(arm, 100.0, 5.0)
    apart = np.abs(rows[:, 1] - rows[:, 0]) % path.duration_s
    np.testing.assert_allclose(np.minimum(apart, path.duration_s - apart), 0.0, atol=1e-6)


@given(
    start=st.floats(0, 4),
    deceleration=st.floats(0.5, 20),
    period_ms=st.integers(1, 50),
)
def test_a_stop_from_anywhere_takes_at_most_speed_over_deceleration(start, deceleration, period_ms):
    path = Swinging()
    arm = arm_on(path, deceleration, 1.0, path_s=start, rate=1.0)
    arm.step(0, 0.0)
    before = arm.path_s
    governed = max(abs(path.at(start)[1][0]), 0.05 * arm.peak_speed_m_s)
    stop_s = governed / deceleration + 0.002
    travelled, speeds, now = 0.0, [], 0
    while now < (stop_s + 0.1) * 1e9:
        now += period_ms * MS
        arm.step(now, 0.0)
        travelled += (arm.path_s - before) % path.duration_s
        before = arm.path_s
        speeds.append((now * 1e-9, abs(arm.joints()[1][0])))
    assert arm.at_rest
    assert all(speed == 0 for t, speed in speeds if t > stop_s)
    # never faster than the ramp from the governed speed
    assert all(s <= max(governed - deceleration * t, 0) + 0.01 for t, s in speeds)


def test_the_same_steps_give_the_same_bits():
    def run():
        arm = arm_on(Swinging(), 3.0, 1.0)
        return moved(arm, lambda t: abs(math.sin(t)), 10.0).tobytes()

    assert run() == run()


@pytest.mark.parametrize("absurd", [math.nan, -1.0, -math.inf])
def test_an_absurd_permission_stops_it(absurd):
    arm = arm_on(Turning(), 2.0, rate=1.0)
    moved(arm, absurd, 1.0)
    assert arm.at_rest


def test_time_that_stands_or_runs_back_moves_nothing():
    arm = arm_on(Turning(), 2.0, rate=1.0)
    arm.step(100 * MS, 1.0)
    arm.step(100 * MS, 1.0)
    arm.step(50 * MS, 1.0)
    assert arm.path_s == 0.0
