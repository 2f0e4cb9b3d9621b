"""A run with compiled loops and one without advise the same."""

import json
import os

import pytest

from tests.processes import python

RUN = """
import json
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE

class Watch(View):
    def __init__(self):
        self.rows = []

    def on_tick(self, tick):
        for a in tick.advices:
            self.rows.append((a.level.name, a.reason.name, a.separation_m, a.speed_limit_m_s))

watch = Watch()
loaded = configuration.load(configuration.shipped("demo.yaml")).quiet().with_predictor(**BASELINE)
run(loaded, Options(factor=None, view=watch, duration_s=7.0))
print(json.dumps(watch.rows))
"""


def advice(compiled):
    done = python("-c", RUN, env=os.environ | {"HRI_PREDICT_COMPILED": compiled}, check=True)
    return json.loads(done.stdout)


@pytest.mark.realtime
def test_a_run_with_compiled_loops_advises_what_one_without_does():
    pytest.importorskip("numba", reason="extra accel is not installed")
    with_loops, without = advice("1"), advice("0")
    assert len(with_loops) > 150
    assert len({row[0] for row in without}) > 1  # the robot is slowed
    for ours, theirs in zip(with_loops, without, strict=True):
        assert ours[:2] == theirs[:2]
        assert ours[2:] == pytest.approx(theirs[2:], abs=1e-3)  # 1 mm and 1 mm/s
