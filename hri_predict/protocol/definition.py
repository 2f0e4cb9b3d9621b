"""The one definition of every message on the wire; all else is derived from it.

A message is a row of fields, packed without gaps, least significant bit first (Intel order), into
a payload. A link that carries wide frames (CAN FD, serial) puts the payload into one frame; classic
CAN sends it as consecutive parts of six bytes, and no field crosses from one part to the next.
Codec, DBC, PROTOCOL.md and the schema hash all read this table.

Rounding goes to the safe side: separations, times and speeds down, radii and ages up.
"""

import hashlib
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
)
from hri_predict.reasons import Reason

SCHEMA_VERSION = 1
MAX_ROBOTS = 8  # that one link can address
MAX_JOINTS = 7
MAX_ITEMS = 255  # of a Zone or Pose, over all its frames
PART_BYTES = 6  # of payload in a classic frame: 8 less CRC and counter
ROBOT_STRIDE = 8  # frame numbers per robot

Rounding = Literal["nearest", "down", "up"]


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a payload.

    Attributes:
        signal: name in the DBC and in the documents.
        bits: width.
        text: what it says.
        unit: of the physical value.
        scale: steps per unit; 0 for a plain integer or enumeration. A scaled number always keeps
            one code for "not available": all ones, or the most negative value if signed.
        signed: two's complement.
        rounding: to which side a value between two steps goes.
        enum: names of the values.
        fallback: what a receiver takes a value for that ``enum`` does not know.
        optional: whether "not available" is a proper value (a plain integer then keeps the all-ones
            code for it); elsewhere a receiver refuses a message that holds it.
        wraps: counts modulo 2^bits; every other number saturates.
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
    wraps: bool = False

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
        """Physical value of one step."""
        return 1.0 / self.scale if self.scale else 1.0


@dataclass(frozen=True, slots=True)
class Definition:
    """One message.

    Attributes:
        type: its class in ``messages``.
        number: number of its first frame, for robot 0 (see ``frame_number``).
        per_robot: whether every robot has its own.
        sender: "node" or "controller".
        cycle_ms: usual period, for the DBC; 0 if sent on an event.
        fields: fixed part of the payload.
        item: fields of one repeated item after the fixed part; empty if nothing repeats.
        items_per_frame: how many items one frame carries at most.
        classic: whether classic CAN carries it.
        sequenced: whether its counter must advance. Not so for Schema, which says the same as long
            as the node runs: one from a restarted node is heard at once, before its Advice is.
    """

    type: type[Message]
    number: int
    text: str
    sender: Literal["node", "controller"]
    cycle_ms: int
    fields: tuple[Field, ...]
    per_robot: bool = False
    item: tuple[Field, ...] = ()
    items_per_frame: int = 0
    classic: bool = True
    sequenced: bool = True

    @property
    def name(self) -> str:
        """Name of the message."""
        return self.type.__name__

    @property
    def fixed_bytes(self) -> int:
        """Bytes of payload before the items."""
        return sum(f.bits for f in self.fields) // 8

    @property
    def item_bytes(self) -> int:
        """Bytes of one item."""
        return sum(f.bits for f in self.item) // 8

    @property
    def max_bytes(self) -> int:
        """Longest payload of one frame on a wide link."""
        return self.fixed_bytes + self.items_per_frame * self.item_bytes

    @property
    def parts(self) -> int:
        """Frames that the message takes on classic CAN."""
        return self.fixed_bytes // PART_BYTES


def frame_number(definition: Definition, robot: int = 0, part: int = 0) -> int:
    """Number of a frame: its CAN id is the base id plus this, its E2E data ids follow from it."""
    return definition.number + robot * ROBOT_STRIDE * definition.per_robot + part


def frame_table(classic: bool) -> dict[int, tuple[Definition, int, int]]:
    """Return frame number -> (definition, robot, part) of every frame of a kind of link."""
    return {
        frame_number(d, robot, part): (d, robot, part)
        for d in DEFINITIONS
        if d.classic or not classic
        for robot in range(MAX_ROBOTS if d.per_robot else 1)
        for part in range(d.parts if classic else 1)
    }


def _metres(
    signal: str, text: str, rounding: Rounding = "nearest", optional: bool = False
) -> Field:
    """A signed length, 1 mm a step, ± 32.767 m."""
    return Field(signal, 16, text, "m", 1000, signed=True, rounding=rounding, optional=optional)


def _joint(kind: str, number: int) -> Field:
    """Return a joint's field; "not available" where the robot has fewer joints.

    The seventh joint has 12 bits, which is what is left in the first classic frame.
    """
    bits = 16 if number < MAX_JOINTS else 12
    unit, scale = {
        ("position", 16): ("rad", 4000),
        ("position", 12): ("rad", 250),
        ("velocity", 16): ("rad/s", 1000),
        ("velocity", 12): ("rad/s", 100),
    }[kind, bits]
    text = f"{kind} of joint {number}"
    return Field(f"{kind.upper()}_{number}", bits, text, unit, scale, signed=True, optional=True)


_AGE = Field(
    "AGE",
    16,
    "age of the capture it rests on, when the frame was encoded; add the time since receipt",
    "s",
    1000,
    rounding="up",
    optional=True,
)
_PERSON = Field("PERSON", 16, "id of the person, modulo 65536", wraps=True)
_STEP = Field("STEP", 8, "horizon step; 0 is the body at its capture")
_HORIZON = Field("HORIZON", 16, "time ahead of the capture", "s", 1000)
_RANGE = (
    Field("FIRST", 8, "index of this frame's first item among all of this person and step"),
    Field("TOTAL", 8, "number of items of this person and step"),
    Field("COUNT", 8, "number of items in this frame"),
)
_LATCH_ID = "id of the latched stop, 0 if none"

