"""``bench links`` runs the real node on a real wire and prints what it measured."""

import json

import pytest
from typer.testing import CliRunner

from hri_predict.cli.bench.bench import app


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
        for span in ("wait_ms", "node_ms", "link_ms", "total_ms"):
            assert 0 <= row[span]["p50"] <= row[span]["p99"]
        assert row["total_ms"]["p50"] >= row["link_ms"]["p50"]
    assert len(told["load_average"]) == 2
