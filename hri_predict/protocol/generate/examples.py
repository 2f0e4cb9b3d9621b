"""The worked examples in ``drivers/PROTOCOL.md``: each message once, in every encoding.

Each is the first message of its type (counter 0), for robot 1 if the type has a robot.
"""

from collections.abc import Iterator

from hri_predict.protocol.can import CanSender
from hri_predict.protocol.codec import encode_payloads
from hri_predict.protocol.definition import (
    BY_TYPE,
    SCHEMA_HASH,
    SCHEMA_VERSION,
)
from hri_predict.protocol.fields import Field
from hri_predict.protocol.generate.dbc import choices, numbered_items
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    BaseMotion,
    Level,
    Message,
    NodeState,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.serial import SerialSender

_POSITIONS = (0.0, -1.5, 1.25, -0.75, -1.57, 0.5, 0.125)
_VELOCITIES = (0.25, 0.0, -0.125, 0.0, 1.0, -2.0, 0.5)
_BASE = BaseMotion(x_m=2.5, y_m=-1.25, yaw_rad=1.5, vx_m_s=0.25, vy_m_s=-0.125, yaw_rate_rad_s=0.1)
_FOREARM = ZoneCapsule(6, (0.6, -0.2, 1.1), (0.85, -0.25, 1.05), 0.12)
_HAND = ZoneCapsule(7, (0.85, -0.25, 1.05), (0.95, -0.27, 1.0), 0.15)

EXAMPLES: tuple[Message, ...] = (
    Advice(
        robot=1,
        level=Level.SLOW,
        reason=Reason.PERSON_APPROACHING,
        separation_m=1.234,
        predicted_separation_m=0.415,
        time_to_breach_s=0.32,
        speed_limit_m_s=0.75,
        body_part=6,
        robot_link=5,
        echo=4711,
        age_s=0.041,
        tool=2,
    ),
    RobotState(
        robot=1,
        mode=RobotMode.AUTOMATIC,
        counter=4711,
        positions=_POSITIONS,
        velocities=_VELOCITIES,
        tool=2,
        tool_confirmed=True,
        base=_BASE,
    ),
    Status(
        node_state=NodeState.RUNNING,
        reason=Reason.PERSON_APPROACHING,
        people=2,
        predictor=7,
        cycle=25,
        age_s=0.041,
    ),
    Acknowledge(latch_id=513, ack_id=0x01020304),
    Schema(SCHEMA_VERSION, SCHEMA_HASH),
    Zone(person=3, step=5, horizon_s=0.2, capsules=(_FOREARM, _HAND), age_s=0.041),
    Pose(
        person=3,
        step=5,
        horizon_s=0.2,
        joints=((7, 0.85, -0.25, 1.05), (11, 0.4, -0.3, 1.0)),
        age_s=0.041,
    ),
)


def encodings(message: Message) -> Iterator[tuple[str, int | None, bytes]]:
    """Yield (kind of link, CAN id, bytes) of each unit of ``message``."""
    for link, sender in (("classic", CanSender()), ("FD", CanSender(fd=True))):
        if sender.carries(type(message)):
            for frame in sender.encode(message):
                yield link, frame.arbitration_id, frame.data
    yield "serial", None, SerialSender().encode(message)


def fields_of(message: Message) -> list[tuple[Field, int, int]]:
    """Return (field, start bit, raw value) of all fields of the payload."""
    definition = BY_TYPE[type(message)]
    (payload,) = encode_payloads(message)
    bits, start, rows = int.from_bytes(payload, "little"), 0, []
    for field in (*definition.fields, *numbered_items(definition)):
        if start >= 8 * len(payload):
            break
        raw = bits >> start & ((1 << field.bits) - 1)
        rows.append((field, start, raw))
        start += field.bits
    return rows


def meaning(field: Field, raw: int) -> str:
    """Return the meaning of a raw value, with its unit."""
    value = raw - (1 << field.bits) if field.signed and raw >> (field.bits - 1) else raw
    if named := choices(field).get(value):
        return named
    return f"{value / field.scale:g} {field.unit}" if field.scale else str(value)
