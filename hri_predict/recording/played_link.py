"""A link that replays a controller's recorded messages and sends nothing."""

import logging
from collections import deque
from collections.abc import Callable, Collection

from hri_predict.base.clock import Clock
from hri_predict.contracts.link import LinkCounters, Received
from hri_predict.contracts.source import Source
from hri_predict.protocol.messages import Message

log = logging.getLogger(__name__)


class PlayedLink:
    """See ``hri_predict.contracts.link.Link``; for replays without links (``--no-links``)."""

    def __init__(self, name: str, source: Source, clock: Clock) -> None:
        self.name = name
        self.counters = LinkCounters()
        self.connected = True
        self.last_error: str | None = None
        self.foreign_ns: int | None = None
        self.on_sent: Callable[[str, bytes, int], None] | None = None
        self._source = source
        self._clock = clock
        self._waiting: deque[Received] | None = None

    def start(self) -> None:
        """Do nothing: there is no device to open."""

    def post(self, message: Message) -> None:
        """Discard the message: nothing is opened, so nothing is late either."""

    def take(self) -> list[Received]:
        """The messages received by now."""
        if self._waiting is None:  # by now the source is open and knows the times of this run
            told = getattr(self._source, "received", ())
            self._waiting = deque(received for link, received in told if link == self.name)
        due = []
        while self._waiting and self._waiting[0].received_ns <= self._clock.now_ns():
            due.append(self._waiting.popleft())
        self.counters.messages_received += len(due)
        return due

    def service(self, now_ns: int) -> None:
        """Do nothing: there is no device to write or read."""

    def stop(self) -> None:
        """Do nothing: there is no device to close."""


def played_links(
    source: Source, clock: Clock, reporting: Collection[str] = ()
) -> tuple[PlayedLink, ...]:
    """One link for each recorded link; none for a source without any.

    Args:
        source: the recording, or another source.
        clock: the node's clock.
        reporting: robots whose position only their controllers report. A warning says that a
            recording without any message of controllers leaves them unknown.
    """
    told = getattr(source, "received", ())
    if reporting and not told and hasattr(source, "received"):
        log.warning(
            "the recording has no robot states, so %s stays unknown: leave out --no-links if the "
            "links are simulated (simulate:), or set motion: {kind: standing} or a trajectory",
            ", ".join(reporting),
        )
    return tuple(PlayedLink(name, source, clock) for name in dict.fromkeys(n for n, _ in told))
