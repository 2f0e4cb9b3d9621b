"""How a command line ends: its exit status and its one line, whatever becomes of its output."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from hri_predict.cli import commands, main, run
from hri_predict.operation.monitoring.summary import Summary
from tests.commands import status_of

HRI_PREDICT = [sys.executable, "-m", "hri_predict"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
@pytest.mark.parametrize(
    ("arguments", "unbuffered"),
    [
        (["--help"], ""),
        (["topics", "--help"], "1"),
    ],
)
def test_a_full_disk_is_one_line(arguments, unbuffered):
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*HRI_PREDICT, *arguments],
            stdout=full, stderr=subprocess.PIPE, text=True, check=False,
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
        )  # fmt: skip
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert os.strerror(errno.ENOSPC) in done.stderr


def test_a_reader_that_is_gone_is_no_failure():
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(
        [*HRI_PREDICT, "--help"], stdout=writing, stderr=subprocess.PIPE, text=True, check=False
    )
    os.close(writing)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("gone", [BrokenPipeError, SystemExit])
@pytest.mark.parametrize("contacts", [0, 2])
def test_the_status_tells_of_contacts_though_nobody_reads_the_summary(monkeypatch, gone, contacts):
    def show(*_arguments):
        raise gone(1)

    summary = Summary.__new__(Summary)
    summary.contacts = contacts
    monkeypatch.setattr(run, "run_session", lambda *_arguments: summary)
    monkeypatch.setattr(run, "_show", show)
    monkeypatch.setattr(sys, "stdout", sys.stdout)  # the command line gives it up
    assert status_of("demo", "--speed", "max") == (1 if contacts else 0)


def test_ctrl_c_while_it_is_imported_ends_it_quietly(monkeypatch, capsys):
    class Slow:
        def __getattr__(self, name):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "hri_predict.cli.commands", Slow())
    assert status_of() == 130
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[31mb", "a\u2028b", "a\rb"])
def test_a_name_cannot_break_the_line(cli, name):
    status, _, error = cli("check", f"/no/{name}.yaml")
    assert status == 2
    assert len(error.splitlines()) == 1
    assert error.rstrip("\n").isprintable()


def test_a_failure_of_ours_keeps_its_trace(monkeypatch):
    def broken(**_options):
        raise ValueError("ours")

    monkeypatch.setattr(commands, "app", broken)
    with pytest.raises(ValueError, match="ours"):
        main()


def test_a_name_that_is_too_long_is_one_line(cli):
    status, _, error = cli("evidence", 300 * "a")
    assert status == 2
    (line,) = error.splitlines()
    assert line.startswith(f"error: {300 * 'a'}")
    assert "File name too long; choose a shorter one" in line
