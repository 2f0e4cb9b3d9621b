"""Resident memory of a node on the virtual clock stays flat, in a process of its own."""

import json
import subprocess
import sys

import pytest

RUN = """
import json
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.bench.faults import _MemoryView
view = _MemoryView(90.0)
run(baseline_demo(), Options(factor=None, duration_s=210.0, view=view))
print(json.dumps(view.memory.growth()))
"""
"""Two minutes of what ``bench memory`` measures for an hour, after one and a half to warm up."""


@pytest.mark.long
@pytest.mark.timeout(600)
def test_memory_stays_flat():
    command = [sys.executable, "-c", RUN]
    done = subprocess.run(command, capture_output=True, text=True, timeout=580)
    assert done.returncode == 0, done.stderr
    # 0.6 % measured: buffers that are not full yet; 2 % in two minutes are 35 kB/s
    assert json.loads(done.stdout)["growth_percent"] < 2
