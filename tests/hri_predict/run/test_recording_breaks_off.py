"""A run whose recording breaks off goes on, and says so at the end."""

import json
import os
from unittest import mock

import numpy as np
import pytest
import typer
import yaml

from hri_predict.base.files import data_path
from hri_predict.cli.run import replay
from hri_sim.baseline_demo import BASELINE

TAKEN = 20_000  # bytes


def test_a_full_disk_is_said_and_ends_in_status_1(tmp_path, capsys):
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    config = tmp_path / "cell.yaml"
    config.write_text(yaml.safe_dump(data | {"predictor": BASELINE}), encoding="utf-8")
    walk = tmp_path / "walk.npz"
    bodies = np.random.default_rng(0).normal(0, 0.01, (40, 38, 3))
    np.savez(walk, positions_world=bodies, fps=30.0)
    left = [TAKEN]

    def full(descriptor: int, data: bytes) -> int:
        if left[0] <= 0:
            raise OSError(28, "No space left on device")
        left[0] -= len(data)
        return write(descriptor, data)

    write = os.write
    with (
        mock.patch("hri_predict.recording.mcap.file.os.write", side_effect=full),
        pytest.raises(typer.Exit) as ended,
    ):
        replay(
            recording=walk,
            config=config,
            speed="max",
            record=tmp_path / "run.mcap",
            no_links=True,
            as_json=True,
        )
    assert ended.value.exit_code == 1
    said = capsys.readouterr()
    summary = json.loads(said.out)
    assert summary["ticks"] > 30  # it went on
    assert summary["recording"]["written"] > 0
    assert summary["recording"]["dropped"] > 0
    assert summary["recording"]["error"] == "No space left on device"
    assert "incomplete: No space left on device" in said.err
