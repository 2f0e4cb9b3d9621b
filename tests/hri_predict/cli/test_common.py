"""Tables on the screen, flags that are refused, and what ``--data`` takes as recordings."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import _fitting, recordings, without_effect
from hri_predict.lab.evaluation.table import Table

INTERVALS = Table(
    "Coverage, %",
    ("stated", *(f"{ms} ms" for ms in (120, 200, 400, 600, 800, 1000))),
    tuple((f"{p} %", *(f"{p}.0 [97.0, 100.0]" for _ in range(6))) for p in (90, 95, 99)),
)
ACTIONS = Table(
    "By action",
    ("condition", "recording", "held at 400 ms", "with self-check", "widened", "unlike"),
    tuple(("camera shifted by 20 cm after 1.46 s", f"walking_extra_{k}", *4 * ["100.0"])
          for k in range(9)),
)  # fmt: skip


def lines(table: Table, width: int) -> list[str]:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(_fitting(table, console))
    return console.export_text().splitlines()


@pytest.mark.parametrize("width", [80, 120, 200])
@pytest.mark.parametrize("table", [INTERVALS, ACTIONS])
def test_no_word_is_cut_or_broken(table: Table, width: int) -> None:
    shown = lines(table, width)
    assert all(len(line) <= width for line in shown)
    words = " ".join(shown).split()
    for cell in (*table.columns, *(cell for row in table.rows for cell in row)):
        assert set(cell.split()) <= set(words)


def test_a_table_that_fits_is_shown_as_it_is() -> None:
    assert lines(INTERVALS, 200)[2].split()[:3] == ["stated", "120", "ms"]


def test_one_that_fits_only_turned_over_keeps_each_cell_in_a_line() -> None:
    shown = lines(INTERVALS, 80)
    assert shown[2].split() == ["stated", "90", "%", "95", "%", "99", "%"]
    assert any(line.split()[:5] == ["1000", "ms", "90.0", "[97.0,", "100.0]"] for line in shown)


def test_narrower_than_the_words_they_are_folded_not_dropped() -> None:
    shown = lines(ACTIONS, 40)
    assert all(len(line) <= 40 for line in shown)
    assert "…" not in "".join(shown)


def test_flags_that_would_be_ignored_are_named_at_once() -> None:
    without_effect({"--data": None, "--out": None}, "with --occlude")
    with pytest.raises(ConfigError, match=r"^--out: has no effect with --occlude; leave it out$"):
        without_effect({"--data": None, "--out": "x"}, "with --occlude")
    told = "^--data, --out: have no effect with --occlude; leave them out$"
    with pytest.raises(ConfigError, match=told):
        without_effect({"--data": 1, "--out": "x"}, "with --occlude")


def test_a_folders_tables_of_joints_are_recordings_and_other_tables_are_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    texts = {
        "a.csv": "time_s,head_x,head_y,head_z\n",
        "b.CSV": "\ufeffTime;Head.X;Head.Y;Head.Z\n",
        "manifest.csv": "file,split,frames,duration_s\n",
        "errors.csv": "time,error_x,force\n",
        "empty.csv": "",
        "lines.csv": "a\rb",
        "noise.csv": "\0\1",
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    (tmp_path / "folder.csv").mkdir()
    assert [path.name for path in recordings(tmp_path, None)] == ["a.csv", "b.CSV"]
    assert capsys.readouterr().err == ""


def test_a_table_that_names_joints_and_no_time_is_left_out_with_a_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "a.csv"
    path.write_text("frame,head_x,head_y,head_z\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="holds no recording"):
        recordings(tmp_path, None)
    err = capsys.readouterr().err
    assert err.startswith(f"warning: recording {path}: no column 'time_s'")
    assert err.endswith("; left out\n")
    assert err.count("\n") == 1
