"""Convert messages to serial bytes and back: E2E profile 4, COBS framing, terminated by 0x00."""

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


class SerialReceiver:
    """Finds and decodes frames in a stream of bytes; it counts errors and continues.

    Invalid bytes destroy only the frame that they touch. The buffer never exceeds one frame.
    ``with_items``: see ``Profile4Receiver``.

    Attributes:
        counters: see ``ReceiveCounters``.
    """

    def __init__(self, *, with_items: bool = True) -> None:
        self._frames = Profile4Receiver(with_items=with_items)
        self._buffer = b""
        self._skipping = False

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
        self._buffer, self._skipping = b"", False

    def feed(self, data: bytes) -> list[Message]:
        """Process received bytes; return the fresh messages that they complete, oldest first."""
        messages: list[Message] = []
        *ended, rest = data.split(b"\0")
        for piece in ended:
            self._keep(piece)
            if self._buffer:
                messages += self._frame(self._buffer)
            self._buffer, self._skipping = b"", False
        self._keep(rest)
        return messages

    def _keep(self, piece: bytes) -> None:
        """Append to the current frame; discard a frame that becomes too long."""
        if self._skipping:
            return
        if len(self._buffer) + len(piece) > MAX_ENCODED:
            self.counters.malformed += 1
            self._buffer, self._skipping = b"", True
            return
        self._buffer += piece

    def _frame(self, encoded: bytes) -> list[Message]:
        try:
            frame = cobs.decode(encoded)
        except cobs.DecodeError:
            self.counters.malformed += 1
            return []
        message = self._frames.take(frame)
        return [] if message is None else [message]
