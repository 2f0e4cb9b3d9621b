"""The single definition of every message on the wire; everything else is derived from it.

A message is a sequence of fields, packed into a payload without gaps, least significant bit first
(Intel order). A link with wide frames (CAN FD, serial) sends the payload in one frame. Classic CAN
sends it as consecutive parts of six bytes; no field extends over two parts. The codec, DBC,
PROTOCOL.md and schema hash are all derived from this table.

Rounding is conservative: separations, times and speeds round down, radii and ages round up.
"""

import hashlib

from hri_predict.protocol.fields import (
    PART_BYTES,
    Definition,
    Field,
    Rounding,
    frame_number,
    index_of,
)
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    Level,
    Message,
    NodeState,
    OperatingMode,
    Pose,
    Schema,
    Status,
    Zone,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.robot_state import ROBOT_STATE

SCHEMA_VERSION = 3
MAX_ITEMS = 255  # of a Zone or Pose, over all its frames


def frame_table(classic: bool) -> dict[int, tuple[Definition, int, int]]:
    """Return a map from frame number to (definition, robot, part) for one kind of link.

    Raises:
        ValueError: two frames share a number because a message has too many parts.
    """
    table: dict[int, tuple[Definition, int, int]] = {}
    for d in DEFINITIONS:
        if classic and not d.classic:
            continue
        for part in range(d.parts if classic else 1):
            for robot in range(d.robots_with(part)):
                number = frame_number(d, robot, part)
                if number in table:
                    other = table[number][0].name
                    raise ValueError(f"{d.name} and {other} share frame {number:#x}")
                table[number] = (d, robot, part)
    return table


def _metres(
    signal: str, text: str, rounding: Rounding = "nearest", optional: bool = False
) -> Field:
    """A signed length in steps of 1 mm, ± 32.767 m."""
    return Field(
        signal=signal,
        bits=16,
        text=text,
        unit="m",
        scale=1000,
        signed=True,
        rounding=rounding,
        optional=optional,
    )


_AGE = Field(
    signal="AGE",
    bits=16,
    text="age of the underlying capture when the frame was encoded; add the time since receipt",
    unit="s",
    scale=1000,
    rounding="up",
    optional=True,
)
_PERSON = Field(signal="PERSON", bits=16, text="id of the person, modulo 65536", wraps=True)
_STEP = Field(signal="STEP", bits=8, text="horizon step; 0 is the body as captured")
_HORIZON = Field(signal="HORIZON", bits=16, text="time ahead of the capture", unit="s", scale=1000)
_RANGE = (
    Field(
        signal="FIRST",
        bits=8,
        text="index of this frame's first item among all items of this person and step",
    ),
    Field(signal="TOTAL", bits=8, text="number of items of this person and step"),
    Field(signal="COUNT", bits=8, text="number of items in this frame"),
)
_OF_BODY = (_PERSON, _STEP, _HORIZON, _AGE, *_RANGE)
"""Fields that Zone and Pose share; the C code stores both in one structure."""
_LATCH_ID = "id that an Acknowledge must carry now; 0: there is nothing to acknowledge"

