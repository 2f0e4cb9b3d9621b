"""The counters that a recording has once a second."""

from types import SimpleNamespace
from typing import Any

from hri_predict.run import config as configuration
from hri_predict.run.serving import Serving
from tests.hri_predict.operation.service.cells import cell, written


def test_recordings_count_late_ticks_and_forecasts(tmp_path):
    """Otherwise ``explain`` could not name a machine that was too slow."""
    serving = Serving(configuration.load(written(tmp_path, cell())), None, None)
    names = "scenes_in", "frames_in", "assess_failures", "listener_failures", "strange_states"
    counts = dict.fromkeys((*names, "acknowledges", "acknowledges_refused"), 0)
    node = SimpleNamespace(**counts, robot_counters={})
    prediction = SimpleNamespace(counters={"predictor_late": 3, "predictor_failures": 0})
    assembly: Any = SimpleNamespace(node=node, links=(), prediction=prediction)
    counters = serving.recorded(assembly)
    serving.pace.late_ticks, serving.pace.missed_ticks = 5, 7
    own = counters()["node"]
    assert (own["late_ticks"], own["missed_ticks"], own["predictor_late"]) == (5, 7, 3)
    assert own["scenes_in"] == 0
