"""The folder of a validation keeps what was done."""

import json

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.commissioning.folder import State, load_state, save
from hri_predict.commissioning.identity import identity_of
from hri_predict.commissioning.report import read_report
from tests.hri_predict.commissioning.cells import load_cell
from tests.hri_predict.commissioning.test_report import step


def test_what_was_saved_is_there_again(tmp_path):
    config = load_cell(tmp_path)
    state = load_state(tmp_path / "out", config)
    assert state == State(cell="cell.yaml")
    state = state.with_step("walk", step(identity=identity_of(config).hash))
    report, digest = save(tmp_path / "out", config, state)
    assert load_state(tmp_path / "out", config) == state
    assert read_report(tmp_path / "out" / "report.json") == (report, digest)
    assert digest in (tmp_path / "out" / "report.html").read_text()


@pytest.mark.parametrize("text", ["", "{", "[]", '{"cell": 1}', '{"cell": "cell.yaml", "x": 1}'])
def test_a_broken_state_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "state.json").write_text(text)
    with pytest.raises(ConfigError, match="give another --out") as refused:
        load_state(tmp_path, load_cell(tmp_path))
    assert "\n" not in str(refused.value)


def test_another_cells_folder_is_refused(tmp_path):
    (tmp_path / "state.json").write_text(json.dumps({"cell": "other.yaml"}))
    with pytest.raises(ConfigError, match=r"holds the validation of other\.yaml"):
        load_state(tmp_path, load_cell(tmp_path))
