"""Messages that the node leaves out when its ticks take too long: first poses, then zones.

Status and Advice are never left out, and no computation for them is skipped. A late tick delays
advice; a missing Pose or Zone does not.
"""

from collections import deque
from collections.abc import Sequence

from hri_predict.protocol.messages import Message, Pose, Zone

HIGH = 0.8
"""Share of a tick's time above which it is nearly late."""
LOW = 0.6
"""Share of a tick's time below which a kind is restored; a kind saves less than the difference."""
SHED_TICKS, OF_TICKS = 2, 5
"""Number of ticks that counts, of the last ``OF_TICKS``, because one may be chance: above ``HIGH``,
one more kind is left out; above ``LOW``, the time to restore starts again.
"""
RESTORE_NS = 5_000_000_000
"""Time for which ticks must stay below ``LOW`` before one message kind is restored."""
LONGEST_NS = 80_000_000_000
"""Maximum to which ``RESTORE_NS`` is doubled if ticks soon become too long again."""
ORDER: Sequence[type[Message]] = (Pose, Zone)


class Shedding:
    """Decides from the ticks' durations; without durations (virtual time) nothing is left out.

    Attributes:
        without: kind of message -> number of ticks without it.
        sheds: number of times that one more kind was left out.
    """

    def __init__(self) -> None:
        self.without: dict[type[Message], int] = dict.fromkeys(ORDER, 0)
        self.sheds = 0
        self._left_out = 0  # of ``ORDER``
        self._high: deque[bool] = deque(maxlen=OF_TICKS)  # of the newest ticks
        self._not_low: deque[bool] = deque(maxlen=OF_TICKS)
        self._calm_since_ns: int | None = None
        self._patience_ns = RESTORE_NS
        self._restored_ns: int | None = None

    def leaves_out(self, kind: type[Message]) -> bool:
        """Whether messages of this kind are left out now."""
        return kind in ORDER[: self._left_out]

    @property
    def active(self) -> bool:
        """Whether anything is left out now."""
        return self._left_out > 0

    def note(self, used: float, now_ns: int) -> None:
        """Process the share of its time used by the tick at ``now_ns``."""
        for kind in ORDER[: self._left_out]:
            self.without[kind] += 1
        self._high.append(used > HIGH)
        self._not_low.append(used >= LOW)
        if sum(self._not_low) >= SHED_TICKS:
            self._calm_since_ns = None
        elif used < LOW and self._calm_since_ns is None:
            self._calm_since_ns = now_ns
        if sum(self._high) >= SHED_TICKS:
            self._shed(now_ns)
        elif self.active and self._is_calm(now_ns):
            self._left_out -= 1
            self._restored_ns = self._calm_since_ns = now_ns

    def _shed(self, now_ns: int) -> None:
        self._high.clear()
        self._not_low.clear()
        if self._left_out == len(ORDER):
            return
        self._left_out += 1
        self.sheds += 1
        if self._restored_ns is not None:  # was it restored too soon?
            soon = now_ns - self._restored_ns < self._patience_ns
            self._patience_ns = min(2 * self._patience_ns, LONGEST_NS) if soon else RESTORE_NS
            self._restored_ns = None

    def _is_calm(self, now_ns: int) -> bool:
        since_ns = self._calm_since_ns
        return since_ns is not None and now_ns - since_ns >= self._patience_ns
