"""A run never records over what it reads."""

import dataclasses
import logging
import os
from pathlib import Path

import numpy as np
import pytest
import yaml

from hri_predict.base.errors import ConfigError, RecordingError
from hri_predict.base.files import data_path
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, run
from hri_sim.baseline_demo import BASELINE


@pytest.fixture
def played(tmp_path):
    path = tmp_path / "walk.npz"
    positions = np.zeros((3, 38, 3))
    positions[1] = np.nan
    np.savez(path, positions_world=positions, fps=30.0)
    return path


def _config(folder: Path, path: str, **more: object) -> configuration.Config:
    data = yaml.safe_load(data_path("demo.yaml").read_text(encoding="utf-8"))
    data["predictor"] = BASELINE
    data["source"] = {"kind": "recording", "path": path}
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(data | more), encoding="utf-8")
    return configuration.load(file)


def _refused(config: configuration.Config, record: Path | None, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        run(config, Options(factor=None, until_exhausted=True, record=record))


@pytest.mark.parametrize("name", ["walk.npz", "./walk.npz", "link.npz", "hard.npz"])
def test_the_recording_that_is_played(tmp_path, played, name):
    before = played.read_bytes()
    (tmp_path / "link.npz").symlink_to(played)
    os.link(played, tmp_path / "hard.npz")
    _refused(_config(tmp_path, "walk.npz"), tmp_path / name, "this recording is being played")
    assert played.read_bytes() == before


def test_the_recording_that_is_played_named_in_the_configuration(tmp_path, played):
    config = _config(tmp_path, str(played), record="walk.npz")
    _refused(config, None, "this recording is being played")


def test_the_recording_that_is_found_where_the_user_is(tmp_path, played, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "cell"
    folder.mkdir()
    _refused(_config(folder, "walk.npz"), Path("walk.npz"), "this recording is being played")


@pytest.mark.parametrize("where", ["option", "key"])
def test_the_configuration(tmp_path, played, where):
    config = _config(tmp_path, "walk.npz", **({"record": "cell.yaml"} if where == "key" else {}))
    record = tmp_path / "cell.yaml" if where == "option" else None
    _refused(config, record, "is the configuration")
    assert configuration.load(config.path).text == config.text


def test_a_recording_that_is_there_is_not_lost(tmp_path, played):
    config, monday = _config(tmp_path, "walk.npz"), tmp_path / "monday.mcap"
    run(config, Options(factor=None, until_exhausted=True, record=monday))
    before = monday.read_bytes()
    options = Options(factor=None, until_exhausted=True, record=monday)
    with pytest.raises(
        RecordingError, match=r"monday\.mcap: already exists, and is kept; .*--over"
    ):
        run(config, options)
    assert monday.read_bytes() == before
    summary = run(config, dataclasses.replace(options, overwrite=True))
    assert summary.recording is not None
    assert summary.recording["error"] is None


def test_a_node_that_starts_again_records_beside_the_file_of_its_configuration(
    tmp_path, played, caplog
):
    config = _config(tmp_path, "walk.npz", record="day.mcap")
    found = []
    for _ in range(3):
        run(config, Options(factor=None, until_exhausted=True))
        found.append(sorted(path.name for path in tmp_path.glob("*.mcap")))
    assert found[-1] == ["day-2.mcap", "day-3.mcap", "day.mcap"]
    assert "day.mcap: already exists, and is kept; recording" in caplog.text


def test_a_folder_that_is_named_on_the_command_line_is_recorded_into(tmp_path, played):
    folder = tmp_path / "kept"
    folder.mkdir()
    config = _config(tmp_path, "walk.npz", record={"folder": "elsewhere", "name": "press"})
    run(config, Options(factor=None, until_exhausted=True, record=folder))
    assert [path.name for path in folder.glob("*.mcap")] == ["press-19700101T000001Z.mcap"]
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize(
    ("record", "why"), [(None, "nothing is recorded"), ("kept", "kept is a folder")]
)
def test_overwriting_without_a_file_is_an_error(tmp_path, played, record, why):
    config = _config(tmp_path, "walk.npz")
    asked = None if record is None else tmp_path / record
    options = Options(factor=None, until_exhausted=True, record=asked, overwrite=True)
    with pytest.raises(ConfigError, match=f"--overwrite: has no effect, because .*{why}; leave"):
        run(config, options)
    assert not list(tmp_path.rglob("*.mcap"))


def test_a_name_too_long_is_one_line(tmp_path, played):
    with pytest.raises(RecordingError, match="File name too long"):
        run(
            _config(tmp_path, "walk.npz"),
            Options(factor=None, until_exhausted=True, record=tmp_path / ("a" * 300)),
        )


def test_what_is_wrong_with_a_recording_is_said_once(tmp_path, played, caplog):
    run(_config(tmp_path, "walk.npz"), Options(factor=None, until_exhausted=True))
    notes = [r for r in caplog.records if "no joint is known" in r.getMessage()]
    assert [r.levelno for r in notes] == [logging.WARNING]
