"""Messages to bytes of a serial line and back: E2E profile 4, framed by COBS, ended by 0x00."""

from cobs import cobs

from hri_predict.protocol import e2e
from hri_predict.protocol.codec import (
    Malformed,
    decode_payload,
    encode_payloads,
    robot_of,
)
from hri_predict.protocol.definition import BY_TYPE, DEFINITIONS, frame_number, frame_table
from hri_predict.protocol.messages import Message
from hri_predict.protocol.reception import ReceiveCounters, fresh

MAX_DECODED = e2e.PROFILE_4_HEADER + max(d.max_bytes for d in DEFINITIONS)
MAX_ENCODED = MAX_DECODED + 1  # COBS adds one byte up to 254; the 0x00 is not counted


class SerialSender:
    """Encodes messages of one line; keeps the counters of everything it sends."""

    def __init__(self) -> None:
        self._counters: dict[int, int] = {}

    def encode(self, message: Message) -> bytes:
        """Return the bytes of ``message``: one frame, or for Zone and Pose as many as they need.

        Raises:
            ValueError: a field cannot hold its value.
        """
        number = frame_number(BY_TYPE[type(message)], robot_of(message))
        return b"".join(self._frame(number, payload) for payload in encode_payloads(message))

    def _frame(self, number: int, payload: bytes) -> bytes:
        counter = self._counters.get(number, 0)
        self._counters[number] = (counter + 1) & 0xFFFF
        return cobs.encode(e2e.protect_profile4(counter, payload, e2e.data_id_32(number))) + b"\0"


class SerialReceiver:
    """Finds and decodes frames in a stream of bytes; whatever comes, it counts and goes on.

    Garbage costs at most the frame that it touches. No more than one frame is ever kept.

    Attributes:
        counters: see ``ReceiveCounters``.
    """

    def __init__(self) -> None:
        self._table = {e2e.data_id_32(n): entry for n, entry in frame_table(classic=False).items()}
        self._sequences: dict[int, e2e.CounterCheck] = {}
        self._buffer = b""
        self._skipping = False
        self.counters = ReceiveCounters()

    def reset(self) -> None:
        """Forget sequences and the frame under way, as after a reconnection; counters stay."""
        self._sequences.clear()
        self._buffer, self._skipping = b"", False

    def feed(self, data: bytes) -> list[Message]:
        """Take bytes as they come; return the fresh messages that they complete, oldest first."""
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
        """Add to the frame under way; what grows too long is no frame, skip it to its end."""
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
        if not e2e.check_profile4(frame):
            self.counters.crc_errors += 1
            return []
        data_id = int.from_bytes(frame[4:8], "big")
        known = self._table.get(data_id)
        if known is None:
            self.counters.ignored += 1
            return []
        definition, robot, _ = known
        sequence = self._sequences.get(data_id)
        if sequence is None:
            sequence = self._sequences[data_id] = e2e.CounterCheck(0x10000)
        counter = int.from_bytes(frame[2:4], "big")
        if definition.sequenced and not fresh(sequence, counter, self.counters):
            return []
        try:
            message = decode_payload(definition, robot, frame[e2e.PROFILE_4_HEADER :])
        except Malformed:
            self.counters.malformed += 1
            return []
        self.counters.received += 1
        return [message]
