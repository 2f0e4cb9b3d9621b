"""The node with its predictor in another process: real processes, killed in mid-run."""

import json
import os
import signal
import subprocess
import threading

import pytest
import yaml

from hri_predict.contracts.predictor import PredictorSettings
from hri_predict.predictors.neural.settings import NeuralSettings
from hri_predict.protocol.messages import NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.run import assemble
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from tests.processes import python

POSE = {"xyz": [0, 0, 0], "quaternion_xyzw": [0, 0, 0, 1]}
STANDING = {"start": [2.5, 2.5], "script": [{"do": "wait", "seconds": 60}]}


def config_of(tmp_path, **predictor):
    path = tmp_path / "cell.yaml"
    data = {
        "source": {"kind": "procedural", "room_from_source": POSE, "people": [STANDING]},
        "predictor": {"horizon_s": 1.0, **predictor},
        "robots": [
            {
                "name": "arm",
                "model": "ur5e",
                "room_from_robot": POSE,
                "max_speed_m_s": 1.0,
                "motion": {"kind": "standing", "positions": [0.0] * 6},
            }
        ],
    }
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


class Killer(View):
    """Kills the worker at the 25th tick, and stops the node when it has recovered."""

    def __init__(self):
        self.seen, self.recovered = [], threading.Event()

    def bind(self, assembly):
        self.prediction = assembly.prediction

    def on_tick(self, tick):
        self.seen.append((tick.status.node_state, tick.status.reason))
        if len(self.seen) == 25:
            os.kill(self.prediction._started.process.pid, signal.SIGKILL)
        elif FAILED in self.seen[25:] and self.seen[-1][0] is NodeState.RUNNING:
            self.recovered.set()


FAILED = (NodeState.DEGRADED, Reason.PREDICTOR_FAILED)


@pytest.mark.realtime
def test_a_worker_killed_in_mid_run_degrades_the_node_which_goes_on_and_recovers(tmp_path):
    config = configuration.load(config_of(tmp_path, name="constant_velocity", process=True))
    view = Killer()
    summary = run(config.quiet(), Options(duration_s=60.0, view=view), view.recovered)
    assert view.recovered.is_set()
    assert summary.counted["predictor_restarts"] >= 1
    assert view.seen.count(FAILED) >= 2  # the ticks went on meanwhile
    assert summary.counted["predictor_failures"] >= 2


@pytest.mark.realtime
@pytest.mark.parametrize("name", ["constant_velocity", "sinn"])
def test_the_node_imports_neither_torch_nor_onnx_runtime(tmp_path, name):
    script = (
        "import sys; from hri_predict.cli import main\n"
        "try: main()\n"
        "finally: print([m for m in ('torch', 'onnxruntime') if m in sys.modules])"
    )
    path = config_of(tmp_path, name=name, process="auto" if name != "sinn" else True)
    done = python("-c", script, "run", path, "--duration", "0.5", "--json", timeout=120)
    summary, modules = done.stdout.splitlines()
    assert modules == "[]"
    assert json.loads(summary)["ticks"] > 0


def test_in_virtual_time_the_predictor_runs_in_place(tmp_path, monkeypatch):
    monkeypatch.setattr(subprocess, "Popen", None)
    config = configuration.load(config_of(tmp_path, name="constant_velocity", process=True))
    summary = run(config.quiet(), Options(factor=None, duration_s=1.0))
    assert summary.ticks == 25
    assert "predictor_failures" not in summary.counted


@pytest.mark.parametrize(
    ("settings", "cores", "expected"),
    [
        (NeuralSettings(name="sinn"), 2, True),
        (NeuralSettings(name="sinn"), 1, False),
        (NeuralSettings(name="sinn", process=False), 2, False),
        (PredictorSettings(name="kalman"), 2, False),
        (PredictorSettings(name="kalman", process=True), 1, True),
    ],
)
def test_a_network_gets_a_process_where_there_is_a_core_for_it(
    settings, cores, expected, monkeypatch
):
    monkeypatch.setattr("hri_predict.base.machine.realtime.usable_cores", lambda: set(range(cores)))
    assert assemble.has_own_process(settings) is expected


def test_an_average_takes_as_long_as_its_members(tmp_path):
    baselines = {"name": "average", "members": ["kalman", "constant_velocity"]}
    assert not configuration.load(config_of(tmp_path, **baselines)).predictor.takes_long
    networks = {"name": "average", "members": ["kalman", "stb"]}
    assert configuration.load(config_of(tmp_path, **networks)).predictor.takes_long
