"""The folder of a validation keeps what was done."""

import json

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.commissioning.folder import State, load_state, save
from hri_predict.commissioning.identity import identity_of
from hri_predict.commissioning.report import GridResult, Walk, read_report
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


@pytest.mark.parametrize(("least", "lines"), [(0.9, []), (0.0, ["walk.least_coverage: 0 (def"])])
def test_less_floor_than_by_default_is_to_be_signed(tmp_path, least, lines):
    config = load_cell(tmp_path)
    grid = GridResult(
        cell_m=1, origin=[0, 0], columns=1, rows=1, area=[0], outside=[], seen={}, lost={}
    )
    walk = Walk(
        recording="walk.mcap", recording_sha256="", advices="walk", advices_sha256="", seconds=1,
        least_coverage=least, exclude=[], grid=grid, robots=[], people_lost=0,
    )  # fmt: skip
    state = State(cell="cell.yaml").with_step("walk", step(result=walk))
    report, _ = save(tmp_path / "out", config, state)
    assert [line[:27] for line in report.less_safe if line.startswith("walk.")] == lines


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
