"""A UDP socket for formats that do not identify their sender."""

import time
from collections.abc import Callable

from hri_drivers.sources.udp_receiver import LARGEST, UdpReceiver
from hri_predict.contracts.source import SourceCounters

SILENT_S = 1.0
"""Silence after which another sender may replace the current one."""


class OneSender(UdpReceiver):
    """See ``UdpReceiver``; datagrams of a second sender are refused and counted.

    The formats of motion capture do not identify the sender: the bones from two senders would be
    merged into one body, and one of two people would not be seen. While a second sender sends,
    ``contradicted`` is true.

    Args:
        host, port, multicast_group, largest: see ``UdpReceiver``.
        counters: counts ``refused``.
        by_machine: whether one program may send from several ports of its machine.
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
        by_machine: bool = False,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(host, port, multicast_group, largest)
        self._counters = counters
        self._by_machine = by_machine
        self._now_s = now_s
        self._sender: object = None
        self._heard_s = self._other_s = -SILENT_S

    @property
    def contradicted(self) -> bool:
        """Whether a second sender was heard recently."""
        return self._now_s() - self._other_s < SILENT_S

    def accepts(self, sender: object) -> bool:
        """Whether a datagram from this address is accepted."""
        if self._by_machine and isinstance(sender, tuple):
            sender = sender[0]
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
