"""Wake-up lateness of a bare loop: the lower bound for any node on this machine."""

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.machine.realtime import RealtimeSettings, steady

WAKES_HZ = 250  # more often than a node ticks, so that a second shows rare delays, too
BUSY = 0.5  # of each cycle: as long as a prediction may take
_LOAD = """
import os, sys, time
cycle_s, busy_s, cores = float(sys.argv[1]), float(sys.argv[2]), sys.argv[3]
if cores:
    os.sched_setaffinity(0, [int(core) for core in cores.split(",")])
parent = os.getppid()
import numpy as np
numbers = np.random.default_rng(0).random((256, 256))
began = time.monotonic()
while os.getppid() == parent:
    until = time.monotonic() + busy_s
    while time.monotonic() < until:
        numbers @ numbers
    began = max(began + cycle_s, time.monotonic())
    time.sleep(max(0.0, began - time.monotonic()))
"""


@dataclass(frozen=True, slots=True)
class Lateness:
    """Microseconds from each deadline until the loop ran."""

    p50_us: float
    p99_us: float
    max_us: float


def wake_ups(settings: RealtimeSettings, seconds: float) -> Lateness:
    """Measure a loop that only waits for deadlines, as the node's loop does."""
    clock, never = MonotonicClock(), threading.Event()
    period_ns = round(1e9 / WAKES_HZ)
    late = np.empty(max(1, round(seconds * WAKES_HZ)))
    with steady(settings):
        deadline_ns = clock.now_ns() + period_ns
        for k in range(len(late)):
            clock.wait_until(deadline_ns, never)
            now_ns = clock.now_ns()
            late[k] = (now_ns - deadline_ns) * 1e-3
            deadline_ns = max(deadline_ns + period_ns, now_ns)
    p50, p99 = np.percentile(late, (50, 99))
    return Lateness(round(float(p50), 1), round(float(p99), 1), round(float(late.max()), 1))


@contextlib.contextmanager
def load(rate_hz: float, settings: RealtimeSettings) -> Iterator[None]:
    """Another process that computes during half of each cycle, as a predictor may."""
    cores = ",".join(map(str, settings.inference_cpus))
    times = (str(1 / rate_hz), str(BUSY / rate_hz))
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _LOAD, *times, cores],
        env=os.environ | {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        stdin=subprocess.DEVNULL,
    )
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.5)  # it imports numpy meanwhile
        yield
    finally:
        process.kill()
        process.wait()
