"""Offline work: the same results from this process and from several; an ended one loses nothing."""

import logging
import os
import signal
import subprocess
import sys
import time

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.work import workers as module
from hri_predict.base.work.workers import Processes, ThisProcess
from hri_predict.base.work.workers_for import workers_for
from tests.hri_predict.base.machine import jobs

TASKS = [(n,) for n in range(7)]


def test_this_process_does_the_tasks_in_their_order():
    done = []
    with workers_for(1) as workers:
        assert workers.in_order(jobs.square, TASKS, lambda: done.append(1)) == [
            n * n for (n,) in TASKS
        ]
    assert len(done) == len(TASKS)


def test_an_error_of_a_task_is_its_own():
    with ThisProcess() as workers, pytest.raises(ConfigError, match="two: cannot be done"):
        workers.in_order(jobs.refused, TASKS)


def test_a_task_computes_with_one_thread_and_leaves_the_others_as_they_were():
    torch = pytest.importorskip("torch")
    before = torch.get_num_threads()
    try:
        torch.set_num_threads(2)
        with ThisProcess() as workers:
            assert workers.in_order(jobs.threads, [()]) == [1]
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


@pytest.mark.realtime
def test_two_processes_give_what_one_gives_and_a_killed_one_loses_nothing(tmp_path, caplog):
    with caplog.at_level(logging.WARNING, module.__name__), Processes(2) as workers:
        tasks = [(n, str(tmp_path / "killed")) for n in range(7)]
        assert workers.in_order(jobs.ended_once, tasks) == [n * n for n, _ in tasks]
        assert "repeating" in caplog.text
        with pytest.raises(ConfigError, match="two: cannot be done"):
            workers.in_order(jobs.refused, TASKS)


@pytest.mark.realtime
@pytest.mark.long
def test_a_task_that_ends_every_process_is_given_up_with_one_line():
    with Processes(1) as workers, pytest.raises(ConfigError, match="--jobs: a process exited"):
        workers.in_order(jobs.always_ends, [()])


@pytest.mark.parametrize("after_s", [0.0, 0.3, 1.0])
def test_ctrl_c_while_processes_start_prints_no_traceback(after_s, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "from hri_predict.base.work.workers import Processes\n"
        "from tests.hri_predict.base.machine import jobs\n"
        "if __name__ == '__main__':\n"
        "    try:\n"
        "        print('begins', flush=True)\n"
        "        with Processes(2) as workers:\n"
        "            workers.in_order(jobs.wait, [(60,), (60,)])\n"
        "    except KeyboardInterrupt:\n"
        "        raise SystemExit(130) from None\n"
    )
    started = subprocess.Popen(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,  # a group of its own, as a terminal gives each command
    )
    assert started.stdout is not None
    assert started.stdout.readline() == "begins\n"
    time.sleep(after_s)
    os.killpg(started.pid, signal.SIGINT)
    _, error = started.communicate(timeout=60)
    assert (started.returncode, error) == (130, "")
