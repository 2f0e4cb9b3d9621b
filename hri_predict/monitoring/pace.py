"""The loop's deadlines: how many ticks were late, and how long they took."""

from collections import deque

PACE_TICKS = 10_000  # the percentiles cover this many of the newest ticks


class Pace:
    """Statistics of the loop's deadlines, and the links' state at the end of the run.

    ``tick_ms`` holds the durations of the newest ticks in wall-clock milliseconds. ``connected``
    maps each link's name to whether its device was open when the run ended.
    """

    def __init__(self) -> None:
        self.ticks = self.late_ticks = self.missed_ticks = 0
        self.tick_ms: deque[float] = deque(maxlen=PACE_TICKS)
        self.source_failures = 0
        self.connected: dict[str, bool] = {}

    def note(self, seconds: float) -> None:
        """Note one tick's duration."""
        self.tick_ms.append(seconds * 1e3)
        self.ticks += 1
