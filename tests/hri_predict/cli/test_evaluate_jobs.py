"""``evaluate`` and ``calibrate`` in two processes print what one process prints."""

import json

import pytest

from tests.hri_predict.cli.test_calibrate import walking


@pytest.fixture
def folder(tmp_path):
    place = tmp_path / "walks"
    place.mkdir()
    for seed in range(3):
        walking(place / f"walking_{seed}.npz", seed)
    return place


@pytest.mark.long
@pytest.mark.parametrize("words", [["evaluate"], ["calibrate", "--check"]])
def test_two_processes_give_the_same_json(cli, folder, words):
    asked = [*words, "--data", folder, "--predictor", "constant_velocity", "--json"]
    one, two = cli(*asked), cli(*asked, "--jobs", 2)
    assert one[0] == 0, one[2]
    assert json.loads(one[1])["results" if words == ["evaluate"] else "coverage"]
    assert two[:2] == one[:2]
