"""The loop's priority, cores and locked memory, on the system that runs the tests."""

import ctypes
import errno
import logging
import os
import resource
import subprocess
import sys
import threading

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.machine import realtime
from hri_predict.base.machine.realtime import RealtimeSettings, lock_memory, set_fifo, steady
from hri_predict.base.settings import validated

needs_linux = pytest.mark.skipif(not hasattr(os, "sched_setscheduler"), reason="needs Linux")


def may_have_fifo():
    return hasattr(os, "sched_setscheduler") and (
        os.geteuid() == 0 or resource.getrlimit(resource.RLIMIT_RTPRIO)[0] >= 5
    )


@pytest.fixture
def as_before():
    cores = os.sched_getaffinity(0)
    yield
    os.sched_setaffinity(0, cores)
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def in_thread(work):
    """What ``work`` gives in a thread of its own."""
    found = []
    thread = threading.Thread(target=lambda: found.append(work()))
    thread.start()
    thread.join()
    return found[0]


@needs_linux
@pytest.mark.skipif(not may_have_fifo(), reason="needs permission for SCHED_FIFO")
def test_the_loops_thread_alone_has_the_priority(as_before):
    others = []
    go = threading.Event()

    def looks_later():
        go.wait(10)
        others.append(os.sched_getscheduler(0))

    sooner = threading.Thread(target=looks_later, daemon=True)
    sooner.start()
    with steady(RealtimeSettings(priority=5)):
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
        assert os.sched_getparam(0).sched_priority == 5
        later = in_thread(lambda: os.sched_getscheduler(0))
        go.set()
        sooner.join()
        script = "import os; print(os.sched_getscheduler(0))"
        child = subprocess.run([sys.executable, "-c", script], capture_output=True, timeout=30)
    assert later == os.SCHED_OTHER
    assert others == [os.SCHED_OTHER]
    assert int(child.stdout) == os.SCHED_OTHER
    assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER


@needs_linux
def test_the_loops_cores_are_given_back(as_before):
    before = os.sched_getaffinity(0)
    one = min(before)
    with steady(RealtimeSettings(cpus=(one,))):
        assert os.sched_getaffinity(0) == {one}
    assert os.sched_getaffinity(0) == before


@needs_linux
def test_cores_that_are_not_there_are_one_warning_and_the_node_goes_on(caplog):
    before = os.sched_getaffinity(0)
    with caplog.at_level(logging.WARNING), steady(RealtimeSettings(cpus=(1000,))):
        assert os.sched_getaffinity(0) == before
    (record,) = caplog.records
    assert "realtime.cpus" in record.getMessage()
    assert "this process may use: " in record.getMessage()


def test_what_is_not_permitted_is_one_line_with_the_remedy(monkeypatch, caplog):
    def refuses(*_):
        raise PermissionError(errno.EPERM, "Operation not permitted")

    class Library:
        def mlockall(self, _flags):
            ctypes.set_errno(errno.ENOMEM)
            return -1

    monkeypatch.setattr(os, "sched_setscheduler", refuses)
    monkeypatch.setattr(ctypes, "CDLL", lambda *_, **__: Library())
    assert "LimitRTPRIO=7" in set_fifo(7)
    assert "LimitMEMLOCK=infinity" in lock_memory()
    ran = False
    asked = RealtimeSettings(priority=7, lock_memory=True)
    with caplog.at_level(logging.WARNING), steady(asked):
        ran = True
    assert ran
    assert len(caplog.records) == 2
    assert all(record.getMessage().count("\n") == 0 for record in caplog.records)


def test_by_default_nothing_is_asked_of_the_system(monkeypatch):
    for name in ("sched_setscheduler", "sched_setaffinity"):
        monkeypatch.setattr(os, name, None)
    monkeypatch.setattr(realtime, "lock_memory", None)
    with steady(RealtimeSettings()):
        pass


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs Linux")
def test_memory_is_locked_where_it_is_permitted():
    script = (
        "from hri_predict.base.machine.realtime import lock_memory; problem = lock_memory()\n"
        "status = open('/proc/self/status').read()\n"
        "locked = int(status.split('VmLck:')[1].split()[0])\n"
        "print(problem or locked)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    said = done.stdout.strip()
    assert (said.isdigit() and int(said) > 1000) or "LimitMEMLOCK" in said


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"cpus": [0, 1], "inference_cpus": [1]}, "core 1 is in cpus and in inference_cpus"),
        ({"priority": 99}, "priority"),
        ({"cpus": [-1]}, "cpus"),
        ({"prio": 5}, "did you mean 'priority'"),
    ],
)
def test_what_cannot_be_is_refused(wrong, said):
    with pytest.raises(ConfigError, match=said):
        validated(RealtimeSettings, wrong, "cell.yaml: realtime")
