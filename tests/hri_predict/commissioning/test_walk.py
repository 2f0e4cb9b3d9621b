"""A walk is recorded once, and played again as often as anybody likes."""

import re
from dataclasses import replace

import pytest

from hri_predict.base.errors import RecordingError
from hri_predict.commissioning.compare import compare
from hri_predict.commissioning.playback import grid_of, play, read_rows, write_rows
from hri_predict.commissioning.walk import ADVICES, RECORDING, WalkPlan, judge_walk, walk
from hri_predict.operation.evidence.chain import file_hash
from tests.hri_predict.commissioning.cells import cell_data, load_cell
from tests.hri_predict.commissioning.test_compare import ROW

PLAN = WalkPlan(seconds=3.0, cell_m=0.25, least_coverage=0.01, virtual=True)


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    folder = tmp_path_factory.mktemp("walk")
    config = load_cell(folder, cell_data(risk={"mode": "iso"}))
    return config, folder, walk(config, config, PLAN, folder)


def again(walked, least_coverage=PLAN.least_coverage, **risk):
    config, folder, result = walked
    result = result.model_copy(update={"least_coverage": least_coverage})
    changed = config.node.risk.model_copy(update=risk)
    config = replace(config, node=config.node.model_copy(update={"risk": changed}))
    played = play(config, folder / result.recording, grid_of(config, 0.25, []))
    return compare(result, read_rows(folder / ADVICES), played)


@pytest.mark.long
def test_somebody_is_seen_on_the_way_and_the_files_have_their_hashes(walked):
    _, folder, result = walked
    assert judge_walk(result) == ([], [])
    assert 0.01 < result.grid.coverage < 0.2
    assert result.recording_sha256 == file_hash(folder / result.recording)
    assert result.advices_sha256 == file_hash(folder / result.advices)
    (robot,) = result.robots
    assert sum(robot.ticks_at.values()) == len(read_rows(folder / ADVICES))
    assert robot.stops >= 1
    assert robot.least_separation_m < 0.5


def test_the_same_version_and_configuration_give_the_same(walked):
    found = again(walked)
    assert (found.worse, found.other) == ([], [])


@pytest.mark.long
def test_a_second_walk_takes_the_place_of_the_first(walked, tmp_path):
    config, folder, _ = walked
    for name in (RECORDING, ADVICES):
        (tmp_path / name).write_bytes((folder / name).read_bytes() + b"of an earlier walk")
    result = walk(config, config, PLAN, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([RECORDING, ADVICES])
    assert result.recording_sha256 == file_hash(tmp_path / RECORDING)
    assert result.advices_sha256 == file_hash(tmp_path / ADVICES)


def test_a_smaller_margin_is_less_safe_and_a_larger_one_is_not(walked):
    found = again(walked, person_uncertainty_m=0.0)
    assert "a higher speed limit" in found.worse[0]
    found = again(walked, person_uncertainty_m=0.15)
    assert found.worse == []
    assert any("a lower speed limit" in line for line in found.other)


def test_a_stricter_cell_of_which_too_little_was_walked_is_told_apart_from_less_safety(walked):
    _, _, result = walked
    found = again(walked, least_coverage=0.9, intrusion_m=0.3)
    assert found.worse == []
    (line,) = found.unwalked
    cells, seen = re.findall(r"(\d+)[^>]* -> (\d+)", line)
    assert int(cells[0]) == len(result.grid.area) < int(cells[1])
    assert 0 < int(seen[0]) < int(cells[0])
    assert "the walk asks for 90 %: walk again" in line
    enough = again(walked, intrusion_m=0.3)  # of which a hundredth was asked for
    assert enough.unwalked == []
    assert any("floor around the robots:" in line for line in enough.other)


def test_too_little_floor_or_people_lost_fail_and_no_advice_is_open(walked):
    _, _, result = walked
    failed, _ = judge_walk(result.model_copy(update={"least_coverage": 0.9, "people_lost": 2}))
    assert "the minimum is 90 %" in failed[0]
    assert "people vanished in view 2 times" in failed[1]
    assert judge_walk(result.model_copy(update={"robots": []}))[1]
    blind = result.robots[0].model_copy(update={"ticks_at": {"unknown": 75}})
    assert (
        "advice was unknown 100 % of the time"
        in judge_walk(result.model_copy(update={"robots": [blind]}))[1][0]
    )


def test_advices_are_read_as_they_were_written(tmp_path):
    rows = [ROW, replace(ROW, time_s=0.04, separation_m=None)]
    write_rows(tmp_path / "rows", rows)
    assert read_rows(tmp_path / "rows") == rows


@pytest.mark.parametrize("text", ["{", "[]\n", '{"robot": "arm"}\n', "\xff"])
def test_advices_that_are_none_are_refused_in_one_line(tmp_path, text):
    (tmp_path / "rows").write_text(text, encoding="latin-1")
    with pytest.raises(RecordingError, match="walk again"):
        read_rows(tmp_path / "rows")
    with pytest.raises(RecordingError, match="walk again"):
        read_rows(tmp_path / "none")
