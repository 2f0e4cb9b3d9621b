"""Decides which captures are used: detects repeated, late and lost ones, and sender restarts."""

from hri_predict.contracts.source import SourceCounters

LATE_NS = 500_000_000
"""A stamp earlier by at most this arrived out of order; an even earlier stamp means a restart."""
LATE_RUN = 10
"""This many late captures in a row also mean a restart."""
MAX_LOST = 100_000
"""Maximum number of lost captures; a larger jump ahead means that the sender restarted."""
LATE_NUMBERS = 30
"""The equivalent of ``LATE_NS`` for capture numbers."""


class Order:
    """Orders the captures of one sender by their numbers, or else by their stamps.

    Args:
        counters: counts ``lost``, ``replayed`` and ``out_of_order``.

    Attributes:
        session: increases when the sender restarts.
        sequence: number of the newest capture; increases by one, or by more if captures are lost.
    """

    def __init__(self, counters: SourceCounters) -> None:
        self.session = 0
        self.sequence = 0
        self._counters = counters
        self._stamp_ns: int | None = None
        self._number: int | None = None
        self._late = 0

    def advances(self, stamp_ns: int, number: int | None) -> bool:
        """Process the next capture; return whether to use it."""
        if stamp_ns == self._stamp_ns:
            self._repeats()
            return False
        if number is not None and self._number is not None:
            used = self._counts(number - self._number)
        else:
            used = self._stamp_ns is None or self._follows(stamp_ns - self._stamp_ns, LATE_NS)
        if used:
            self.sequence += 1
            self._late = 0
            self._stamp_ns, self._number = stamp_ns, number
        return used

    def _counts(self, risen: int) -> bool:
        if risen > MAX_LOST:
            self.session += 1
        elif self._follows(risen, LATE_NUMBERS):
            lost = max(0, risen - 1)
            self._counters.lost += lost
            self.sequence += lost
        else:
            return False
        return True

    def _follows(self, risen: int, late: int) -> bool:
        if risen > 0:
            return True
        if risen == 0:
            self._repeats()
            return False
        self._late += 1
        if -risen <= late and self._late < LATE_RUN:
            self._counters.out_of_order += 1
            return False
        self.session += 1
        return True

    def _repeats(self) -> None:
        self._counters.replayed += 1
        self._counters.note("the sender's time does not advance; see 'stamp'")
