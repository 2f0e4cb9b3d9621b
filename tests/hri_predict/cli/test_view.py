"""Mistakes of ``hri-predict view``: one line each."""

import os

import pytest
from typer.testing import CliRunner

from hri_predict.base.errors import HriPredictError
from hri_predict.cli.commands import app

pytest.importorskip("viser", reason="the extra viewer is not installed")


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("none.mcap", None, "cannot be read (No such file or directory); name another file"),
        ("text.mcap", b"hello", "was not recorded by hri-predict; name another file"),
        ("empty.mcap", b"", "was not recorded by hri-predict; name another file"),
        ("cell.yaml", b"rate_hz: 25", "is a configuration; give the .mcap that 'hri-predict run"),
        (".", None, "cannot be read (Is a directory); name another file"),
    ],
)
def test_what_is_no_recording_is_one_line(tmp_path, name, content, said):
    path = tmp_path / name
    if content is not None:
        path.write_bytes(content)
    result = CliRunner().invoke(app, ["view", str(path)])
    assert isinstance(result.exception, HriPredictError)
    assert said in str(result.exception)
    assert "\n" not in str(result.exception)


def test_a_pipe_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.mcap")
    result = CliRunner().invoke(app, ["view", str(tmp_path / "pipe.mcap")])
    assert "is a device or a pipe, not a file" in str(result.exception)


def test_an_absurd_port_is_one_line(tmp_path):
    result = CliRunner().invoke(app, ["view", str(tmp_path / "x.mcap"), "--port", "70000"])
    assert isinstance(result.exception, HriPredictError)
    assert "give a port from 0 to 65535" in str(result.exception)
