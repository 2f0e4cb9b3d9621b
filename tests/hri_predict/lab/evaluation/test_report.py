"""Tables and pictures of the evaluation on recordings say what was measured."""

import csv
import io
import json
import os
import re

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.lab.datasets.corruption import Corruption
from hri_predict.lab.evaluation.recordings import MEAN_ACTIONS, Errors, RecordingResult, baselines
from hri_predict.lab.evaluation.report import (
    as_csv,
    as_json,
    as_markdown,
    corruption_table,
    joint_table,
    judge_table,
    write_report,
)
from hri_predict.predictors.neural.body import BODY

JOINTS = len(BODY.joints)
MISSING = Corruption("missing", 0.3)


def errors(mm_at_1s: float, steps: int = 25) -> Errors:
    """Errors that grow evenly with the horizon, known for ``steps``."""
    count = np.zeros((25, JOINTS))
    count[:steps] = 4.0
    grown = np.arange(1, 26)[:, None] / 25 * mm_at_1s / 1000
    return Errors(4, count * grown, count)


def result(name: str, mm: float, corruption: Corruption | None = None) -> RecordingResult:
    actions = {action: errors(mm) for action in MEAN_ACTIONS}
    return RecordingResult(name, corruption, {**actions, "running": errors(2 * mm, steps=15)})


@pytest.fixture
def results():
    return [
        result("zero_velocity", 800),
        result("stb", 400),
        result("zero_velocity", 1000, MISSING),
        result("stb", 420, MISSING),
    ]


def test_the_headline_has_a_row_per_predictor_of_undisturbed_input(results):
    table = judge_table(results)
    assert table.rows[0] == ("zero_velocity", "96", "160", "320", "480", "640", "800")
    assert table.rows[1] == ("stb", "48", "80", "160", "240", "320", "400")
    assert "five actions" in table.title


def test_markdown_has_every_table_and_dashes_where_nothing_is_known(results):
    text = as_markdown(results)
    assert "| stb | 96 | 160 | 320 | 480 | – | – |" in text  # running
    assert "## walking (4 windows), mm" in text
    assert "| l_wrist |" in text
    assert "| l_hip |" not in text


def test_losses_are_relative_to_each_predictors_own_undisturbed_error(results):
    rows = {row[0]: row[1:] for row in corruption_table(results).rows}
    assert rows["none"] == ("416", "208")
    assert rows["30 % of joint-frames missing"] == ("520 (+25%)", "218 (+5%)")


def test_json_and_csv_agree(results):
    data = json.loads(json.dumps(as_json(results), allow_nan=False))
    stb = data["results"][1]
    assert stb["mean_mm"] == [48, 80, 160, 240, 320, 400]
    assert stb["actions"]["running"]["mm"] == [96, 160, 320, 480, None, None]
    assert data["losses"][1]["overall"] == pytest.approx(0.05)
    rows = list(csv.DictReader(io.StringIO(as_csv(results))))
    found = [
        float(r["error_mm"])
        for r in rows
        if (r["predictor"], r["disturbance"], r["action"], r["joint"]) == ("stb", "", "mean", "all")
    ]
    assert found == stb["mean_mm"]
    assert not [r for r in rows if r["action"] == "running" and int(r["horizon_ms"]) > 600]


def test_a_report_of_recordings_that_end_early_and_of_none_of_the_five_actions(tmp_path):
    pytest.importorskip("matplotlib")
    short = {"arms": errors(20, steps=10)}
    results = [RecordingResult("stb", None, short), RecordingResult("stb", MISSING, short)]
    assert len(write_report(results, tmp_path)) == 6
    assert judge_table(results).title == "Mean over arms, mm"
    assert corruption_table(results).rows[1] == ("30 % of joint-frames missing", "5 (+0%)")


@pytest.mark.parametrize(
    ("steps", "by_joint_ms"), [(3, [120]), (5, [200]), (10, [400]), (20, [400]), (50, [400, 1000])]
)
def test_a_report_shows_the_horizons_that_were_evaluated(tmp_path, steps, by_joint_ms):
    pytest.importorskip("matplotlib")
    count = np.ones((steps, JOINTS))
    results = [RecordingResult("stb", None, {"walking": Errors(4, 0.1 * count, count)})]
    assert len(write_report(results, tmp_path)) == 6
    text = (tmp_path / "real.md").read_text(encoding="utf-8")
    assert re.findall(r"By joint, (\d+) ms", text) == [str(ms) for ms in by_joint_ms]
    assert json.loads((tmp_path / "real.json").read_text())["horizons_ms"][-1] == {
        3: 120, 5: 200, 10: 400, 20: 800, 50: 2000
    }[steps]  # fmt: skip


def test_a_joint_table_beyond_the_horizon_has_dashes():
    count = np.ones((5, JOINTS))
    results = [RecordingResult("stb", None, {"walking": Errors(4, 0.1 * count, count)})]
    assert {row[1] for row in joint_table(results, 200).rows} == {"100"}
    assert {row[1] for row in joint_table(results, 1000).rows} == {"–"}


@pytest.mark.long
def test_a_report_is_written_and_a_folder_that_cannot_be_is_the_users_to_mend(tmp_path, results):
    pytest.importorskip("matplotlib")
    files = write_report(results, tmp_path / "new" / "folder")
    assert {f.suffix for f in files} == {".md", ".csv", ".json", ".png"}
    assert all(f.stat().st_size > 500 for f in files)
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match=r"--out .*file"):
        write_report(results, tmp_path / "file")


def test_a_report_that_cannot_be_finished_leaves_the_old_one(tmp_path, results, monkeypatch):
    (tmp_path / "real.md").write_text("old", encoding="utf-8")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(ConfigError, match="No space left on device; name another folder"):
        write_report(results, tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["real.md"]
    assert (tmp_path / "real.md").read_text(encoding="utf-8") == "old"


@pytest.mark.parametrize("actions", [1, 2, 5])
@pytest.mark.long
def test_the_legend_of_a_picture_is_inside_it(actions):
    pytest.importorskip("matplotlib")
    from hri_predict.lab.evaluation.plots import error_by_action, error_by_joint

    names = [*baselines(), "trajectorycnn", "sinn=a-file-of-mine", "stb"]
    shown = {f"walking {k}": errors(20) for k in range(actions)}
    for draw in (error_by_action, error_by_joint):
        figure = draw([RecordingResult(name, None, shown) for name in names])
        figure.savefig(io.BytesIO(), format="png")
        legend = figure.legends[0].get_window_extent()
        width, height = figure.get_size_inches() * figure.dpi
        assert legend.x0 >= 0
        assert legend.y0 >= 0
        assert legend.x1 <= width
        assert legend.y1 <= height


def test_a_line_that_ends_before_the_horizon_has_a_dash_in_the_legend():
    pytest.importorskip("matplotlib")
    from hri_predict.lab.evaluation.plots import error_by_horizon

    given = [result("zero_velocity", 800), RecordingResult("stb", None, {"x": errors(400, 15)})]
    legend = error_by_horizon(given).axes[0].get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["stb  –", "zero_velocity  800 mm"]
