"""A process beside the bench: what it sends, its report, and its mistakes."""

import os
import subprocess
import sys

import pytest

from hri_predict.base.errors import LinkError
from hri_sim.wires.child import child

pytestmark = pytest.mark.realtime


def echo(pipe, word):
    pipe.send(word)
    return pipe.recv()


def fails(_):
    raise ValueError("no such wire")


def dies(_):
    os._exit(3)


def waits(pipe):
    pipe.poll(None)


def test_it_sends_and_reports():
    with child(echo, "ready") as process:
        assert process.receive() == "ready"
        assert process.report() == "end"


@pytest.mark.parametrize(
    ("run", "words"), [(fails, "ValueError: no such wire"), (dies, "exited without a report")]
)
def test_an_end_is_said_in_one_line(run, words):
    with child(run) as process, pytest.raises(LinkError, match=words) as told:
        process.receive()
    assert "\n" not in str(told.value)


def test_nothing_comes_without_the_process_that_is_awaited():
    code = "import sys; sys.exit('no configuration')"
    awaited = subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True)
    with child(waits) as process, pytest.raises(LinkError, match="exited: no configuration"):
        process.receive(awaited=awaited)
    with child(waits) as process, pytest.raises(LinkError, match=r"sent nothing in 0\.1 s"):
        process.receive(0.1)
