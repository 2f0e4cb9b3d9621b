"""Notices that the machine was suspended: the monotonic clock, the node's, stands still then.

What was known before then still seems current, however long the machine slept.
"""

import time
from collections.abc import Callable

AT_ONCE_NS = 1_000_000
"""Two clocks were read at once if it took no longer; else something came between."""
TRIES = 5
LEAST_NS = 50_000_000
"""No machine sleeps and wakes in less."""

Clocks = Callable[[], tuple[int, int, int]]
"""Nanoseconds on the monotonic clock, since the machine's start with sleep, monotonic again."""


class Asleep:
    """Asked often, from one thread, it says how long the machine slept since it was last asked.

    Args:
        clocks: reads both clocks; the system's by default.
    """

    def __init__(self, clocks: Clocks | None = None) -> None:
        self._clocks = clocks or _clocks
        self._ahead_ns = self._measured_ns()

    def since_last_s(self) -> float:
        """Return seconds; 0.0 if it did not sleep, or if the time is unknown."""
        now_ns, before_ns = self._measured_ns(), self._ahead_ns
        if now_ns is None:
            return 0.0  # the next answer has it
        self._ahead_ns = now_ns
        slept_ns = 0 if before_ns is None else now_ns - before_ns
        return slept_ns * 1e-9 if slept_ns >= LEAST_NS else 0.0

    def _measured_ns(self) -> int | None:
        """Return the lead of the clock that counts sleep; ``None`` if it could not be measured."""
        for _ in range(TRIES):
            first_ns, boot_ns, second_ns = self._clocks()
            if second_ns - first_ns <= AT_ONCE_NS:
                return boot_ns - first_ns
        return None


def _clocks() -> tuple[int, int, int]:
    boottime = getattr(time, "CLOCK_BOOTTIME", None)  # Linux alone has it
    first_ns = time.monotonic_ns()
    boot_ns = first_ns if boottime is None else time.clock_gettime_ns(boottime)
    return first_ns, boot_ns, time.monotonic_ns()
