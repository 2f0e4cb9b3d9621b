"""hri_sender.py as a program: a mistake is one line with the remedy, and no traceback."""

import socket
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
        (["--port", "0"], "--port 0: give the node's source.port, 1 to 65535"),
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


def test_it_says_where_it_sends_how_often_and_with_which_joints():
    done = python(SENDER, "--port", "9", "--seconds", "0", "--rate", "25", timeout=30)
    told = "sends to 127.0.0.1 port 9, 25 scenes a second; the node needs 'joint_map: canonical'"
    assert done.stdout.splitlines() == [told]


def test_a_port_of_this_machine_where_no_program_listens_is_named_once():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    done = python(SENDER, "--port", str(port), "--seconds", "0.3", timeout=30)
    (warning,) = done.stderr.splitlines()
    assert f"no program listens on 127.0.0.1 port {port}: start the node" in warning
