"""hri_sender.py as a program: a mistake is one line with the remedy, and no traceback."""

from pathlib import Path

import pytest

from tests.processes import python

SENDER = Path(__file__).resolve().parents[3] / "drivers" / "python" / "hri_sender.py"


def run(*arguments):
    done = python(SENDER, "--port", "9", "--seconds", "0", *arguments, timeout=30)
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--key-file", "gone.key"], "No such file or directory: 'gone.key'; give a copy of"),
        (["--key-file", "short.key"], "short.key: holds 5 bytes; a key has at least 32; give a"),
        (["--rate", "0"], "--rate 0: give a number above 0"),
        (["--host", "no host"], "give the node's source.host"),
    ],
)
def test_a_mistake_is_one_line(tmp_path, monkeypatch, arguments, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.key").write_text("short\n")
    status, err = run(*arguments)
    assert status == 2
    assert said in err.splitlines()[-1]
    assert "Traceback" not in err


def test_a_key_of_the_right_length_is_taken(tmp_path):
    (tmp_path / "cell.key").write_text("k" * 32)
    assert run("--key-file", str(tmp_path / "cell.key")) == (0, "")
