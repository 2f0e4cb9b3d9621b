"""Scenes that a live source has heard and the node has not yet taken."""

import threading
from collections import deque
from dataclasses import dataclass

from hri_predict.scene import Scene
from hri_predict.source import NOT_KNOWN_NS

CAPACITY = 16
"""Scenes that may wait, and that may be taken at once after a pause of the node."""
RATE_FACTOR = 2.0
"""More scenes a second than so many times the nominal rate are a flood. The histories of people are
sized by the nominal rate: a flood let through would push out the past that predictions rest on."""


@dataclass(frozen=True, slots=True)
class Heard:
    """A scene as its sender saw it.

    Attributes:
        scene: joints in the units and axes of the source's joint map, in the source's frame; stamp
            of the sender's clock.
        session: changes when the sender began anew, and its sequence with it.
    """

    scene: Scene
    session: int = 0


class SceneInbox:
    """A bounded, newest-wins queue between the thread that hears and the one that takes.

    In a flood the newest scene is taken at twice the nominal rate and the others are given up.

    Args:
        rate_hz: nominal scenes per second.

    Attributes:
        overrun: scenes given up.
    """

    def __init__(self, rate_hz: float, capacity: int = CAPACITY) -> None:
        self.overrun = 0
        self._capacity = capacity
        self._spacing_ns = round(1e9 / (RATE_FACTOR * rate_hz))
        self._lock = threading.Lock()
        self._queue: deque[Heard] = deque()
        self._full_ns = 0  # when as many as the capacity may be taken at once; a leaky bucket

    def put(self, heard: Heard) -> None:
        """Add one; the oldest goes if there are too many."""
        with self._lock:
            self._queue.append(heard)
            if len(self._queue) > self._capacity:
                self._queue.popleft()
                self.overrun += 1

    def take(self, now_ns: int) -> Heard | None:
        """The oldest, or in a flood the newest that waits; ``None`` if none waits or may be taken.

        ``now_ns`` is of the node's clock.
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
        """When one may next be taken: in the past if now; ``NOT_KNOWN_NS`` if none waits."""
        with self._lock:
            if not self._queue:
                return NOT_KNOWN_NS
            return self._full_ns - (self._capacity - 1) * self._spacing_ns

    def _allowed(self, now_ns: int) -> int:
        """How many may be taken now."""
        spare_ns = self._capacity * self._spacing_ns - max(0, self._full_ns - now_ns)
        return spare_ns // self._spacing_ns
