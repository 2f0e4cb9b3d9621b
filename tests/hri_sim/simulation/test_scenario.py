"""Scenarios follow from their seed, and pass through the robot's workspace."""

import numpy as np
import pytest

from hri_predict.base.geometry import transform
from hri_sim.simulation.approach import over_floor
from hri_sim.simulation.motion import load_motion
from hri_sim.simulation.scenario import ENTER_M, _start_m, draw


def motion():
    return load_motion("procedural:1", 30.0)


def drawn(cell, seed, index):
    return draw(seed=seed, index=index, motions=[motion()], workspace=cell.workspace, lead_in_s=3.0)


def test_the_same_seed_and_number_give_the_same_scenario_and_others_do_not(cell):
    assert drawn(cell, 3, 5) == drawn(cell, 3, 5)
    places = {drawn(cell, seed, index).places for seed in (3, 4) for index in (5, 6)}
    assert len(places) == 4


@pytest.mark.parametrize("index", range(12))
def test_a_joint_passes_through_the_workspace_and_the_start_is_outside(cell, index):
    scenario = drawn(cell, 0, index)
    joints = transform(over_floor(scenario.places[0]), motion().positions)
    x, y, radius, low, high = cell.workspace.rounds[0]
    inside = np.hypot(joints[..., 0] - x, joints[..., 1] - y) <= radius
    inside &= (joints[..., 2] >= low) & (joints[..., 2] <= high)
    assert inside.any()
    start_m = _start_m(motion(), scenario.places[0], cell.workspace)
    assert start_m > 0
    assert (scenario.lead_in_s == 3.0) == (start_m >= ENTER_M)
    np.testing.assert_allclose(joints[..., 2], motion().positions[..., 2])  # nobody is lifted


def test_phases_fill_the_cycle(cell):
    phases = [drawn(cell, 0, index).phase_s for index in range(40)]
    assert min(phases) < 0.2 * cell.workspace.cycle_s
    assert max(phases) > 0.8 * cell.workspace.cycle_s
    assert max(phases) < cell.workspace.cycle_s


def test_the_workspace_holds_every_point_that_the_gripper_visits(cell):
    trajectory = cell.trajectories[0]
    q, _ = trajectory.at(np.linspace(0, trajectory.duration_s, 77))
    capsules = cell.models[0].capsules(q)
    tip = capsules.b[:, -1]
    x, y, radius, low, high = cell.workspace.rounds[0]
    assert (np.hypot(tip[:, 0] - x, tip[:, 1] - y) <= radius).all()
    assert ((tip[:, 2] >= low) & (tip[:, 2] <= high)).all()
