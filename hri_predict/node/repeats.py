"""Repeats the newest Status and Advice until the next tick.

A tick's advice is valid for the delay budget's *encoding* and *cycle*, and until the controller has
detected a following silence. So it may be repeated until the first two are over, even if the loop
hangs (``docs/decisions/repeated-advice.md``). Then this part falls silent, and the controllers stop
by themselves.
"""

import threading
from collections.abc import Sequence
from math import inf, isfinite

from hri_predict.contracts.link import Link
from hri_predict.protocol.messages import Advice, Message, Status

NEVER_NS = 2**62


class Repeats:
    """Posts messages to links, and repeats the newest Status and Advice when due.

    A repetition never replaces a newer message, because the threads of the loop and the repetitions
    post under one lock.

    Args:
        links: all links.
        intervals_s: repetition interval of each link; infinite: never. Empty if nothing is
            repeated.
        held_s: time after the tick for which its messages may be repeated.
    """

    def __init__(
        self, links: Sequence[Link], intervals_s: Sequence[float] = (), held_s: float = 0.0
    ) -> None:
        self._links = links
        intervals_s = intervals_s or [inf] * len(links)
        self._intervals_ns = [round(s * 1e9) if isfinite(s) else NEVER_NS for s in intervals_s]
        self._held_ns = round(held_s * 1e9)
        self._lock = threading.Lock()
        self._newest: list[list[Message]] = [[] for _ in links]
        self._due_ns = [NEVER_NS] * len(links)
        self._until_ns = 0

    @property
    def interval_ns(self) -> int:
        """Minimum interval; ``NEVER_NS`` if nothing is repeated."""
        return min(self._intervals_ns, default=NEVER_NS)

    @property
    def due_ns(self) -> int:
        """Return when ``repeat`` is due; ``NEVER_NS``: not before the next tick."""
        return min(self._due_ns, default=NEVER_NS)

    def post(self, now_ns: int, messages: Sequence[Sequence[Message]]) -> None:
        """Post each link's messages of the tick at ``now_ns``."""
        with self._lock:
            self._until_ns = now_ns + self._held_ns
            for k, (link, of_link) in enumerate(zip(self._links, messages, strict=True)):
                for message in of_link:
                    link.post(message)
                self._newest[k] = [m for m in of_link if isinstance(m, Advice | Status)]

    def posted(self, now_ns: int) -> None:
        """Restart the intervals, because a tick has posted its messages."""
        with self._lock:
            self._due_ns = [
                NEVER_NS if interval_ns == NEVER_NS else now_ns + interval_ns
                for interval_ns in self._intervals_ns
            ]

    def repeat(self, now_ns: int) -> None:
        """Repeat the messages due at ``now_ns``, unless they are no longer valid."""
        with self._lock:
            for k, link in enumerate(self._links):
                if now_ns < self._due_ns[k]:
                    continue
                if now_ns >= self._until_ns:
                    self._due_ns[k] = NEVER_NS
                    continue
                for message in self._newest[k]:
                    link.post(message)
                self._due_ns[k] = now_ns + self._intervals_ns[k]
