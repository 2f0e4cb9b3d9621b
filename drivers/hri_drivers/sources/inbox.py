"""The queue of scenes between a live source's thread and the node."""

import threading
from collections import deque

from hri_drivers.sources.sent import SentScene
from hri_predict.contracts.source import NOT_KNOWN_NS

CAPACITY = 16
"""Capacity of the queue; also the maximum number of scenes taken in one burst after a pause."""
RATE_FACTOR = 2.0
"""A rate above this multiple of the nominal rate is a flood. The histories of people are sized for
the nominal rate, so a flood would displace the past that predictions need."""


class SceneInbox:
    """A bounded, newest-wins queue between the receiving thread and the node's thread.

    In a flood, the node gets the newest scenes at twice the nominal rate; the others are dropped.

    Args:
        rate_hz: nominal scenes per second.

    Attributes:
        overrun: scenes dropped.
    """

    def __init__(self, rate_hz: float, capacity: int = CAPACITY) -> None:
        self.overrun = 0
        self._capacity = capacity
        self._spacing_ns = round(1e9 / (RATE_FACTOR * rate_hz))
        self._lock = threading.Lock()
        self._queue: deque[SentScene] = deque()
        self._full_ns = 0  # when the full capacity may be taken at once; a leaky bucket

    def put(self, sent: SentScene) -> None:
        """Add a scene; drop the oldest if there are too many."""
        with self._lock:
            self._queue.append(sent)
            if len(self._queue) > self._capacity:
                self._queue.popleft()
                self.overrun += 1

    def take(self, now_ns: int) -> SentScene | None:
        """The oldest scene, or the newest in a flood; ``None`` if no scene waits or may be taken.

        ``now_ns`` is the time on the node's clock.
        """
        with self._lock:
            allowed = self._allowed(now_ns)
            if not self._queue or allowed < 1:
                return None
            while len(self._queue) > allowed:
                self._queue.popleft()
                self.overrun += 1
            self._full_ns = max(self._full_ns, now_ns) + self._spacing_ns
            return self._queue.popleft()

    def next_ns(self) -> int:
        """Time when the next scene may be taken (now if past); ``NOT_KNOWN_NS`` if none waits."""
        with self._lock:
            if not self._queue:
                return NOT_KNOWN_NS
            return self._full_ns - (self._capacity - 1) * self._spacing_ns

    def _allowed(self, now_ns: int) -> int:
        """Return the number of scenes that may be taken now."""
        spare_ns = self._capacity * self._spacing_ns - max(0, self._full_ns - now_ns)
        return spare_ns // self._spacing_ns
