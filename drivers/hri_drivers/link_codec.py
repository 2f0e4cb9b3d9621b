"""What a link needs to know of its wire: how messages become units, and how long units take."""

from typing import Protocol, TypeVar

from hri_predict.link import LinkCounters
from hri_predict.protocol.messages import Message
from hri_predict.protocol.reception import ReceiveCounters

U = TypeVar("U")


class Codec(Protocol[U]):
    """How one kind of link turns messages into units of its wire and back."""

    def carries(self, message: Message) -> bool:
        """Whether this kind of message travels on this kind of link."""

    def encode(self, message: Message) -> list[U]:
        """Units of one message, protected; advances its counters."""

    def decode(self, unit: U) -> list[Message]:
        """Messages completed by ``unit``; survives anything."""

    def reset(self) -> None:
        """Forget what was under way when the connection was lost."""

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts of errors into ``counters``."""

    def worst_s(self, message: Message) -> float:
        """Seconds of wire that such a message takes at worst."""

    def unit_s(self, unit: U) -> float:
        """Seconds of wire that ``unit`` takes at worst."""

    def raw(self, unit: U) -> bytes:
        """The unit as bytes, for the recorder."""

    def size(self, unit: U) -> int:
        """Payload bytes, for the counters."""


def copy_counts(receiver: ReceiveCounters, counters: LinkCounters, no_frames: int = 0) -> None:
    """What every codec shows of its receiver's errors.

    ``no_frames`` is how many units the transport refused before they came to the receiver.
    """
    counters.crc_errors = receiver.crc_errors
    counters.counter_errors = receiver.counter_errors
    counters.malformed = receiver.malformed + no_frames
    counters.incomplete = receiver.incomplete
    counters.ignored = receiver.ignored
