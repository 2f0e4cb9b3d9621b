"""Zone and Pose on their way: what load remains carries them, one frame after the other."""

from collections import deque
from typing import Generic, TypeVar

from hri_drivers.link_codec import Codec
from hri_drivers.link_slots import Budget, Slots
from hri_predict.link import LinkCounters
from hri_predict.protocol.messages import Message, at_encoding

U = TypeVar("U")

STALE_NS = 500_000_000  # a zone from an older capture is of no use any more


class Bulk(Generic[U]):
    """Takes Zone and Pose out of their slots, within a budget, and deals out their units.

    The link's writing thread alone calls it.
    """

    def __init__(
        self, slots: Slots, codec: Codec[U], budget: Budget, counters: LinkCounters
    ) -> None:
        self.budget = budget
        self._slots = slots
        self._codec = codec
        self._counters = counters
        self._under_way: deque[U] = deque()  # units of a message that has begun to go

    @property
    def waiting(self) -> bool:
        """Whether there is something that could go as soon as the wire is free."""
        return bool(self._under_way) or self._slots.has_bulk()

    def patience_s(self) -> float | None:
        """How long the link may sleep although a message is under way; ``None``: for ever."""
        return None

    def next(self, now_ns: int) -> U | None:
        """The unit to write next, ``None`` if none may go now.

        Raises:
            ValueError: no field holds some value of a message; it is given up.
        """
        if not self._under_way:
            message = self._take(now_ns)
            if message is None:
                return None
            self._under_way.extend(self._codec.encode(at_encoding(message, now_ns)))
        return self._under_way[0]

    def sent(self) -> bool:
        """Note that what ``next`` gave was written; whether that was the end of a message."""
        self.budget.spend(self._codec.unit_s(self._under_way.popleft()))
        return not self._under_way

    def give_up(self) -> None:
        """Forget the message under way: the wire failed it, and a newer one will come."""
        self._counters.decimated += bool(self._under_way)
        self._under_way.clear()

    def _take(self, now_ns: int) -> Message | None:
        """The message that has waited longest, if there is wire time for it."""
        while (message := self._slots.pop_bulk()) is not None:
            capture_ns = getattr(message, "capture_ns", None)
            worst_s = self._codec.worst_s(message)
            stale = capture_ns is not None and now_ns - capture_ns > STALE_NS
            if stale or worst_s > self.budget.depth_s:
                self._counters.decimated += 1
            elif self.budget.fits(worst_s, now_ns):
                return message
            else:
                if not self._slots.put_back(message):  # else it keeps its place in the line
                    self._counters.decimated += 1
                return None
        return None
