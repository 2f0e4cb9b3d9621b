"""A steady reason, which does not alternate because of noise at a threshold.

A person at the threshold between "too close" and "may get too close" can cross it with every
capture. An operator cannot read a reason that changes thirty times a second, and its log is
useless. Some reasons change into each other continuously. Among these, a milder reason replaces a
stricter one only after a number of captures, which doubles each time the stricter reason returns at
the same level. A stricter reason, a different level, and every reason for a fault are shown without
delay. Level and speed limit do not depend on this.
"""

from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason


class SteadyReason:
    """Memory for the reason of one robot's advice.

    Args:
        captures: initial number of distinct captures that must agree before a milder reason is
            shown.
    """

    def __init__(self, captures: int) -> None:
        self._first = self._needed = captures
        self._level: Level | None = None
        self._reason = Reason.NONE
        self._waiting = Reason.NONE  # the strictest of the milder reasons seen since then
        self._waiting_rank = 0
        self._agreed = 0
        self._last_capture: int | None = None

    def update(self, level: Level, reason: Reason, captures: int) -> Reason:
        """Return the reason to show.

        Args:
            level: the level advised at this tick.
            reason: the reason from this tick alone.
            captures: number of distinct captures so far.
        """
        is_new = captures != self._last_capture
        self._last_capture = captures
        rank, held = reason.row.rank, self._reason.row.rank
        if level is not self._level or rank is None or held is None:
            self._level, self._needed = level, self._first
            return self._give(reason)
        if rank >= held:
            self._needed *= 1 + (rank > held)
            return self._give(reason)
        if not self._agreed or rank > self._waiting_rank:
            self._waiting, self._waiting_rank = reason, rank
        self._agreed += is_new
        return self._give(self._waiting) if self._agreed >= self._needed else self._reason

    def _give(self, reason: Reason) -> Reason:
        self._reason, self._agreed = reason, 0
        return reason
