"""A replay with the live cell's configuration leaves what belongs to the live cell alone."""

import sys
from pathlib import Path

import pytest
import yaml

from hri_predict.base.errors import LinkError
from hri_predict.base.files import data_path
from hri_predict.cli.run import replay
from hri_sim.baseline_demo import BASELINE
from tests.hri_predict.recording.mcap.test_format1 import PATH

pytestmark = pytest.mark.realtime  # commands run in real time only


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    """A configuration that would leave traces wherever a live cell leaves some."""
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    command = [sys.executable, "-c", f"open({str(tmp_path / 'ran')!r}, 'w')"]
    data |= {
        "predictor": BASELINE,
        "people": {},
        "risk": {"mode": "iso"},
        "alerts": {"file": "alerts.jsonl", "command": command, "terminal": False},
        "record": {"folder": "recordings"},
        "evidence": "evidence",
        "state": "state.json",
    }
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


def _replay(cell: Path, alerts: bool = False) -> set[str]:
    """What is in the cell's folder after a replay of a second, at five times the speed."""
    replay(recording=PATH, config=cell, speed="5", no_links=True, as_json=True, alerts=alerts)
    return {path.name for path in cell.parent.iterdir()}


def test_nothing_of_the_live_cell_is_touched(cell):
    assert _replay(cell) == {"cell.yaml"}


def test_alerts_are_written_and_commands_run_only_when_asked_for(cell):
    assert _replay(cell, alerts=True) == {"cell.yaml", "alerts.jsonl", "ran"}


def test_it_says_to_which_real_links_it_sends(cell, capsys):
    data = yaml.safe_load(cell.read_text(encoding="utf-8"))
    data["links"] = [{"name": "drive", "kind": "serial", "port": "absent", "baudrate": 921600}]
    cell.write_text(yaml.safe_dump(data), encoding="utf-8")
    with pytest.raises(LinkError, match="absent"):
        replay(recording=PATH, config=cell, speed="5", as_json=True)
    assert "replay: sends to drive, like a live cell; --no-links" in capsys.readouterr().err
