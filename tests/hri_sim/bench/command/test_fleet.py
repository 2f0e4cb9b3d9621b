"""``bench fleet`` measures the real link over zenoh."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import ConfigError
from hri_sim.bench.command.bench import app


@pytest.mark.long
@pytest.mark.realtime
def test_costs_as_json():
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


def test_a_time_out_of_range_is_refused():
    done = CliRunner().invoke(app, ["fleet", "--seconds", "0"])
    assert isinstance(done.exception, ConfigError)
    assert "give 1 to 3600" in str(done.exception)


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


def test_cells_and_recovery_are_two_benches():
    done = CliRunner().invoke(app, ["fleet", "--cells", "3", "--recovery", "2"])
    assert isinstance(done.exception, ConfigError)
    assert "--recovery: has no effect with --cells" in str(done.exception)