DEFINITIONS: tuple[Definition, ...] = (
    Definition(
        type=Advice,
        number=0x00,
        text="request of the node to one robot, and its reason",
        sender="node",
        cycle_ms=40,
        priority=0,
        fields=(
            Field(
                signal="LEVEL",
                bits=4,
                text="requested level; any value but 1, 2 or 3 means stop",
                enum=Level,
                fallback=Level.UNKNOWN,
            ),
            Field(
                signal="OPERATING_MODE",
                bits=4,
                text="operating mode in force",
                enum=OperatingMode,
                fallback=OperatingMode.AUTOMATIC,
                attribute="mode",
            ),
            Field(
                signal="REASON",
                bits=8,
                text="reason for the level",
                enum=Reason,
                fallback=Reason.NODE_FAULT,
            ),
            Field(
                signal="SPEED_LIMIT",
                bits=16,
                text="limit for the robot's fastest point; not available means 0",
                unit="m/s",
                scale=1000,
                rounding="down",
                optional=True,
            ),
            _metres(
                "SEPARATION", "smallest distance between a body and the robot now", "down", True
            ),
            _metres(
                "PREDICTED_SEPARATION",
                "smallest distance until the robot can have stopped",
                "down",
                True,
            ),
            Field(
                signal="ECHO",
                bits=16,
                text="STATE_COUNTER of the last RobotState that the node received",
                optional=True,
            ),
            _AGE,
            Field(signal="LATCH_ID", bits=16, text=_LATCH_ID),
            index_of("TOOL", 8, "number of the tool set that the node assumes"),
            Field(
                signal="TIME_TO_BREACH",
                bits=12,
                text="time until the separation may be violated; 0 if it already is",
                unit="s",
                scale=1000,
                rounding="down",
                optional=True,
            ),
            index_of("BODY_PART", 6, "index of the deciding body segment"),
            index_of("ROBOT_LINK", 6, "index of the deciding robot capsule"),
        ),
        per_robot=True,
    ),
    ROBOT_STATE,
    Definition(
        type=Status,
        number=0x40,
        text="state of the node; sent every cycle, at least ten times a second, even without input",
        sender="node",
        cycle_ms=40,
        priority=3,
        fields=(
            Field(
                signal="NODE_STATE",
                bits=4,
                text="life cycle of the node",
                enum=NodeState,
                fallback=NodeState.UNKNOWN,
            ),
            Field(signal="PEOPLE", bits=4, text="number of people; 15 means 15 or more"),
            Field(
                signal="REASON",
                bits=8,
                text="the worst active condition",
                enum=Reason,
                fallback=Reason.NODE_FAULT,
            ),
            Field(signal="PREDICTOR", bits=8, text="index of the active predictor"),
            Field(
                signal="CYCLE", bits=8, text="number of the node's cycle, modulo 256", wraps=True
            ),
            _AGE,
        ),
    ),
    Definition(
        type=Acknowledge,
        number=0x41,
        text="a person has acknowledged the LATCH_ID of the Advice",
        sender="controller",
        cycle_ms=0,
        priority=1,
        fields=(
            Field(
                signal="LATCH_ID",
                bits=16,
                text="LATCH_ID of the Advice that the person saw; 0: the button is released",
            ),
            Field(
                signal="ACK_ID",
                bits=32,
                text="number chosen by the sender for each press, not 0; repeats count once",
            ),
        ),
    ),
    Definition(
        type=Schema,
        number=0x42,
        text="version and hash of this definition; discard all messages unless both match",
        sender="node",
        cycle_ms=1000,
        priority=4,
        fields=(
            Field(signal="SCHEMA_VERSION", bits=16, text="protocol version", attribute="version"),
            Field(signal="SCHEMA_HASH", bits=32, text="hash of the definitions", attribute="hash"),
        ),
        sequenced=False,
    ),
    Definition(
        type=Zone,
        number=0x44,
        text="space that the body segments of one person may occupy at one horizon",
        sender="node",
        cycle_ms=0,
        priority=5,
        fields=_OF_BODY,
        item=(
            Field(signal="SEGMENT", bits=8, text="index of the body segment"),
            _metres("A_X", "first end of its capsule"),
            _metres("A_Y", "first end of its capsule"),
            _metres("A_Z", "first end of its capsule"),
            _metres("B_X", "second end of its capsule"),
            _metres("B_Y", "second end of its capsule"),
            _metres("B_Z", "second end of its capsule"),
            Field(
                signal="RADIUS",
                bits=16,
                text="radius of its capsule",
                unit="m",
                scale=1000,
                rounding="up",
            ),
        ),
        items="capsules",
        items_per_frame=3,
        classic=False,
    ),
    Definition(
        type=Pose,
        number=0x45,
        text="predicted joints of one person at one horizon",
        sender="node",
        cycle_ms=0,
        priority=5,
        fields=_OF_BODY,
        item=(
            Field(signal="JOINT", bits=8, text="index of the joint"),
            _metres("X", "position in the room"),
            _metres("Y", "position in the room"),
            _metres("Z", "position in the room"),
        ),
        items="joints",
        items_per_frame=7,
        classic=False,
    ),
)

BY_TYPE: dict[type[Message], Definition] = {d.type: d for d in DEFINITIONS}


def schema_hash(definitions: tuple[Definition, ...] = DEFINITIONS) -> int:
    """Return a 32-bit hash of the wire format and of the meaning of its values.

    Descriptive texts are not included.
    """

    def shape(field: Field) -> tuple[object, ...]:
        names = [(e.name, e.value) for e in field.enum] if field.enum else []
        head = (field.signal, field.bits, field.unit, field.scale, field.signed, field.rounding)
        return (*head, names, field.optional, field.bounded, field.wraps)

    text = repr(
        [
            (
                *(d.name, d.number, d.per_robot, d.items_per_frame, d.classic, d.sequenced),
                *([shape(f) for f in d.fields], [shape(f) for f in d.item]),
                [(e.part, e.number, e.stride, e.robots, e.signal, e.least) for e in d.extra],
            )
            for d in definitions
        ]
    )
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:4], "big")


SCHEMA_HASH = schema_hash()


def _asked(definition: Definition) -> tuple[tuple[int, int, int, int], ...]:
    """(part, shift, mask, minimum) of each extra part; shift and mask select a field of part 0."""
    places: dict[str, tuple[int, int]] = {}
    shift = 0
    for field in definition.fields:
        places[field.signal] = (shift, (1 << field.bits) - 1)
        shift += field.bits
    return tuple((e.part, *places[e.signal], e.least) for e in definition.extra)


_ASKED = {d.type: _asked(d) for d in DEFINITIONS}
_ALWAYS = {d.type: frozenset(range(d.always)) for d in DEFINITIONS}


def needed_parts(definition: Definition, head: bytes) -> frozenset[int]:
    """Parts of a message on classic CAN; ``head`` is its part 0 or its whole payload."""
    if not definition.extra:
        return _ALWAYS[definition.type]
    bits = int.from_bytes(head[:PART_BYTES], "little")
    asked = {
        part
        for part, shift, mask, least in _ASKED[definition.type]
        if (bits >> shift & mask) >= least
    }
    return _ALWAYS[definition.type] | asked


def needed_bytes(definition: Definition, payload: bytes) -> int:
    """Minimum length, in bytes, of the fixed part of this payload."""
    if not definition.extra:
        return definition.fixed_bytes
    return PART_BYTES * (1 + max(needed_parts(definition, payload)))
