"""The arm behind the made-up RTDE controller: as fast as the slider says, and stopped when told."""

import numpy as np
import pytest

from hri_sim.rtde.arm import NORMAL, PAUSED, PLAYING, PROTECTIVE_STOP, RAMP_PER_S, SWING, Arm

STEP_S = 0.002


def moved(arm, seconds, since_s=0.0):
    """Move on in steps; return (F, 6) positions, and the velocities, after each of them."""
    at, speeds = [], []
    for k in range(1, round(seconds / STEP_S) + 1):
        arm.step(since_s + k * STEP_S, STEP_S)
        at.append(arm.positions)
        speeds.append(arm.velocities)
    return np.array(at), np.array(speeds)


@pytest.mark.parametrize("slider", [1.0, 0.3])
def test_its_velocities_are_how_its_positions_change(slider):
    arm = Arm(watchdog_s=0.0)
    arm.move_slider(slider)
    at, speeds = moved(arm, 3.0)
    changes = (at[2:] - at[:-2]) / (2 * STEP_S)
    # A position is curved by at most the ramp's acceleration, which changes once.
    np.testing.assert_allclose(changes, speeds[1:-1], atol=2 * RAMP_PER_S * STEP_S * max(SWING))
    assert np.abs(speeds).max() == pytest.approx(slider * max(SWING), rel=0.1)


def test_a_slider_that_jumps_from_0_stops_it_for_good():
    arm = Arm(watchdog_s=0.0)
    for fraction in (0.0, 0.05, 0.5):  # by steps
        arm.move_slider(fraction)
    assert arm.safety_mode == NORMAL
    arm.move_slider(0.0)
    arm.move_slider(0.5)
    assert arm.safety_mode == PROTECTIVE_STOP
    _, speeds = moved(arm, 1.0)
    assert not speeds[-1].any()


@pytest.mark.parametrize(("level", "state"), [(1, PLAYING), (3, PLAYING), (0, PAUSED), (4, PAUSED)])
def test_with_a_watchdog_it_moves_only_at_a_level_that_permits_it(level, state):
    arm = Arm(watchdog_s=0.1)
    arm.hear(1, level, 0.0)
    moved(arm, 0.05)
    assert arm.runtime_state == state


def test_it_pauses_when_the_watchdog_register_stands_still():
    arm = Arm(watchdog_s=0.1)
    arm.hear(1, 1, 0.0)
    moved(arm, 0.09)
    assert arm.runtime_state == PLAYING
    arm.hear(1, 1, 0.09)  # heard, but nothing new
    moved(arm, 0.02, since_s=0.09)
    assert arm.runtime_state == PAUSED
    arm.hear(2, 1, 0.11)
    moved(arm, 0.01, since_s=0.11)
    assert arm.runtime_state == PLAYING
