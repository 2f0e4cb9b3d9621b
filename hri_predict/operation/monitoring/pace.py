"""Statistics of the loop's deadlines: number of late ticks, and their durations."""

from bisect import bisect_left
from collections import deque

TICK_BOUNDS_S = (0.001, 0.002, 0.003, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.04, 0.1, 1.0)
PACE_TICKS = 10_000  # the percentiles cover this many of the newest ticks


class Pace:
    """Statistics of the loop's deadlines, and the links' state at the end of the run.

    ``tick_ms`` holds the durations of the newest ticks in wall-clock milliseconds. ``within``
    counts all ticks, by the smallest of ``TICK_BOUNDS_S`` that they met (the last number: none of
    them), and ``total_s`` is the sum of their durations. ``connected`` maps each link's name to
    whether its device was open when the run ended. ``too_slow`` is one line if the machine could
    not keep the rate in this run, otherwise empty.
    """

    def __init__(self) -> None:
        self.ticks = self.late_ticks = self.missed_ticks = 0
        self.tick_ms: deque[float] = deque(maxlen=PACE_TICKS)
        self.within = [0] * (len(TICK_BOUNDS_S) + 1)
        self.total_s = 0.0
        self.source_failures = 0
        self.connected: dict[str, bool] = {}
        self.too_slow = ""

    def note(self, seconds: float) -> None:
        """Record the duration of one tick."""
        self.tick_ms.append(seconds * 1e3)
        self.within[bisect_left(TICK_BOUNDS_S, seconds)] += 1
        self.total_s += seconds
        self.ticks += 1
