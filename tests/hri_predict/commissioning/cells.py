"""Cells for these tests: the demo with a baseline, in a folder of its own."""

import copy
from pathlib import Path
from typing import Any

import yaml

from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_predict.run.config import Config
from hri_sim.baseline_demo import BASELINE

DEMO = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
WALKER = {
    "start": [3.6, 2.4],
    "script": [{"do": "walk", "to": [1.5, 0.3]}, {"do": "wait", "seconds": 60}],
}


def cell_data(**changes: Any) -> dict[str, Any]:
    """The demo's configuration as data, with a baseline and somebody who walks up at once."""
    data: dict[str, Any] = copy.deepcopy(DEMO)
    data["predictor"] = dict(BASELINE)
    data["source"]["people"] = [copy.deepcopy(WALKER)]
    return data | changes


def write_cell(folder: Path, data: dict[str, Any] | None = None) -> Path:
    """Write a configuration; return its path."""
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(cell_data() if data is None else data), encoding="utf-8")
    return path


def load_cell(folder: Path, data: dict[str, Any] | None = None) -> Config:
    """Write and load a configuration."""
    return configuration.load(write_cell(folder, data))
