"""Turns header stamps into capture times, and detects repeats, late messages and restarts."""

from collections.abc import Callable

from hri_predict.contracts.source import SourceCounters
from hri_predict.protocol.ros.bodies import MessageError
from hri_predict.protocol.ros.stamps import CLOCK_TEXTS, StampClock, clock_of

LATE_NS = 500_000_000
"""A stamp earlier by at most this arrived out of order; an even earlier stamp means a restart."""
LATE_RUN = 10
"""This many of them in a row also mean a restart."""


class Captures:
    """Orders the captures of one publisher.

    Args:
        counters: counts ``replayed`` and ``out_of_order``.
        by_arrival: ignore stamps; the capture time is the message's arrival.
        utc_ns: this machine's UTC clock, ns.
        boot_ns: time since this machine started, ns.

    Attributes:
        session: increases when the publisher's clock goes back.
        clock: the clock of the newest session's stamps; ``None`` before the first.
    """

    def __init__(
        self,
        counters: SourceCounters,
        *,
        by_arrival: bool,
        utc_ns: Callable[[], int],
        boot_ns: Callable[[], int],
    ) -> None:
        self.session = 0
        self.clock: StampClock | None = None
        self._counters = counters
        self._by_arrival = by_arrival
        self._utc_ns = utc_ns
        self._boot_ns = boot_ns
        self._newest: tuple[int, int] | None = None  # stamp, and when it arrived
        self._late = 0

    def place(self, stamp_ns: int | None, received_ns: int) -> int | None:
        """The capture's time on the publisher's clock; ``None``: the message is not used.

        Args:
            stamp_ns: the header's; ``None`` for a message without a header, whose capture time is
                the previous one plus the time between the two arrivals.
            received_ns: arrival on the node's clock.

        Raises:
            MessageError: the stamp is zero.
        """
        if self._by_arrival:
            stamp_ns = received_ns
        elif stamp_ns is None:
            stamp_ns = self._without_header(received_ns)
        elif stamp_ns == 0:
            raise MessageError(
                "header.stamp is zero; let the publisher stamp captures, or set 'stamp: arrival'"
            )
        if self._newest is not None and not self._advances(stamp_ns, self._newest[0]):
            return None
        self._late = 0
        self._newest = stamp_ns, received_ns
        return stamp_ns

    def news(self) -> str | None:
        """Return one line if the stamps come from a new clock."""
        if self._by_arrival or self._newest is None:
            return None
        clock = clock_of(self._newest[0], self._utc_ns(), self._boot_ns())
        if clock == self.clock:
            return None
        self.clock = clock
        return f"stamps are {CLOCK_TEXTS[clock]}"

    def _without_header(self, received_ns: int) -> int:
        if self._newest is None:
            return self._utc_ns()
        stamp_ns, before_ns = self._newest
        return stamp_ns + max(1, received_ns - before_ns)

    def _advances(self, stamp_ns: int, newest_ns: int) -> bool:
        if stamp_ns > newest_ns:
            return True
        if stamp_ns == newest_ns:
            self._counters.replayed += 1
            self._counters.note("a message with the same stamp as the previous one")
            return False
        self._late += 1
        if newest_ns - stamp_ns <= LATE_NS and self._late < LATE_RUN:
            self._counters.out_of_order += 1
            return False
        self.session += 1
        return True
