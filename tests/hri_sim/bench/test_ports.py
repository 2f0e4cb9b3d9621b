"""``bench ports``: what a receiver's counts say, and both cells for a moment with real programs."""

import json
import subprocess
import sys
from importlib.util import find_spec

import pytest

from hri_predict.protocol.registers import NOT_AVAILABLE
from hri_sim.bench import ports

PERIOD_NS = 40_000_000  # 25 Hz


def test_skipped_heartbeats_are_lost_and_the_counter_wraps():
    beats = [65_533, 65_534, 65_535, 0, 3]
    found = ports._polled([(k * PERIOD_NS, beat, 50 + k) for k, beat in enumerate(beats)])
    assert (found["heard"], found["lost"]) == (5, 2)
    assert found["deviation_ms"]["max"] == 0.0
    assert found["age_ms"] == {"p50": 52.0, "p99": 54.0, "max": 54.0}


def test_an_age_that_is_not_available_is_none():
    found = ports._polled([(k * PERIOD_NS, k, NOT_AVAILABLE) for k in range(3)])
    assert found["age_ms"] is None


@pytest.mark.parametrize("minutes", ["0", "nan", "-1", "9999"])
@pytest.mark.long
def test_a_time_that_is_out_of_range_is_refused(minutes):
    command = [sys.executable, "-m", "hri_predict", "bench", "ports", f"--minutes={minutes}"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert "--minutes" in done.stderr


@pytest.mark.realtime
@pytest.mark.skipif(find_spec("rclpy") is None, reason="needs the extra ros2")
def test_each_port_hears_the_node():
    command = [sys.executable, "-m", "hri_predict", "bench", "ports", "--minutes", "0.05"]
    done = subprocess.run(
        [*command, "--predictor", "zero_velocity", "--json"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    rows = json.loads(done.stdout)
    assert len(rows) == 7
    assert all(row["heard"] > 10 for row in rows)
    assert set(rows[0]["seconds_at"]) & {"slow", "stop"}  # two people stand near the robot
