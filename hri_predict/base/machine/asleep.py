"""Detects that the machine was suspended: the node's monotonic clock stops meanwhile.

Data from before the suspension then still appear current, however long it lasted.
"""

import time
from collections.abc import Callable

AT_ONCE_NS = 1_000_000
"""Maximum duration of reading both clocks; a slower reading was interrupted."""
TRIES = 5
LEAST_NS = 50_000_000
"""Minimum duration of a suspension."""

Clocks = Callable[[], tuple[int, int, int]]
"""Nanoseconds: monotonic clock, boot-time clock including suspension, monotonic clock again."""


class Asleep:
    """Measures suspension since the previous call; call it often, from one thread.

    Args:
        clocks: reads both clocks; by default the system's.
    """

    def __init__(self, clocks: Clocks | None = None) -> None:
        self._clocks = clocks or _clocks
        self._ahead_ns = self._measured_ns()

    def since_last_s(self) -> float:
        """Return the time suspended since the last call, in seconds; 0.0 if none or unknown."""
        now_ns, before_ns = self._measured_ns(), self._ahead_ns
        if now_ns is None:
            return 0.0  # the next answer has it
        self._ahead_ns = now_ns
        slept_ns = 0 if before_ns is None else now_ns - before_ns
        return slept_ns * 1e-9 if slept_ns >= LEAST_NS else 0.0

    def _measured_ns(self) -> int | None:
        """Return the lead of the clock that includes suspension; ``None`` if it could not be
        measured.
        """
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
