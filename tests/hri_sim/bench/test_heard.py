"""What is made of the messages that a receiver heard, and of a process's own counts."""

import itertools
import math
import os
import subprocess
import time

import pytest

from hri_sim.bench import cell, heard, processes

PERIOD_NS = 40_000_000  # 25 Hz


def told(status, bare=()):
    messages = [("Status", at, cycle) for at, cycle in status]
    return {"messages": messages, "bare": list(bare), "stamps": "s", "priority": "p"}


def test_even_messages_deviate_by_nothing():
    status = [(k * PERIOD_NS, k % 256) for k in range(300)]
    found = heard.figures(told(status), 0, 2**62, 25.0)
    assert found["missing"] == 0  # the cycle wraps at 256
    # times of 12 s in ms as 64-bit floats: 2e-12 ms, twice
    assert max(found["deviation_ms"]) == pytest.approx(0.0, abs=1e-9)


def test_a_late_message_deviates_twice_and_a_lost_one_is_counted():
    at_ms = [0, 40, 83, 120, 200]  # the third is 3 ms late, and cycle 4 never comes
    status = [(ms * 1_000_000, cycle) for ms, cycle in zip(at_ms, (0, 1, 2, 3, 5), strict=True)]
    found = heard.figures(told(status), 0, 2**62, 25.0)
    assert found["deviation_ms"] == pytest.approx([0.0, 3.0, 3.0, 40.0])
    assert found["missing"] == 1


def test_only_what_came_in_the_window_counts():
    status = [(k * PERIOD_NS, k) for k in range(10)]
    bare = [k * PERIOD_NS for k in range(10)]
    found = heard.figures(told(status, bare), 2 * PERIOD_NS, 5 * PERIOD_NS, 25.0)
    assert len(found["deviation_ms"]) == len(found["bare_ms"]) == 3


def test_time_of_this_process_by_group():
    before = processes.processor_time(os.getpid())
    end = time.process_time() + 0.05
    while time.process_time() < end:
        pass
    after = processes.processor_time(os.getpid())
    assert after["all"] == pytest.approx(sum(after[group] for group in processes.GROUPS))
    assert after["all"] > before["all"]


def test_memory_of_this_process_and_its_children():
    alone = processes.resident_mib(os.getpid())
    child = subprocess.Popen(["sleep", "30"])
    try:
        assert child.pid in processes.descendants(os.getpid())
        assert processes.resident_mib(os.getpid()) > alone
    finally:
        child.kill()
        child.wait()


def test_people_stand_apart_and_out_of_the_robot():
    places = cell._places(cell.MAX_PEOPLE)
    assert len(places) == 16
    assert min(math.dist(a, b) for a, b in itertools.combinations(places, 2)) > 0.9
    assert min(math.hypot(*place) for place in places) > 1.0


def test_a_cell_is_a_configuration():
    config = cell.config(people=16, robots=4, predictor="zero_velocity", joint_map="coco17")
    assert len(config.node.robots) == 4
    assert config.node.people.max_people == 16
