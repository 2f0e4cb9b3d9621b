"""A ROS 2 link with faults, and the sample subscriber; how soon it stops, ``bench`` measures."""

from dataclasses import replace

import pytest

pytest.importorskip("rclpy", reason="needs the extra ros2, or a sourced ROS 2 installation")

from hri_sim.fault_table.ros2_link import CASES, SILENT_MS, Ros2Cell

pytestmark = [pytest.mark.realtime, pytest.mark.long]

BUSY_MS = 500.0
"""Allowance for a busy machine."""


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_the_follower_stops_by_every_fault_that_silences_the_node_and_goes_on_after_it(case):
    limit_ms = None if case.limit_ms is None else SILENT_MS + BUSY_MS
    outcome = Ros2Cell(replace(case, limit_ms=limit_ms)).run(case.name)
    assert outcome.fine, outcome
