"""``bench predictors`` measures each engine with the same people, and says how far they differ."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError
from hri_sim.bench.command.bench import app


@pytest.mark.realtime
def test_engines_as_json():
    pytest.importorskip("onnxruntime", reason="ONNX Runtime is not installed")
    asked = ["--predictor", "mixer", "--predictor", "zero_velocity", "--people", "2"]
    done = CliRunner().invoke(app, ["predictors", *asked, "--seconds", "1", "--json"])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    assert [(row["predictor"], row["engine"]) for row in rows] == [
        ("mixer", "torch"),
        ("mixer", "onnxruntime"),
        ("zero_velocity", "–"),
    ]
    for row in rows:
        assert 0 < row["p50_ms"] <= row["p99_ms"] <= row["max_ms"]
        assert (row["people"], row["forecasts"]) == (2, 25)
        assert 0 <= row["differs_mm"] < 0.1
    assert 0 < rows[0]["floor_ms"] == rows[1]["floor_ms"] < rows[1]["p50_ms"]
    assert rows[2]["floor_ms"] is None
    assert rows[1]["differs_mm"] > 0  # it is not torch twice


@pytest.mark.parametrize(
    ("asked", "told"),
    [(["--seconds", "0"], "give 1 to 600"), (["--predictor", "sin"], "did you mean 'sinn'")],
)
def test_wrong_options_are_refused(asked, told):
    done = CliRunner().invoke(app, ["predictors", *asked])
    assert isinstance(done.exception, ConfigError)
    assert told in str(done.exception)
