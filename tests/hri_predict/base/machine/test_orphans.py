"""A process that another one started ends when that is killed."""

import subprocess
import sys

import pytest

from hri_predict.base.machine import orphans

PARENT = """
import subprocess
from hri_predict.base.machine.orphans import command_of
subprocess.Popen(command_of({program!r}, "a")).wait()
"""
CHILD = "import sys, time\nprint(sys.argv[1:], flush=True)\ntime.sleep(600)\n"


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel ends it, on Linux")
@pytest.mark.parametrize("program", ["lasting", "lasting.py"])
def test_a_program_ends_with_a_parent_that_is_killed(tmp_path, program):
    (tmp_path / "lasting.py").write_text(CHILD)
    command = [sys.executable, "-c", PARENT.format(program=program)]
    with subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        assert parent.stdout.readline() == "['a']\n"
        parent.kill()
        assert parent.stdout.read() == ""  # ends when no process has it any more


def test_a_process_whose_parent_has_ended_ends_at_once(monkeypatch):
    class Ended(Exception):
        pass

    def end(status):
        raise Ended

    monkeypatch.setattr("os._exit", end)
    monkeypatch.setattr("ctypes.CDLL", lambda name: None)  # this one goes on
    with pytest.raises(Ended):
        orphans.end_with(-1)
