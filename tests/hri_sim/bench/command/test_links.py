"""``bench links`` runs the real node on a real wire and prints what it measured."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError
from hri_sim.bench.command.bench import app


@pytest.mark.realtime
@pytest.mark.long
def test_delays_as_json():
    done = CliRunner().invoke(app, ["links", "--only", "can virtual", "--seconds", "1", "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert told["serial_wires"] == []  # no serial line was asked for
    assert [(row["link"], row["rate_hz"]) for row in told["delays"]] == [
        ("CAN virtual", 25.0),
        ("CAN virtual", 100.0),
    ]
    for row in told["delays"]:
        assert row["scenes"] > 0
        for span in ("wait_ms", "inference_ms", "node_ms", "link_ms", "total_ms"):
            assert 0 <= row[span]["p50"] <= row[span]["p99"]
        assert row["total_ms"]["p50"] >= row["link_ms"]["p50"]
    assert len(told["load_average"]) == 2


@pytest.mark.realtime
@pytest.mark.long
def test_a_tick_for_each_capture_is_measured_with_the_predictor_and_people_asked_for():
    arguments = ["--only", "can fd virtual", "--seconds", "2", "--rate", "20", "--no-wires"]
    load = ["--ticks", "capture", "--people", "3", "--predictor", "constant_velocity", "--json"]
    done = CliRunner().invoke(app, ["links", *arguments, *load])
    assert done.exit_code == 0, done.output
    (row,) = json.loads(done.stdout)["delays"]
    assert row["rate_hz"] == 20.0
    assert row["scenes"] > 10
    assert row["wait_ms"]["p50"] < 20.0  # under any load; at a fixed 20 Hz it would be 25
    assert row["inference_ms"]["p50"] > 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ticks", "event"], "--ticks event: give fixed or capture"),
        (["--people", "17"], "--people 17: give 1 to 16"),
        (["--rate", "240"], "--rate 240: give 10 to 100"),
        (["--rate", "11", "--ticks", "capture"], "--rate 11: give 12.5 to 100"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(arguments, words):
    done = CliRunner().invoke(app, ["links", *arguments])
    assert isinstance(done.exception, ConfigError)
    assert str(done.exception) == words
