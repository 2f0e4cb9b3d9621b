"""Interface between a link and its wire: units of messages, and their time on the wire."""

from typing import Generic, Protocol, TypeVar

from hri_predict.contracts.link import LinkCounters
from hri_predict.protocol.messages import Message, Pose, RobotState, Zone
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters
from hri_predict.protocol.wire import SIX_JOINTS, StateShape

U = TypeVar("U")
F = TypeVar("F", contravariant=True)


class Codec(Protocol[U]):
    """Converts messages to units of one kind of wire and back."""

    def carries(self, message: Message) -> bool:
        """Whether this kind of link carries the message."""

    def watch(self, own: OwnFrames) -> None:
        """Act as the node's end from now on, and report every sent frame to ``own``.

        ``own`` also gets received frames with ids that only a node sends; they are not decoded.
        """

    def encode(self, message: Message) -> list[U]:
        """Units of one message, protected; advances its counters."""

    def decode(self, unit: U) -> list[Message]:
        """Messages completed by ``unit``; never raises."""

    def reset(self) -> None:
        """Discard incomplete messages: the connection was lost."""

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's error counts into ``counters``."""

    def worst_s(self, message: Message) -> float:
        """Worst-case seconds on the wire of the message."""

    def unit_s(self, unit: U) -> float:
        """Worst-case seconds on the wire of ``unit``."""

    def raw(self, unit: U) -> bytes:
        """The unit as bytes, for the recorder."""

    def size(self, unit: U) -> int:
        """Payload bytes, for the counters."""


class _Frames(Protocol[F]):
    """A receiver of protected frames; ``hri_predict.protocol`` has one for each kind of wire."""

    @property
    def counters(self) -> ReceiveCounters: ...

    def watch(self, own: OwnFrames) -> None: ...

    def feed(self, unit: F, /) -> list[Message]: ...

    def reset(self) -> None: ...


class FrameCodec(Generic[U]):
    """Parts common to codecs that carry every message, with a receiver of protected frames."""

    def __init__(self, receiver: _Frames[U]) -> None:
        self._receiver = receiver

    def carries(self, message: Message) -> bool:
        """True: everything."""
        return True

    def decode(self, unit: U) -> list[Message]:
        """Messages that this unit completes."""
        return self._receiver.feed(unit)

    def reset(self) -> None:
        """Discard incomplete messages."""
        self._receiver.reset()

    def count(self, counters: LinkCounters) -> None:
        """Copy the receiver's counts."""
        copy_counts(self._receiver.counters, counters)

    @property
    def refused(self) -> str:
        """The last reason for refusing a whole message, if the receiver reports it."""
        return str(getattr(self._receiver, "refused", ""))


def copy_counts(receiver: ReceiveCounters, counters: LinkCounters, no_frames: int = 0) -> None:
    """Copy a receiver's error counts into the link's counters.

    ``no_frames`` is the number of units that the transport refused before the receiver saw them.
    """
    counters.crc_errors = receiver.crc_errors
    counters.counter_errors = receiver.counter_errors
    counters.malformed = receiver.malformed + no_frames
    counters.incomplete = receiver.incomplete
    counters.ignored = receiver.ignored


def item_count(message: Message) -> int | None:
    """Number of capsules of a Zone or joints of a Pose; ``None`` for other messages."""
    if isinstance(message, Zone):
        return len(message.capsules)
    return len(message.joints) if isinstance(message, Pose) else None


def shape_of(message: Message) -> StateShape:
    """Return the properties that determine the length of this message, if it is a RobotState."""
    if isinstance(message, RobotState):
        return StateShape(len(message.positions), message.base is not None)
    return SIX_JOINTS
