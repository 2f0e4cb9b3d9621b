"""Clocks: every component receives one, so that tests and replays control the time.

All times are integer nanoseconds of one monotonic clock.
"""

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """A source of time."""

    def now_ns(self) -> int:
        """Nanoseconds since a fixed moment; never goes backwards."""

    def wait_until(self, deadline_ns: int, wake: threading.Event | None = None) -> None:
        """Return at ``deadline_ns``, or sooner if ``wake`` is set."""


class MonotonicClock:
    """The machine's monotonic clock, in real time or scaled by a factor.

    With ``factor`` 2 the node's seconds pass twice as fast as real ones; everything on this clock
    (the source, the loop, a mock controller) stays consistent.
    """

    def __init__(self, factor: float = 1.0) -> None:
        if not factor > 0:
            raise ValueError("factor must be positive")
        self.factor = factor

    def now_ns(self) -> int:
        """Return nanoseconds, identical in all processes on one machine with the same factor."""
        now = time.monotonic_ns()
        return now if self.factor == 1.0 else int(now * self.factor)

    def wait_until(self, deadline_ns: int, wake: threading.Event | None = None) -> None:
        """Sleep until ``deadline_ns``, or until ``wake`` is set."""
        remaining = (deadline_ns - self.now_ns()) / (1e9 * self.factor)
        if wake is not None:
            wake.wait(max(remaining, 0.0))
        elif remaining > 0:
            time.sleep(remaining)


class VirtualClock:
    """A clock advanced only by the program."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """The time it was last set to."""
        return self._now_ns

    def advance_to(self, now_ns: int) -> None:
        """Move forward to ``now_ns``; a time in the past has no effect."""
        self._now_ns = max(self._now_ns, now_ns)

    def wait_until(self, deadline_ns: int, wake: threading.Event | None = None) -> None:
        """Jump to ``deadline_ns``."""
        self.advance_to(deadline_ns)
