"""Convert messages to serial bytes and back: E2E profile 4, COBS framing, terminated by 0x00."""

from collections.abc import Iterator

from cobs import cobs

from hri_predict.protocol.messages import Message
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.profile4 import MAX_FRAME, Profile4Receiver, Profile4Sender
from hri_predict.protocol.reception import ReceiveCounters

MAX_DECODED = MAX_FRAME
MAX_ENCODED = MAX_DECODED + 1  # COBS adds one byte up to 254; the 0x00 is not counted


class SerialSender:
    """Encodes messages of one line and keeps their counters."""

    def __init__(self) -> None:
        self._frames = Profile4Sender()

    def watch(self, own: OwnFrames) -> None:
        """Let ``own`` remember the frames sent."""
        self._frames.own = own

    def encode(self, message: Message) -> bytes:
        """Return the bytes of ``message``: one frame, or several for Zone and Pose.

        Raises:
            ValueError: a field cannot hold its value.
        """
        return b"".join(cobs.encode(frame) + b"\0" for frame in self._frames.encode(message))


class Delimited:
    """Finds units in a stream of bytes; buffers at most one.

    Args:
        end: ends each unit.
        longest: size in bytes; only the start of a longer unit is returned, one byte beyond this.
    """

    def __init__(self, end: bytes, longest: int) -> None:
        self._end, self._longest = end, longest
        self.reset()

    def reset(self) -> None:
        """Discard the current unit."""
        self._buffer, self._skipping = b"", False

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Take bytes as they arrive; yield the units that they complete, without empty ones."""
        *ended, rest = data.split(self._end)
        for piece in ended:
            yield from self._keep(piece)
            unit = self._buffer
            self.reset()
            if unit:
                yield unit
        yield from self._keep(rest)

    def _keep(self, piece: bytes) -> Iterator[bytes]:
        if self._skipping:
            return
        self._buffer += piece
        if len(self._buffer) > self._longest:
            start = self._buffer[: self._longest + 1]
            self._buffer, self._skipping = b"", True
            yield start


class SerialReceiver:
    """Finds and decodes frames in a stream of bytes; it counts errors and continues.

    Invalid bytes destroy only the frame that they touch. The buffer never exceeds one frame.
    ``with_items``: see ``Profile4Receiver``.

    Attributes:
        counters: see ``ReceiveCounters``.
    """

    def __init__(self, *, with_items: bool = True) -> None:
        self._frames = Profile4Receiver(with_items=with_items)
        self._stream = Delimited(b"\0", MAX_ENCODED)

    @property
    def counters(self) -> ReceiveCounters:
        """Counts of messages received and of errors."""
        return self._frames.counters

    @property
    def refused(self) -> str:
        """Why the last refused frame with a correct CRC was refused; empty if none was."""
        return self._frames.refused

    def watch(self, own: OwnFrames) -> None:
        """Let ``own`` check frames that only a node sends; these are not passed on."""
        self._frames.own = own

    def reset(self) -> None:
        """Forget sequences and the current frame, as after a reconnection; keep the counters."""
        self._frames.reset()
        self._stream.reset()

    def feed(self, data: bytes) -> list[Message]:
        """Process received bytes; return the fresh messages that they complete, oldest first."""
        return [message for frame in self._stream.feed(data) for message in self._frame(frame)]

    def _frame(self, encoded: bytes) -> list[Message]:
        if len(encoded) > MAX_ENCODED:
            self.counters.malformed += 1
            return []
        try:
            frame = cobs.decode(encoded)
        except cobs.DecodeError:
            self.counters.malformed += 1
            return []
        message = self._frames.take(frame)
        return [] if message is None else [message]
