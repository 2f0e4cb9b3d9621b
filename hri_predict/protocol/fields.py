"""Parts of a message on the wire: fields, with their widths and scales."""

from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from typing import Literal

from hri_predict.protocol.messages import Message

PART_BYTES = 6  # payload bytes in a classic frame: 8 less CRC and counter
ROBOT_STRIDE = 8  # frame numbers per robot, except for extra parts
MAX_ROBOTS = 8  # on one link

Rounding = Literal["nearest", "down", "up"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Field:
    """One field of a payload.

    Attributes:
        signal: name in the DBC and in the documents.
        bits: width.
        text: its meaning.
        unit: unit of the physical value.
        scale: steps per unit; 0 for a plain integer or enumeration. A scaled number always reserves
            one code for "not available": all ones, or the most negative value if signed.
        signed: two's complement.
        rounding: rounding direction for a value between two steps.
        enum: names of the values.
        fallback: value that a receiver uses instead of a value missing from ``enum``.
        optional: whether "not available" is a valid value (a plain integer then reserves the
            all-ones code for it). If not, a receiver refuses a message that contains it.
        bounded: a value out of range becomes "not available" instead of the nearest limit, because
            the limit would mean a different place or object.
        wraps: the value is taken modulo 2^bits; other numbers saturate.
        flag: true if the raw value is 1, false for all other raw values.
        attribute: its name in the message's class; by default the signal's, with the unit.
    """

    signal: str
    bits: int
    text: str
    unit: str = ""
    scale: int = 0
    signed: bool = False
    rounding: Rounding = "nearest"
    enum: type[IntEnum] | None = None
    fallback: IntEnum | None = None
    optional: bool = False
    bounded: bool = False
    wraps: bool = False
    flag: bool = False
    attribute: str = ""

    @property
    def member(self) -> str:
        """Name of the attribute of the message class that contains the value."""
        unit = f"_{self.unit.replace('/', '_')}" if self.unit else ""
        return self.attribute or self.signal.lower() + unit

    @property
    def not_available(self) -> int | None:
        """Raw code for "not available" (signed if the field is), ``None`` if there is none."""
        if not (self.optional or self.scale):
            return None
        return -(1 << (self.bits - 1)) if self.signed else (1 << self.bits) - 1

    @property
    def raw_range(self) -> tuple[int, int]:
        """Smallest and largest raw value that is a number."""
        if self.signed:
            limit = (1 << (self.bits - 1)) - 1
            return -limit, limit
        return 0, (1 << self.bits) - (1 if self.not_available is None else 2)

    @property
    def resolution(self) -> float:
        """Size of one step in physical units."""
        return 1.0 / self.scale if self.scale else 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Extra:
    """A part that a message has on classic CAN only if a field of part 0 requires it.

    Attributes:
        part: its index among the parts.
        number: number of its frame, for robot 0.
        stride: frame numbers per robot.
        robots: number of robots that have it, from robot 0 on.
        signal: the field of part 0 that requires it.
        least: minimum raw value of that field that requires the part.
    """

    part: int
    number: int
    stride: int
    robots: int
    signal: str
    least: int


@dataclass(frozen=True, kw_only=True)
class Definition:
    """One message.

    Attributes:
        type: its class in ``messages``.
        number: number of its first frame, for robot 0 (see ``frame_number``).
        per_robot: whether each robot has its own message.
        sender: "node" or "controller".
        cycle_ms: usual period, for the DBC; 0 if event-driven.
        priority: order in which queued messages are sent, 0 first; messages with items come last.
        fields: fixed part of the payload.
        item: fields of one repeated item after the fixed part; empty if nothing repeats.
        items: the attribute that holds the items, in the plural.
        items_per_frame: maximum number of items in one frame.
        classic: whether classic CAN carries it.
        extra: the last parts, if not every message has them.
        sequenced: whether its counter must advance. False for Schema, which never changes while the
            node runs, so that a receiver accepts the Schema of a restarted node before its Advice.
    """

    type: type[Message]
    number: int
    text: str
    sender: Literal["node", "controller"]
    cycle_ms: int
    priority: int
    fields: tuple[Field, ...]
    per_robot: bool = False
    item: tuple[Field, ...] = ()
    items: str = ""
    items_per_frame: int = 0
    classic: bool = True
    extra: tuple[Extra, ...] = ()
    sequenced: bool = True

    @property
    def name(self) -> str:
        """Name of the message."""
        return self.type.__name__

    @cached_property
    def fixed_bytes(self) -> int:
        """Payload length, in bytes, before the items."""
        return sum(f.bits for f in self.fields) // 8

    @cached_property
    def item_bytes(self) -> int:
        """Length of one item in bytes."""
        return sum(f.bits for f in self.item) // 8

    @cached_property
    def max_bytes(self) -> int:
        """Maximum payload length of one frame on a wide link, in bytes."""
        return self.fixed_bytes + self.items_per_frame * self.item_bytes

    @cached_property
    def parts(self) -> int:
        """Number of frames of the message on classic CAN, including the optional parts."""
        return self.fixed_bytes // PART_BYTES

    @cached_property
    def always(self) -> int:
        """Number of parts that every message of this type has."""
        return self.parts - len(self.extra)

    def robots_with(self, part: int) -> int:
        """Return the number of robots that have a part; 1 if the message belongs to no robot."""
        if part >= self.always:
            return self.extra[part - self.always].robots
        return MAX_ROBOTS if self.per_robot else 1


def frame_number(definition: Definition, robot: int = 0, part: int = 0) -> int:
    """Number of a frame: CAN id minus base id; the E2E data ids are derived from it.

    Raises:
        ValueError: this robot does not have this part on classic CAN.
    """
    if part < definition.always:
        return definition.number + robot * ROBOT_STRIDE * definition.per_robot + part
    extra = definition.extra[part - definition.always]
    if robot >= extra.robots:
        raise ValueError(
            f"classic CAN carries part {part} of {definition.name} for robots 0 to "
            f"{extra.robots - 1} only, not for robot {robot}; use FD or serial"
        )
    return extra.number + robot * extra.stride


def index_of(signal: str, bits: int, text: str) -> Field:
    """Return the field of an index; a number that is too large becomes "not available"."""
    return Field(signal=signal, bits=bits, text=text, optional=True, bounded=True)
