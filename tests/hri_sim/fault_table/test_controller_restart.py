"""A controller's restart, in real processes: the arm stops, and goes on without anybody's help."""

import pytest

from hri_sim.fault_table.node_death import restart_controller

NEAR = [{"start": [2.3, 0.2], "script": [{"do": "wait", "seconds": 60.0}]}]


@pytest.mark.realtime
@pytest.mark.long
def test_the_arm_stops_and_goes_on_when_the_controller_is_back():
    restart = restart_controller("restart", "monitor", NEAR)
    assert restart.measured_ms is not None
    assert 0 < restart.measured_ms <= restart.counted.pop("arm_stands_ms") + 1
    assert restart.recovered_ms is not None
    assert restart.recovered_ms > 0
    assert restart.clear_while_near == 0
    assert sum(restart.counted.values()) > 0
