"""Loops and arrays permit the same speeds, and after the warm-up nothing is compiled."""

import json
import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.risk import permitted
from hri_predict.risk.separation.in_time import farthest
from tests.hri_predict.risk.separation.curves import constant
from tests.processes import python

MARGINS = st.lists(st.floats(0, 1), min_size=1, max_size=4).map(np.array)
WAYS = [permitted.any_way, permitted._any_way_by_loops]
STANDARDS = [permitted.by_standard, permitted._by_standard_by_loops]


@pytest.mark.parametrize("any_way", WAYS)
@settings(max_examples=25)
@given(
    distance=st.lists(st.floats(-1, 4) | st.just(-np.inf), min_size=3, max_size=3),
    reaction_s=st.floats(0.01, 0.6),
    clearance=st.floats(0, 0.3),
    margins=MARGINS,
)
def test_any_direction(any_way, distance, reaction_s, clearance, margins):
    far = farthest(constant(3.0, 1.0), np.array([0.0, 0.2, 0.4, 0.8]), reaction_s)
    given_m = np.array(distance), far, clearance, margins
    by_loops, by_arrays = any_way(*given_m), permitted._any_way_by_arrays(*given_m)
    assert by_loops[0] == by_arrays[0]
    assert by_loops[1].tolist() == by_arrays[1].tolist()


@pytest.mark.parametrize("by_standard", STANDARDS)
@given(
    deceleration=st.floats(0.5, 30),
    reaction_s=st.floats(0.01, 0.6),
    terms=st.tuples(st.floats(0, 0.3), st.sampled_from([0.0, 1.0, 3.0, np.inf])),
    distances=st.lists(st.floats(-0.5, 4), min_size=1, max_size=4).map(np.array),
)
def test_the_standard(by_standard, deceleration, reaction_s, terms, distances):
    given_m = constant(deceleration).arrays, reaction_s, terms, distances
    by_loops, by_arrays = by_standard(*given_m), permitted._by_standard_by_arrays(*given_m)
    assert by_loops[0] == by_arrays[0]
    assert by_loops[1].tolist() == by_arrays[1].tolist()


RUN = """
import inspect, json, sys
from dataclasses import replace
from hri_sim.bench import parts
from hri_predict.base.machine.compiled import is_compiled

zones, judge = parts.risk_calls()
engine = inspect.getclosurevars(judge).nonlocals["engine"]
engine._separation.warm_up()
compiled = []
if is_compiled():
    from numba.core.dispatcher import Dispatcher
    compile = Dispatcher.compile
    Dispatcher.compile = lambda self, sig: compiled.append(str(self)) or compile(self, sig)
judge()
before = list(compiled)
said = []
for tick in range(parts._WALK_TICKS):
    snapshot, forecast = parts._walkers(tick)
    snapshot = replace(snapshot, captures=tick + 1)
    for advice in engine.assess(snapshot, forecast).advices:
        said.append([advice.level.name, advice.reason.name, advice.body_part, advice.robot_link,
                     advice.speed_limit_m_s, advice.separation_m, advice.predicted_separation_m])
json.dump([is_compiled(), before, said], sys.stdout)
"""


def run(**environment: str):
    done = python("-c", RUN, env={**os.environ, **environment}, check=True)
    return json.loads(done.stdout)


@pytest.mark.long
def test_both_versions_advise_the_same_and_nothing_is_compiled_after_the_warm_up():
    pytest.importorskip("numba", reason="extra accel is not installed")
    compiled, by_arrays = run(), run(HRI_PREDICT_COMPILED="0")
    assert (compiled[0], by_arrays[0]) == (True, False)
    assert compiled[1] == []
    assert len({level for level, *_ in compiled[2]}) > 1  # people come near, and are judged
    for one, other in zip(compiled[2], by_arrays[2], strict=True):
        assert one[:4] == other[:4]
        # sums of the learned scale in another order: a millionth, in single precision, of at most
        # 5 m, which is far less than a step on the wire
        assert one[4:] == pytest.approx(other[4:], abs=5e-6)
