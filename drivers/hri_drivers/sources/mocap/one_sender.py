"""A UDP socket that listens to one sender at a time."""

import time
from collections.abc import Callable

from hri_drivers.sources.udp_receiver import LARGEST, UdpReceiver
from hri_predict.contracts.source import SourceCounters

SILENT_S = 1.0
"""A sender that was silent for this long gives way to another."""


class OneSender(UdpReceiver):
    """See ``UdpReceiver``; datagrams of a second sender are refused and counted.

    The formats of motion capture do not name their sender: the bones of two would become one body,
    and one of two people would not be seen. While a second one sends, ``contradicted`` is true.

    Args:
        host, port, multicast_group, largest: see ``UdpReceiver``.
        counters: counts ``refused``.
        now_s: a monotonic clock.
    """

    def __init__(
        self,
        host: str,
        port: int,
        multicast_group: str | None = None,
        largest: int = LARGEST,
        *,
        counters: SourceCounters,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(host, port, multicast_group, largest)
        self._counters = counters
        self._now_s = now_s
        self._sender: object = None
        self._heard_s = self._other_s = -SILENT_S

    @property
    def contradicted(self) -> bool:
        """Whether a second sender was heard a moment ago."""
        return self._now_s() - self._other_s < SILENT_S

    def accepts(self, sender: object) -> bool:
        """Whether a datagram of this address is taken."""
        now_s = self._now_s()
        if sender != self._sender:
            if now_s - self._heard_s < SILENT_S:
                self._other_s = now_s
                self._counters.refused += 1
                self._counters.note("two programs send to this port; stop one of them")
                return False
            self._sender = sender
        self._heard_s = now_s
        return True
