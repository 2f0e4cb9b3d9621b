"""Times of the scenes that one program sends: in order, and never in the future."""

import time
from collections import deque

import numpy as np

BLIND_PERIOD_S = 0.05
"""Interval between scenes that only report that the room is not seen."""
UNKNOWN_LATENCY_NS = 100_000_000
"""Latency assumed until the first image has been processed."""
_KEPT = 100_000  # latencies; an hour at 30 Hz


class SceneTimes:
    """Decides which images are in time, and the time of a scene without an image.

    A scene without an image is as old as one with an image would be. The node estimates a
    sender's clock from the scene with the shortest delay. A scene stamped with the current time
    would be the one with the shortest delay, and all later images would seem late.

    Attributes:
        late: number of images that were refused because a newer scene had been sent.
    """

    def __init__(self) -> None:
        self.late = 0
        self._newest_ns: int | None = None
        self._latencies_ns: deque[int] = deque(maxlen=_KEPT)

    def admit(self, exposed_ns: int) -> bool:
        """Return whether an image is newer than all scenes; if so, its scene is sent next.

        Args:
            exposed_ns: by ``time.monotonic_ns``.
        """
        if self._newest_ns is not None and exposed_ns <= self._newest_ns:
            self.late += 1
            return False
        self._newest_ns = exposed_ns
        return True

    def blind_ns(self) -> int:
        """Return the time of a scene without an image that is sent now."""
        latency_ns = self._latencies_ns[-1] if self._latencies_ns else UNKNOWN_LATENCY_NS
        stamp_ns = time.monotonic_ns() - latency_ns
        if self._newest_ns is not None:
            stamp_ns = max(stamp_ns, self._newest_ns + 1)
        self._newest_ns = stamp_ns
        return stamp_ns

    def looked_at(self, exposed_ns: int) -> None:
        """Note that the scene of an image was sent now."""
        self._latencies_ns.append(time.monotonic_ns() - exposed_ns)

    def summary(self) -> dict[str, float | None]:
        """Return the time from exposure to scene in milliseconds: least, p50, p99."""
        if not self._latencies_ns:
            return dict.fromkeys(("least", "p50", "p99"))
        latency = np.array(self._latencies_ns, np.float64) / 1e6
        p50, p99 = np.percentile(latency, (50, 99))
        return {"least": float(latency.min()), "p50": float(p50), "p99": float(p99)}
