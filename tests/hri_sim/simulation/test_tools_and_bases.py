"""Closed loops of a rail, of a moving base, and of tools that change while people come."""

import pytest

from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from hri_sim.simulation.cell import Cell


@pytest.mark.parametrize(
    "name",
    [
        "simulate_mobile",
        pytest.param("simulate_rail", marks=pytest.mark.long),
        pytest.param("simulate_tools", marks=pytest.mark.long),
    ],
)
def test_nobody_is_touched(name: str) -> None:
    """One approach through the whole node; nothing that the controller says is disbelieved.

    A person may walk into a robot at rest: recorded people do not react.
    """
    config = configuration.load(configuration.shipped(f"{name}.yaml")).quiet()
    config = config.with_predictor("constant_velocity", horizon_s=1.2)
    summary = run(config, Options(factor=None))
    assert summary.min_separation_m is not None  # somebody came
    assert summary.contacts == 0
    assert "stop" in summary.ticks_at
    assert {"clear", "warn", "slow"} & set(summary.ticks_at)  # it worked, too
    doubts = {"robot_state_invalid", "robot_velocity_wrong", "robot_state_jumped"}
    assert not (doubts | {"robot_base_unknown"}) & set(summary.unknown_because)
    assert not {"robot_too_fast", "robot_stops_late"} & set(summary.counted)


def test_the_workspace_is_where_the_base_drives() -> None:
    config = configuration.load(configuration.shipped("simulate_mobile.yaml")).quiet()
    cell = Cell(config.with_predictor("constant_velocity", horizon_s=1.2))
    ((x, y, radius, low, high),) = cell.workspace.rounds
    assert -0.4 < x < 0.6
    assert abs(y) < 0.4
    assert radius > 1.2  # the drive is 1.4 m long, and the arm reaches out on both sides
    assert low < 0.1 < 1.0 < high
