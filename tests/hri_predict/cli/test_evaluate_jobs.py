"""``evaluate`` and ``calibrate`` in two processes print what one process prints."""

import json
import sys

import pytest

from hri_predict.cli import main
from tests.hri_predict.cli.test_calibrate import walking


@pytest.fixture
def cli(monkeypatch, capsys):
    """Run a command line; gives standard output."""

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["hri-predict", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        captured = capsys.readouterr()
        assert not ended.value.code, captured.err
        return captured.out

    return call


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "walks"
    place.mkdir()
    for seed in range(3):
        walking(place / f"walking_{seed}.npz", seed)
    return place


@pytest.mark.long
def test_evaluate_in_two_processes_gives_the_same_json(cli, folder):
    asked = ["evaluate", "--data", folder, "--predictor", "constant_velocity", "--json"]
    one, two = cli(*asked), cli(*asked, "--jobs", 2)
    assert json.loads(one)["results"]
    assert two == one


@pytest.mark.long
def test_calibrate_in_two_processes_gives_the_same_json(cli, folder):
    asked = ["calibrate", "--data", folder, "--predictor", "constant_velocity", "--check", "--json"]
    one, two = cli(*asked), cli(*asked, "--jobs", 2)
    assert json.loads(one)
    assert two == one
