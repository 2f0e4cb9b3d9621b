"""What ``check`` says about the engines that compute the networks."""

from types import SimpleNamespace

import pytest

from hri_predict.cli.check.zones import engine_facts, engine_lines, loops_line
from hri_predict.predictors.ensemble import AverageSettings
from hri_predict.predictors.neural.settings import NeuralSettings

ONNX = SimpleNamespace(name="onnxruntime", differs_m=2e-6, why="")
TORCH = SimpleNamespace(name="torch", differs_m=0.0, why="torch is requested")
AVERAGE = SimpleNamespace(members=[SimpleNamespace(engine=ONNX), SimpleNamespace(engine=TORCH)])


@pytest.mark.parametrize(
    ("predictor", "settings", "networks"),
    [
        (AVERAGE, AverageSettings(name="average", members=("mixer", "sinn")), ["mixer", "sinn"]),
        (AVERAGE.members[0], NeuralSettings(name="stb"), ["stb"]),
        (AVERAGE, NeuralSettings(name="own"), ["own", "own"]),  # a third party's, with members
        (object(), NeuralSettings(name="own"), []),
    ],
)
def test_each_network_is_named(predictor, settings, networks):
    facts = engine_facts(predictor, settings)
    assert [fact["network"] for fact in facts] == networks
    for name, line in zip(networks, engine_lines(facts), strict=True):
        assert line.startswith(f"network {name}: computed by ")


def test_the_hint_for_compiled_loops_fits_the_installation(monkeypatch):
    room = "hri_predict.cli.check.zones"
    monkeypatch.setattr(f"{room}.why_not_compiled", lambda: "pip install 'hri-predict[accel]'")
    monkeypatch.setattr(f"{room}.for_this_installation", lambda text: f"here: {text}")
    assert loops_line().endswith("because here: pip install 'hri-predict[accel]'")
