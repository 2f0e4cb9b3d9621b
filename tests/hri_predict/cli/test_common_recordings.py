"""Which files of a folder ``--data`` takes as recordings."""

from pathlib import Path

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.cli.common import recordings


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
