"""Worst-case number of bits of a message on the wire, for the load of a link.

Sources: ISO 11898-1:2015 frame formats; the worst case of bit stuffing on classic CAN is
8 n + g + 13 + floor((g + 8 n - 1) / 4) with g = 34 (11-bit ids) or 54 (29-bit), R. I. Davis et al.,
"Controller Area Network (CAN) schedulability analysis", Real-Time Systems 35 (2007), eq. 1.
"""

from typing import Literal, NamedTuple

from hri_predict.protocol import e2e
from hri_predict.protocol.can import CLASSIC_BYTES, fd_length
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.fields import PART_BYTES, Definition
from hri_predict.protocol.messages import Message

LinkKind = Literal["can", "can_fd", "serial"]


class StateShape(NamedTuple):
    """Properties that determine the number of parts of a robot's RobotState."""

    joints: int = 6
    moving_base: bool = False


SIX_JOINTS = StateShape()


class WireBits(NamedTuple):
    """Bits at the nominal bit rate, and at the data bit rate (CAN FD with bit-rate switch)."""

    nominal: int
    data: int

    def seconds(self, bitrate: float, data_bitrate: float | None = None) -> float:
        """Return the time on the wire."""
        return self.nominal / bitrate + self.data / (data_bitrate or bitrate)


def classic_bits(length: int, extended: bool = False) -> int:
    """Worst case of a classic data frame of ``length`` bytes and the interframe space after it."""
    stuffed = 54 if extended else 34
    return 8 * length + stuffed + 13 + (stuffed + 8 * length - 1) // 4


def fd_bits(length: int, extended: bool = False) -> WireBits:
    """Worst case of an FD frame of ``length`` bytes and the interframe space after it.

    Nominal: start to bit-rate switch (17 bits, 36 with 29-bit ids) with a stuff bit after every
    four bits; CRC delimiter, acknowledgement (two bits), its delimiter, end of frame, pause. Data:
    error state and length (5 bits), data, their stuff bits; stuff count (4), CRC 17 (to 16 bytes)
    or 21, with 6 or 7 fixed stuff bits.
    """
    head = 36 if extended else 17
    head_stuff = (head - 1) // 4
    body = 5 + 8 * length
    stuff = (head + body - 1) // 4 - head_stuff
    crc = 4 + (17 + 6 if length <= 16 else 21 + 7)
    return WireBits(head + head_stuff + 1 + 2 + 1 + 7 + 3, body + stuff + crc)


def wire_bits(
    message_type: type[Message],
    kind: LinkKind,
    extended: bool = False,
    items: int | None = None,
    *,
    shape: StateShape = SIX_JOINTS,
) -> WireBits:
    """Worst-case bits of all frames of one message.

    Args:
        message_type: class of the message.
        kind: "can", "can_fd" or "serial" (8 data bits, no parity: 10 bits a byte).
        extended: 29-bit CAN ids.
        items: capsules of a Zone, joints of a Pose; default: as many as one frame carries.
        shape: shape of the robot, for a RobotState.

    Raises:
        ValueError: classic CAN does not carry this message.
    """
    definition = BY_TYPE[message_type]
    if kind == "can":
        if not definition.classic:
            raise ValueError(f"classic CAN does not carry {definition.name}")
        parts = definition.always + len(_extra_parts(definition, shape))
        return WireBits(parts * classic_bits(CLASSIC_BYTES, extended), 0)
    if kind == "serial" and definition.extra:
        last = max((definition.always - 1, *_extra_parts(definition, shape)))
        return WireBits(_serial_bits(PART_BYTES * (last + 1)), 0)
    room = definition.items_per_frame
    left = max(0, room if items is None else items)
    nominal = data = 0
    while True:
        payload = definition.fixed_bytes + min(left, room) * definition.item_bytes
        if kind == "serial":
            nominal += _serial_bits(payload)
        else:
            bits = fd_bits(fd_length(definition, payload), extended)
            nominal, data = nominal + bits.nominal, data + bits.data
        left -= room
        if left <= 0:
            return WireBits(nominal, data)


def _serial_bits(payload: int) -> int:
    return 10 * (e2e.PROFILE_4_HEADER + payload + 2)  # COBS overhead and 0x00


def _extra_parts(definition: Definition, shape: StateShape) -> list[int]:
    """Return the extra parts of a message that this shape needs."""
    raw = {"JOINTS": shape.joints, "BASE": int(shape.moving_base)}
    return [e.part for e in definition.extra if raw[e.signal] >= e.least]
