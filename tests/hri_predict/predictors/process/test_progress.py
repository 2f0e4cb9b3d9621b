"""What the kernel tells of a process: that it computes, reads, waits or is stopped."""

import os
import signal
import subprocess
import sys
import time
from typing import Any

import pytest

from hri_predict.predictors.process import remote as progress
from hri_predict.predictors.process.remote import Progress, Work

WAITS = "import time; print(flush=True); time.sleep(100)"
COMPUTES = "print(flush=True)\nwhile True: pass"
SOON_S = 20.0


@pytest.fixture
def process():
    """A function that starts a program and waits until it says that it began."""
    started: list[Any] = []

    def start(program: str) -> int:
        child = subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE)
        started.append(child)
        assert child.stdout is not None
        child.stdout.readline()
        return child.pid

    yield start
    for child in started:
        child.kill()
        child.wait()
        child.stdout.close()


def look_until(watched, true):
    end = time.monotonic() + SOON_S
    while not true():
        assert time.monotonic() < end
        watched.look()
        time.sleep(0.02)


@pytest.mark.realtime
def test_a_process_that_waits_is_idle_and_one_that_computes_is_not(process):
    waits, computes = Progress(process(WAITS)), Progress(process(COMPUTES))
    look_until(computes, lambda: computes.cpu_s > 0.3)
    look_until(waits, lambda: waits.idle_s > 0.3)
    assert not waits.stopped


@pytest.mark.realtime
def test_a_process_that_is_stopped_says_so(process):
    pid = process(COMPUTES)
    os.kill(pid, signal.SIGSTOP)
    watched = Progress(pid)
    look_until(watched, lambda: watched.stopped and watched.idle_s > 0.3)


@pytest.fixture
def told(monkeypatch):
    """What the kernel tells, and when: ``told["work"]``, ``told["now"]``."""
    state = {"work": Work(), "now": 100.0}
    monkeypatch.setattr(progress, "work_of", lambda pid: state["work"])
    monkeypatch.setattr(progress.time, "monotonic", lambda: state["now"])
    return state


def looks(watched, told, steps, step_s=0.25):
    for _ in range(steps):
        told["now"] += step_s
        watched.look()


def test_reading_counts_as_progress_where_a_slow_disk_leaves_nothing_to_compute(told):
    watched = Progress(1)
    looks(watched, told, 8)
    assert watched.idle_s == 2.0
    told["work"] = Work(read=4096)
    looks(watched, told, 1)
    assert watched.idle_s == 0.0


def test_a_thread_that_wakes_now_and_then_is_no_progress(told):
    watched = Progress(1)
    for second in range(1, 7):
        told["work"] = Work(cpu_s=0.005 * second)  # half a percent of a core
        looks(watched, told, 4)
    assert watched.idle_s == 6.0


def test_time_in_which_the_node_itself_stood_still_is_not_counted(told):
    watched = Progress(1)
    looks(watched, told, 1, step_s=60.0)
    assert watched.idle_s == progress.MAX_STEP_S


def test_where_the_system_tells_nothing_a_process_is_not_called_idle(told):
    watched = Progress(1)
    told["work"] = None
    looks(watched, told, 100)
    assert watched.idle_s == 0.0


def test_a_process_that_is_gone_has_done_nothing_to_tell():
    assert progress.work_of(2**22 + 1) is None
