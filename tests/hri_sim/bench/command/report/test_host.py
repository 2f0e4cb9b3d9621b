"""What is said of the machine."""

import json

from hri_sim.bench.command.report import host


def test_the_machine_is_stated():
    facts = host.machine()
    assert facts["cores"] >= 1
    assert facts["processor"]
    assert facts["yardstick_us"] > 0
    assert facts["libraries"]["numpy"]
    assert json.loads(json.dumps(facts)) == facts
    assert facts["processor"] in host.described(facts)


def test_a_busy_machine_is_told():
    assert host.busy(0.5) == ""
    assert "load average 0.6, over 0.5" in host.busy(0.6)