DEFINITIONS: tuple[Definition, ...] = (
    Definition(
        Advice,
        0x00,
        "what the node asks of one robot, and why",
        "node",
        40,
        (
            Field(
                "LEVEL",
                8,
                "what is asked; whatever is not 1, 2 or 3 means stop",
                enum=Level,
                fallback=Level.UNKNOWN,
            ),
            Field("REASON", 8, "why", enum=Reason, fallback=Reason.NODE_FAULT),
            Field(
                "SPEED_LIMIT",
                16,
                "of the fastest point of the robot; not available means 0",
                "m/s",
                1000,
                rounding="down",
                optional=True,
            ),
            _metres(
                "SEPARATION", "smallest distance now between a body and the robot", "down", True
            ),
            _metres(
                "PREDICTED_SEPARATION",
                "smallest distance until the robot would have stopped",
                "down",
                True,
            ),
            Field(
                "TIME_TO_BREACH",
                16,
                "until the separation may be violated, 0 when it is",
                "s",
                1000,
                rounding="down",
                optional=True,
            ),
            _AGE,
            Field("LATCH_ID", 16, _LATCH_ID),
            Field(
                "ECHO",
                16,
                "STATE_COUNTER of the last RobotState that the node received",
                optional=True,
            ),
            Field("BODY_PART", 8, "index of the body segment that decides", optional=True),
            Field("ROBOT_LINK", 8, "index of the robot capsule that decides", optional=True),
        ),
        per_robot=True,
    ),
    Definition(
        RobotState,
        0x03,
        "where one robot is",
        "controller",
        20,
        (
            Field(
                "MODE", 4, "operating mode of the robot", enum=RobotMode, fallback=RobotMode.UNKNOWN
            ),
            Field("JOINTS", 4, "number of joints, at most 7"),
            Field(
                "STATE_COUNTER",
                16,
                "advances by 1 with every RobotState, modulo 65536; Advice echoes it",
                wraps=True,
            ),
            _joint("position", MAX_JOINTS),
            _joint("velocity", MAX_JOINTS),
            *(_joint("position", i) for i in range(1, MAX_JOINTS)),
            *(_joint("velocity", i) for i in range(1, MAX_JOINTS)),
        ),
        per_robot=True,
    ),
    Definition(
        Status,
        0x40,
        "how the node is; sent every cycle and at least ten times a second, input or not",
        "node",
        40,
        (
            Field("NODE_STATE", 4, "life cycle", enum=NodeState, fallback=NodeState.UNKNOWN),
            Field("PEOPLE", 4, "number of people; 15 means 15 or more"),
            Field("REASON", 8, "worst condition", enum=Reason, fallback=Reason.NODE_FAULT),
            Field("PREDICTOR", 8, "which predictor is at work"),
            Field("CYCLE", 8, "number of the node's cycle, modulo 256", wraps=True),
            _AGE,
        ),
    ),
    Definition(
        Acknowledge,
        0x41,
        "a person has acknowledged a latched stop",
        "controller",
        0,
        (
            Field("LATCH_ID", 16, "id of the latched stop; 0: a lost person"),
            Field("ACK_ID", 32, "the sender's own number, not 0; repeats of it count once"),
        ),
    ),
    Definition(
        Schema,
        0x42,
        "version and hash of this definition; unless both match, everything is unknown",
        "node",
        1000,
        (
            Field("SCHEMA_VERSION", 16, "protocol version"),
            Field("SCHEMA_HASH", 32, "hash of the definitions"),
        ),
        sequenced=False,
    ),
    Definition(
        Zone,
        0x44,
        "where the segments of one person may be at one horizon",
        "node",
        0,
        (_PERSON, _STEP, _HORIZON, _AGE, *_RANGE),
        item=(
            Field("SEGMENT", 8, "index of the body segment"),
            _metres("A_X", "first end of its capsule"),
            _metres("A_Y", "first end of its capsule"),
            _metres("A_Z", "first end of its capsule"),
            _metres("B_X", "second end of its capsule"),
            _metres("B_Y", "second end of its capsule"),
            _metres("B_Z", "second end of its capsule"),
            Field("RADIUS", 16, "radius of its capsule", "m", 1000, rounding="up"),
        ),
        items_per_frame=3,
        classic=False,
    ),
    Definition(
        Pose,
        0x45,
        "predicted joints of one person at one horizon",
        "node",
        0,
        (_PERSON, _STEP, _HORIZON, _AGE, *_RANGE),
        item=(
            Field("JOINT", 8, "index of the joint"),
            _metres("X", "position in the room"),
            _metres("Y", "position in the room"),
            _metres("Z", "position in the room"),
        ),
        items_per_frame=7,
        classic=False,
    ),
)

BY_TYPE: dict[type[Message], Definition] = {d.type: d for d in DEFINITIONS}


def schema_hash(definitions: tuple[Definition, ...] = DEFINITIONS) -> int:
    """Return 32 bits that change with anything that changes the wire or what its values mean."""

    def shape(field: Field) -> tuple[object, ...]:
        names = [(e.name, e.value) for e in field.enum] if field.enum else []
        head = (field.signal, field.bits, field.unit, field.scale, field.signed, field.rounding)
        return (*head, names, field.optional, field.wraps)

    text = repr(
        [
            (
                *(d.name, d.number, d.per_robot, d.items_per_frame, d.classic, d.sequenced),
                *([shape(f) for f in d.fields], [shape(f) for f in d.item]),
            )
            for d in definitions
        ]
    )
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


SCHEMA_HASH = schema_hash()
