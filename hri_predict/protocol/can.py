"""Messages to CAN frames and back: classic (AUTOSAR E2E profile 2) and FD (profile 5)."""

from dataclasses import dataclass
from functools import cache

from hri_predict.base.errors import ConfigError
from hri_predict.protocol import e2e
from hri_predict.protocol.codec import (
    Malformed,
    decode_payload,
    encode_payloads,
    robot_of,
)
from hri_predict.protocol.definition import (
    BY_TYPE,
    frame_table,
    needed_parts,
)
from hri_predict.protocol.fields import (
    PART_BYTES,
    Definition,
    frame_number,
)
from hri_predict.protocol.messages import Message
from hri_predict.protocol.own_frames import OwnFrames
from hri_predict.protocol.reception import ReceiveCounters, fresh

DEFAULT_BASE_ID = 0x680  # up to 0x6DF: neither a default nor a reserved id of CANopen
LAST_NUMBER = max((*frame_table(classic=True), *frame_table(classic=False)))
ISOTP_NUMBER = 0x46  # default id of the node's segments: base id plus this
FLOW_CONTROL_NUMBER = 0x47  # suggested id of the peer's answers: base id plus this
CLASSIC_BYTES = e2e.PROFILE_2_HEADER + PART_BYTES
FD_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
_FD_LENGTH = [next(n for n in FD_LENGTHS if n >= length) for length in range(FD_LENGTHS[-1] + 1)]


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One frame on the bus; ``extended`` for 29-bit ids."""

    arbitration_id: int
    data: bytes
    fd: bool = False
    extended: bool = False


def check_base_id(base_id: int, extended: bool) -> None:
    """Refuse a base id that is too high for all ids to fit.

    Raises:
        ConfigError: names the allowed range.
    """
    highest = (0x1FFFFFFF if extended else 0x7FF) - LAST_NUMBER
    if not 0 <= base_id <= highest:
        bits = 29 if extended else 11
        raise ConfigError(
            f"base_id {base_id:#x} leaves no room for {bits}-bit ids; "
            f"choose one between 0x0 and {highest:#x}"
        )


def fd_length(definition: Definition, payload_bytes: int) -> int:
    """Length of the FD frame that carries a payload.

    A Zone, Pose or RobotState always has the length of a full frame, regardless of its content,
    because a DBC gives each id one length.
    """
    if definition.item:
        payload_bytes = definition.max_bytes
    return _FD_LENGTH[e2e.PROFILE_5_HEADER + payload_bytes]


def padded(definition: Definition, payload: bytes) -> bytes:
    """Pad an FD payload with zeros to its length in the frame."""
    length = fd_length(definition, len(payload)) - e2e.PROFILE_5_HEADER
    return payload + bytes(length - len(payload))


class CanSender:
    """Encodes messages of one link and keeps their counters.

    Attributes:
        own: remembers each frame sent; ``None``: not used.
    """

    def __init__(self, fd: bool = False, base_id: int = DEFAULT_BASE_ID, extended: bool = False):
        check_base_id(base_id, extended)
        self._fd, self._base, self._extended = fd, base_id, extended
        self.own: OwnFrames | None = None
        self._counters: dict[int, int] = {}

    def carries(self, message_type: type[Message]) -> bool:
        """Whether this kind of CAN carries the message."""
        return self._fd or BY_TYPE[message_type].classic

    def encode(self, message: Message) -> list[CanFrame]:
        """Return the frames of ``message`` in sending order.

        Raises:
            ValueError: classic CAN does not carry this message, or not for this robot, or a field
                cannot hold its value.
        """
        definition = BY_TYPE[type(message)]
        if not self.carries(definition.type):
            raise ValueError(f"classic CAN does not carry {definition.name}; use FD or serial")
        number = frame_number(definition, robot_of(message))
        payloads = encode_payloads(message)
        if self._fd:
            frames = [self._fd_frame(number, padded(definition, payload)) for payload in payloads]
        else:
            frames = self._classic_frames(definition, number, payloads[0])
        if self.own is not None:
            for frame in frames:
                self.own.sent(frame)
        return frames

    def _classic_frames(self, definition: Definition, first: int, payload: bytes) -> list[CanFrame]:
        places = _places(first, needed_parts(definition, payload))
        counter = self._next(first)
        return [
            CanFrame(
                self._base + number,
                e2e.protect_profile2(counter, payload[start : start + PART_BYTES], ids),
                False,
                self._extended,
            )
            for number, start, ids in places
        ]

    def _fd_frame(self, number: int, payload: bytes) -> CanFrame:
        data = e2e.protect_profile5(self._next(number), payload, e2e.data_id_16(number))
        return CanFrame(self._base + number, data, True, self._extended)

    def _next(self, number: int) -> int:
        counter = self._counters.get(number, 0)
        self._counters[number] = (counter + 1) & 0xFF
        return counter


_CLASSIC = frame_table(classic=True)
_ID_LISTS = {number: e2e.data_id_list(number) for number in _CLASSIC}


@cache
def _places(first: int, parts: frozenset[int]) -> tuple[tuple[int, int, bytes], ...]:
    """Return number, first payload byte and data ids of each frame of the message whose part 0 has
    the number ``first``, in sending order.
    """
    definition, robot, _ = _CLASSIC[first]
    numbers = {part: frame_number(definition, robot, part) for part in sorted(parts)}
    return tuple((number, part * PART_BYTES, _ID_LISTS[number]) for part, number in numbers.items())


class _Stream:
    """State of one message (of one robot): its sequence, and the parts received so far."""

    __slots__ = ("closed", "counter", "parts", "sequence")

    def __init__(self) -> None:
        self.sequence = e2e.CounterCheck(256)
        self.counter: int | None = None  # of the parts below
        self.parts: dict[int, bytes] = {}
        self.closed = False  # complete, or void: no part of this counter counts any more


class CanReceiver:
    """Decodes frames of one link; it counts errors and continues.

    A multi-frame message is complete when all the parts that its part 0 asks for have arrived with
    the same counter. Until then, a repeated part or a part that part 0 does not ask for discards
    the message, because the parts may come from two senders.

    Attributes:
        counters: see ``ReceiveCounters``.
        refused: why the last refused message with a correct CRC was refused; empty if none was.
        own: set if the receiver belongs to a node: checks complete frames that only a node sends;
            these are not passed on.
    """

    def __init__(self, fd: bool = False, base_id: int = DEFAULT_BASE_ID, extended: bool = False):
        check_base_id(base_id, extended)
        self._fd, self._base, self._extended = fd, base_id, extended
        self._table = frame_table(classic=not fd)
        self.own: OwnFrames | None = None
        self._streams: dict[int, _Stream] = {}
        self.counters = ReceiveCounters()
        self.refused = ""

    def reset(self) -> None:
        """Forget sequences and incomplete messages, as after a reconnection; keep the counters."""
        self._streams.clear()

    def feed(self, frame: CanFrame) -> list[Message]:
        """Process one frame; return the message that it completes, if the message is fresh."""
        known = self._table.get(frame.arbitration_id - self._base)
        if known is None or frame.extended != self._extended:
            self.counters.ignored += 1
            return []
        definition, robot, part = known
        if self.own is not None and definition.sender == "node":
            self._judge(frame, self.own)
            return []
        number = frame_number(definition, robot)
        if frame.fd != self._fd:
            self.counters.malformed += 1
            return []
        stream = self._streams.get(number)
        if stream is None:
            stream = self._streams[number] = _Stream()
        if self._fd:
            payload = self._fd_payload(frame.data, number, definition)
            counter = frame.data[2] if payload is not None else 0
        else:
            payload = self._classic_payload(
                data=frame.data,
                stream=stream,
                number=frame.arbitration_id - self._base,
                part=part,
                definition=definition,
            )
            counter = frame.data[1] if payload is not None else 0
        if payload is None:
            return []
        if definition.sequenced and not fresh(stream.sequence, counter, self.counters):
            return []
        return self._decoded(definition, robot, payload)

    def _judge(self, frame: CanFrame, own: OwnFrames) -> None:
        """Count a frame with a node's id: an echo, a frame from another node, or a damaged one.

        Another node may send classic frames on an FD bus.
        """
        number = frame.arbitration_id - self._base
        if own.came_back(frame):
            return
        if frame.fd:
            whole = e2e.check_profile5(frame.data, e2e.data_id_16(number))
        elif len(frame.data) != CLASSIC_BYTES or number not in _ID_LISTS:
            self.counters.malformed += 1
            return
        else:
            whole = e2e.check_profile2(frame.data, _ID_LISTS[number])
        own.foreign += whole
        self.counters.crc_errors += not whole

    def _fd_payload(self, data: bytes, number: int, definition: Definition) -> bytes | None:
        if not e2e.check_profile5(data, e2e.data_id_16(number)):
            self.counters.crc_errors += 1
            return None
        if definition.extra and len(data) < e2e.PROFILE_5_HEADER + definition.fixed_bytes:
            self.counters.malformed += 1
            return None
        return data[e2e.PROFILE_5_HEADER :]

    def _classic_payload(
        self, *, data: bytes, stream: _Stream, number: int, part: int, definition: Definition
    ) -> bytes | None:
        """Return the payload if ``data`` is its last missing part; parts not needed are zeros."""
        if len(data) != CLASSIC_BYTES:
            self.counters.malformed += 1
            return None
        if not e2e.check_profile2(data, _ID_LISTS[number]):
            self.counters.crc_errors += 1
            return None
        if definition.parts == 1:
            return data[2:]
        if data[1] != stream.counter:
            self._start(stream, data[1])
        elif stream.closed or part in stream.parts:
            self._void(stream)
            return None
        stream.parts[part] = data[2:]
        if 0 not in stream.parts:
            return None
        needed = needed_parts(definition, stream.parts[0])
        if not needed >= stream.parts.keys():
            self._void(stream)
            return None
        if len(stream.parts) < len(needed):
            return None
        stream.closed = True
        nothing = bytes(PART_BYTES)
        return b"".join(stream.parts.get(i, nothing) for i in range(definition.parts))

    def _void(self, stream: _Stream) -> None:
        self.counters.counter_errors += 1
        stream.closed = True
        stream.sequence.repeated()

    def _start(self, stream: _Stream, counter: int) -> None:
        if stream.counter is not None and not stream.closed:
            self.counters.incomplete += 1
        stream.counter, stream.closed = counter, False
        stream.parts = {}

    def _decoded(self, definition: Definition, robot: int, payload: bytes) -> list[Message]:
        try:
            message = decode_payload(definition, robot, payload)
        except Malformed as error:
            self.counters.malformed += 1
            self.refused = str(error)
            return []
        self.counters.received += 1
        return [message]
