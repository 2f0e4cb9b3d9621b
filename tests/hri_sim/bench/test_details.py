"""The benches of one thing each: their JSON, measured on the real thing, and what they refuse."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError
from hri_sim.bench.command import app


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


@pytest.mark.long
@pytest.mark.realtime
def test_costs_of_the_fleet_link():
    pytest.importorskip("zenoh", reason="zenoh is an extra")
    done = CliRunner().invoke(app, ["fleet", "--seconds", "1", "--json"])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    assert [(row["by"], row["rate_hz"]) for row in rows] == [
        (by, rate_hz) for by in ("router", "peer") for rate_hz in (25.0, 100.0)
    ]
    for row in rows:
        assert 0 < row["heard"] <= row["sent"] == row["rate_hz"]
        assert 0 < row["latency_us"]["p50"] <= row["latency_us"]["p99"] <= row["latency_us"]["max"]


@pytest.mark.long
@pytest.mark.realtime
def test_delays_of_rtde_modbus_and_opcua():
    pytest.importorskip("pymodbus", reason="pymodbus is an extra")
    done = CliRunner().invoke(app, ["plants", "--seconds", "1", "--json"])
    assert done.exit_code == 0, done.output
    rows = json.loads(done.stdout)
    links = ["rtde", "modbus", "opcua", "modbus_client", "opcua_client"]
    assert [row["link"].split(",")[0] for row in rows] == links
    for row in rows:
        assert 0 < row["heard"] <= row["sent"]
        latency = row["latency_ms"]
        assert 0 < latency["p50"] <= latency["p99"] <= latency["max"]


@pytest.mark.long
@pytest.mark.realtime
def test_a_page_of_cells_as_json():
    pytest.importorskip("zenoh", reason="zenoh is an extra")
    done = CliRunner().invoke(app, ["fleet", "--cells", "3", "--seconds", "6", "--json"])
    assert done.exit_code == 0, done.output
    row = json.loads(done.stdout)
    assert (row["cells"], row["unshown"]) == (3, 0)
    assert row["changes"] >= 3  # each cell's level, once in five seconds
    for name in ("number_ms", "change_ms"):
        assert 0 < row[name]["p50"] <= row[name]["p99"] <= row[name]["max"]
    assert min(row["cpu_s_per_s"].values()) >= 0
    assert row["cpu_s_per_s"]["fleet"] > 0


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


@pytest.mark.long
def test_a_case_as_json():
    arguments = ["trackers", "--only", "coco17 none", "--walks", "1", "--json"]
    done = CliRunner().invoke(app, [*arguments, "--predictor", "constant_velocity"])
    assert done.exit_code == 0, done.output
    (row,) = json.loads(done.stdout)
    assert (row["tracker"], row["noise"], row["walks"]) == ("coco17", "none", 1)
    assert row["ticks"] > 100
    assert 0 <= row["unlike_percent"] <= 100
    assert row["ratio"] == pytest.approx(row["predictive_m_s"] / row["iso_m_s"], rel=0.01)
    assert row["clear_too_near"] == row["contacts"] == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ("links --ticks event", "--ticks event: give fixed or capture"),
        ("links --people 17", "--people 17: give 1 to 16"),
        ("links --rate 240", "--rate 240: give 10 to 100"),
        ("links --rate 11 --ticks capture", "--rate 11: give 12.5 to 100"),
        ("fleet --seconds 0", "give 1 to 3600"),
        ("fleet --cells 3 --recovery 2", "--recovery: has no effect with --cells"),
        ("predictors --seconds 0", "give 1 to 600"),
        ("predictors --predictor sin", "did you mean 'sinn'"),
        ("trackers --only coco18", "coco17 white 2 cm"),
    ],
)
def test_what_cannot_be_measured_is_refused_in_one_line(arguments, words):
    done = CliRunner().invoke(app, arguments.split())
    assert isinstance(done.exception, ConfigError)
    assert words in str(done.exception)
    assert "\n" not in str(done.exception)
