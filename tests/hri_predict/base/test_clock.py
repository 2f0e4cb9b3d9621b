import threading
import time

import pytest

from hri_predict.base.clock import MonotonicClock, VirtualClock


def test_virtual_clock_moves_only_when_told_and_never_back():
    clock = VirtualClock(5)
    clock.wait_until(20)
    clock.advance_to(10)
    assert clock.now_ns() == 20


def test_factor_scales_the_passing_of_time():
    clock = MonotonicClock(10.0)
    wall, node = time.monotonic_ns(), clock.now_ns()
    clock.wait_until(node + 500_000_000)
    assert clock.now_ns() - node >= 500_000_000
    assert time.monotonic_ns() - wall >= 45_000_000  # a tenth, less the float's grain


def test_wake_ends_a_wait():
    wake = threading.Event()
    wake.set()
    clock = MonotonicClock()
    clock.wait_until(clock.now_ns() + 3_600_000_000_000, wake)


def test_factor_must_be_positive():
    with pytest.raises(ValueError):
        MonotonicClock(0)
