"""The parts of ``drivers/PROTOCOL.md`` on Zone and Pose over CAN: sizes, and an ISO-TP example.

A test compares the example with the frames that the CAN link sends.
"""

from math import ceil

from hri_predict.base.skeleton import CANONICAL, JOINTS
from hri_predict.protocol import e2e
from hri_predict.protocol.can import (
    CLASSIC_BYTES,
    DEFAULT_BASE_ID,
    FLOW_CONTROL_NUMBER,
    ISOTP_NUMBER,
)
from hri_predict.protocol.definition import BY_TYPE, MAX_ITEMS
from hri_predict.protocol.fields import Definition
from hri_predict.protocol.generate.examples import fields_of, meaning
from hri_predict.protocol.messages import Pose, Zone
from hri_predict.protocol.profile4 import Profile4Sender
from hri_predict.protocol.wire import classic_bits

EXAMPLE = Pose(person=7, step=5, horizon_s=0.2, joints=((3, 1.25, -0.5, 1.62),), age_s=0.03)
_IN_FIRST, _IN_NEXT = 6, 7  # message bytes in the first segment, and in each of the others
_PADDING = b"\xcc"


def _length(definition: Definition, items: int) -> int:
    return e2e.PROFILE_4_HEADER + definition.fixed_bytes + items * definition.item_bytes


def fd_frames() -> str:
    """Return the numbers of FD frames that a whole body takes."""
    frames = [
        ceil(count / BY_TYPE[kind].items_per_frame)
        for kind, count in ((Zone, len(CANONICAL.segments)), (Pose, len(JOINTS)))
    ]
    return (
        f"A Zone of {len(CANONICAL.segments)} capsules takes {frames[0]} frames, a Pose of "
        f"{len(JOINTS)} joints {frames[1]}.\n"
    )


def sizes() -> str:
    """Return the sizes of messages by ISO-TP, and the time that one takes."""
    zone, pose, count = BY_TYPE[Zone], BY_TYPE[Pose], len(CANONICAL.segments)
    length, largest = _length(zone, count), max(_length(d, MAX_ITEMS) for d in (zone, pose))
    more = ceil((length - _IN_FIRST) / _IN_NEXT)
    wire_ms = (2 + more) * classic_bits(CLASSIC_BYTES) / 500
    ids = " or ".join(f"16#{e2e.data_id_32(d.number):08X} ({d.name})" for d in (zone, pose))
    return (
        f"{MAX_ITEMS} items are {largest} bytes of ISO-TP's 4095. A Zone of {count} "
        f"capsules is {e2e.PROFILE_4_HEADER} + {zone.fixed_bytes} + {count} × {zone.item_bytes} = "
        f"{length} bytes: a first frame, the peer's flow control, {more} segments; "
        f"{wire_ms:.1f} ms of wire at 500 kbit/s. The data id is {ids}.\n"
    )


def example() -> str:
    """Return the frames of one Pose, and what begins in each."""
    (whole,) = Profile4Sender(MAX_ITEMS).encode(EXAMPLE)
    begins = [
        (0, f"length 16#{whole[:2].hex().upper()}"),
        (2, f"counter {int.from_bytes(whole[2:4])}"),
        (4, f"data id 16#{whole[4:8].hex().upper()}"),
        (8, f"CRC-32 16#{whole[8:12].hex().upper()}"),
    ]
    for field, start, raw in fields_of(EXAMPLE):
        at = e2e.PROFILE_4_HEADER + start // 8
        begins.append((at, f"{field.signal} {meaning(field, raw)}"))
    own, peer = DEFAULT_BASE_ID + ISOTP_NUMBER, DEFAULT_BASE_ID + FLOW_CONTROL_NUMBER
    first = (0x1000 | len(whole)).to_bytes(2) + whole[:_IN_FIRST]
    rows = [
        (own, first, f"first frame of {len(whole)} bytes", 0, _IN_FIRST),
        (peer, b"\x30\0\0", "the peer's flow control: go on, no block size, no pause", 0, 0),
    ]
    for number, start in enumerate(range(_IN_FIRST, len(whole), _IN_NEXT), 1):
        data = bytes((0x20 | number % 16,)) + whole[start : start + _IN_NEXT]
        data = data.ljust(CLASSIC_BYTES, _PADDING)
        rows.append((own, data, f"segment {number}", start, start + _IN_NEXT))
    lines = [
        f"| `16#{identifier:X}` | `{data.hex(' ').upper()}` | "
        + ": ".join(filter(None, (what, ", ".join(t for at, t in begins if start <= at < end))))
        + " |\n"
        for identifier, data, what, start, end in rows
    ]
    return "| id | bytes | what it is: what begins in it |\n|---|---|---|\n" + "".join(lines)
