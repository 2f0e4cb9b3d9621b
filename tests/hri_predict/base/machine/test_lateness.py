import os
import time

import pytest

from hri_predict.base.machine.lateness import load, wake_ups
from hri_predict.base.machine.realtime import RealtimeSettings

pytestmark = pytest.mark.realtime


def test_a_loop_is_woken_late_and_never_early():
    began = time.monotonic()
    late = wake_ups(RealtimeSettings(), 0.4)
    assert time.monotonic() - began >= 0.4
    assert 0 <= late.p50_us <= late.p99_us <= late.max_us


def test_the_load_computes_and_ends():
    others = _children()  # of tests before this one
    with load(25.0, RealtimeSettings()):
        (child,) = _children() - others
        before = _ticks(child)
        end = time.monotonic() + 20
        while _ticks(child) < before + 5:  # hundredths of a second
            assert time.monotonic() < end
            time.sleep(0.05)
    assert child not in _children()


def _children():
    with open(f"/proc/self/task/{os.getpid()}/children", encoding="ascii") as file:
        return set(map(int, file.read().split()))


def _ticks(pid):
    with open(f"/proc/{pid}/stat", encoding="ascii") as file:
        fields = file.read().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])
