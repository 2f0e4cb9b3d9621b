"""Transfers of Zone and Pose, which use the spare load, one frame after another."""

from collections import deque
from typing import Generic, TypeVar

from hri_drivers.links.codec import Codec
from hri_drivers.links.slots import Budget, Slots
from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol.messages import Message, at_encoding

U = TypeVar("U")

STALE_NS = 500_000_000  # a zone from an older capture is useless


class Bulk(Generic[U]):
    """Takes Zone and Pose out of their slots within a budget, and returns their units.

    Only the link's writing thread calls it.
    """

    def __init__(
        self, slots: Slots, codec: Codec[U], budget: Budget, counters: LinkCounters
    ) -> None:
        self.budget = budget
        self._slots = slots
        self._codec = codec
        self._counters = counters
        self._under_way: deque[U] = deque()  # remaining units of a message already started

    @property
    def waiting(self) -> bool:
        """Whether a unit could be sent as soon as the wire is free."""
        return bool(self._under_way) or self._slots.has_bulk()

    def patience_s(self) -> float | None:
        """Return the link's maximum sleep while a message is in transit; ``None``: no limit."""
        return None

    def next(self, now_ns: int) -> U | None:
        """The unit to write next, ``None`` if none may be sent now.

        Raises:
            ValueError: a value of the message does not fit its field; the message is dropped.
        """
        if not self._under_way:
            message = self._take(now_ns)
            if message is None:
                return None
            self._under_way.extend(self._codec.encode(at_encoding(message, now_ns)))
        return self._under_way[0]

    def sent(self) -> bool:
        """Note that the unit from ``next`` was written; return whether it ended a message."""
        self.budget.spend(self._codec.unit_s(self._under_way.popleft()))
        return not self._under_way

    def give_up(self) -> None:
        """Drop the message in transit: the wire failed, and a newer message will follow."""
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
                if not self._slots.put_back(message):  # else it keeps its place in the queue
                    self._counters.decimated += 1
                return None
        return None
