"""A controller's restart, in real processes: the arm stops, and goes on without anybody's help."""

import pytest

from hri_sim.fault_table.controller_restart import restart_controller

NEAR = [{"start": [2.3, 0.2], "script": [{"do": "wait", "seconds": 60.0}]}]


@pytest.mark.realtime
@pytest.mark.long
def test_the_arm_stops_and_goes_on_when_the_controller_is_back():
    restart = restart_controller("monitor", NEAR)
    assert 0 < restart.stopped_s <= restart.stands_s
    assert restart.moved_again_s > 0
    assert restart.clear == 0
    assert sum(restart.levels.values()) > 0
