"""Convert messages to E2E profile 4 frames and back, for transports with their own framing.

A serial line adds COBS (``protocol.serial``). A zenoh message contains the frames unchanged; an
ISO-TP transfer contains one complete Zone or Pose.
"""

from hri_predict.protocol import e2e
from hri_predict.protocol.codec import Malformed, decode_payload, encode_payloads, robot_of
from hri_predict.protocol.definition import (
    BY_TYPE,
    DEFINITIONS,
    MAX_ITEMS,
    frame_table,
    needed_bytes,
)
from hri_predict.protocol.fields import frame_number
from hri_predict.protocol.messages import Message
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters, fresh

MAX_FRAME = e2e.PROFILE_4_HEADER + max(d.max_bytes for d in DEFINITIONS)
MAX_WHOLE = e2e.PROFILE_4_HEADER + max(
    d.fixed_bytes + MAX_ITEMS * d.item_bytes for d in DEFINITIONS
)
"""Length of a frame with all items of a Zone: 3847 bytes, within ISO-TP's 4095."""


class Profile4Sender:
    """Encodes messages of one connection and keeps their counters.

    ``items``: maximum number of items of a Zone or Pose in one frame; default: as on a serial line.

    Attributes:
        own: remembers the frames sent; ``None``: not used.
    """

    def __init__(self, items: int | None = None) -> None:
        self._items = items
        self.own: OwnFrames | None = None
        self._counters: dict[int, int] = {}

    def encode(self, message: Message) -> list[bytes]:
        """Return the frames of ``message``: one, or several for Zone and Pose.

        Raises:
            ValueError: a field cannot hold its value.
        """
        definition = BY_TYPE[type(message)]
        number = frame_number(definition, robot_of(message))
        payloads = encode_payloads(message, self._items)
        if definition.extra:
            payloads = [payload[: needed_bytes(definition, payload)] for payload in payloads]
        return [self._frame(number, payload) for payload in payloads]

    def _frame(self, number: int, payload: bytes) -> bytes:
        counter = self._counters.get(number, 0)
        self._counters[number] = (counter + 1) & 0xFFFF
        frame = e2e.protect_profile4(counter, payload, e2e.data_id_32(number))
        if self.own is not None:
            self.own.sent(frame)
        return frame


class Profile4Receiver:
    """Decodes frames; it counts errors and continues.

    ``items``: maximum number of items of a Zone or Pose in one frame; default: as on a serial line.
    ``with_items``: whether to unpack the items.

    Attributes:
        counters: see ``ReceiveCounters``.
        own: set if the receiver belongs to a node: checks frames that only a node sends; these are
            not passed on.
    """

    def __init__(self, items: int | None = None, *, with_items: bool = True) -> None:
        self._items, self._with_items = items, with_items
        self.own: OwnFrames | None = None
        self._table = {e2e.data_id_32(n): entry for n, entry in frame_table(classic=False).items()}
        self._sequences: dict[int, e2e.CounterCheck] = {}
        self.counters = ReceiveCounters()
        self.refused = ""

    def reset(self) -> None:
        """Forget sequences, as after a reconnection; keep the counters."""
        self._sequences.clear()

    def take(self, frame: bytes) -> Message | None:
        """Return the message in one frame if it is valid, fresh and uses our definitions."""
        if not e2e.check_profile4(frame):
            self.counters.crc_errors += 1
            return None
        data_id = int.from_bytes(frame[4:8], "big")
        known = self._table.get(data_id)
        if known is None:
            self.counters.ignored += 1
            return None
        definition, robot, _ = known
        if self.own is not None and definition.sender == "node":
            self.own.hear(frame)
            return None
        sequence = self._sequences.get(data_id)
        if sequence is None:
            sequence = self._sequences[data_id] = e2e.CounterCheck(0x10000)
        counter = int.from_bytes(frame[2:4], "big")
        if definition.sequenced and not fresh(sequence, counter, self.counters):
            return None
        try:
            payload = frame[e2e.PROFILE_4_HEADER :]
            message = decode_payload(
                definition, robot, payload, self._items, with_items=self._with_items
            )
        except Malformed as error:
            self.counters.malformed += 1
            self.refused = str(error)
            return None
        self.counters.received += 1
        return message


class Profile4Payloads:
    """Base class of receivers for payloads that contain profile 4 frames."""

    def __init__(self) -> None:
        self._frames = Profile4Receiver()

    @property
    def counters(self) -> ReceiveCounters:
        """Counts of messages received and of errors."""
        return self._frames.counters

    def watch(self, own: OwnFrames) -> None:
        """Let ``own`` check frames that only a node sends; these are not passed on."""
        self._frames.own = own

    def reset(self) -> None:
        """Forget sequences, as after a reconnection; keep the counters."""
        self._frames.reset()
