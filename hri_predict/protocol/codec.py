"""Messages to payloads and back; framing is up to the links.

Both directions are compiled once from the definition: a payload is one integer, each field a shift.
"""

from collections.abc import Callable, Sequence
from math import ceil, floor, isfinite, isnan, remainder, tau
from typing import Any

from hri_predict.protocol.definition import (
    BY_TYPE,
    MAX_ITEMS,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    needed_bytes,
)
from hri_predict.protocol.fields import (
    MAX_ROBOTS,
    Definition,
    Field,
)
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    BaseMotion,
    Message,
    Pose,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.robot_state import MAX_JOINTS

__all__ = [
    "SCHEMA_HASH",
    "SCHEMA_VERSION",
    "Malformed",
    "decode_payload",
    "encode_payloads",
    "robot_of",
]

_EPSILON = (
    1e-6  # of a step: a decimal fraction is inexact in binary, and must not round the wrong way
)


class Malformed(ValueError):
    """A payload with the right CRC but an impossible length or value."""


def _round(rounding: str) -> Callable[[float], int]:
    if rounding == "down":
        return lambda steps: floor(steps + _EPSILON)
    if rounding == "up":
        return lambda steps: ceil(steps - _EPSILON)
    return round


def _encoder(field: Field) -> Callable[[Any], int]:
    """Return the function from a value to the raw bits of ``field``."""
    mask = (1 << field.bits) - 1
    low, high = field.raw_range
    missing = None if field.not_available is None else field.not_available & mask
    scale, rounded = field.scale, _round(field.rounding)

    if field.wraps:
        return lambda value: int(value) & mask

    if not scale:

        def integer(value: Any) -> int:
            if value is None:
                if missing is None:
                    raise ValueError(f"{field.signal} must be a number")
                return missing
            if missing is not None and field.bounded and not low <= value <= high:
                return missing
            return low if value < low else high if value > high else int(value)

        return integer

    assert missing is not None  # every scaled field has the code
    above, below = (missing, missing) if field.bounded else (high & mask, low & mask)

    def number(value: Any) -> int:
        if value is None or isnan(value):
            return missing
        steps = value * scale
        if steps >= high:
            return high & mask if steps < high + 1 else above
        if steps <= low:
            return low & mask if steps > low - 1 else below
        return rounded(steps) & mask

    return number


def _decoder(field: Field) -> Callable[[int], Any]:
    """Return the function from the raw bits of ``field`` to a value; it raises ``Malformed``."""
    enum, fallback = field.enum, field.fallback
    if enum is not None:
        known = {int(e): e for e in enum}
        return lambda raw: known.get(raw, fallback)
    mask = (1 << field.bits) - 1
    missing = None if field.not_available is None else field.not_available & mask
    if not field.scale and missing is None:
        return lambda raw: raw
    sign, wrap = (1 << (field.bits - 1) if field.signed else 1 << field.bits), 1 << field.bits
    scale, optional, signal = field.scale, field.optional, field.signal

    def number(raw: int) -> Any:
        if raw == missing:
            if optional:
                return None
            raise Malformed(f"{signal} is not available")
        if raw >= sign:
            raw -= wrap
        return raw / scale if scale else raw

    return number


class _Packer:
    """Packs a row of values into bytes and unpacks it."""

    def __init__(self, fields: Sequence[Field]):
        self.size = sum(f.bits for f in fields) // 8
        self._pack: list[tuple[Callable[[Any], int], int]] = []
        self._unpack: list[tuple[Callable[[int], Any], int, int]] = []
        shift = 0
        for field in fields:
            self._pack.append((_encoder(field), shift))
            self._unpack.append((_decoder(field), shift, (1 << field.bits) - 1))
            shift += field.bits

    def pack(self, values: Sequence[Any]) -> bytes:
        bits = 0
        for (encode, shift), value in zip(self._pack, values, strict=True):
            bits |= encode(value) << shift
        return bits.to_bytes(self.size, "little")

    def unpack(self, data: bytes) -> list[Any]:
        bits = int.from_bytes(data, "little")
        return [decode(bits >> shift & mask) for decode, shift, mask in self._unpack]


_FIXED = {t: _Packer(d.fields) for t, d in BY_TYPE.items()}
_ITEM = {t: _Packer(d.item) for t, d in BY_TYPE.items() if d.item}


def _robot_state_row(m: RobotState) -> list[Any]:
    joints = len(m.positions)
    if joints > MAX_JOINTS or len(m.velocities) != joints:
        raise ValueError(
            f"RobotState holds {joints} positions and {len(m.velocities)} velocities; "
            f"give as many of each, at most {MAX_JOINTS}"
        )
    absent = (None,) * (MAX_JOINTS - joints)
    positions, velocities = (*m.positions, *absent), (*m.velocities, *absent)
    more = [number for pair in zip(positions[6:], velocities[6:], strict=True) for number in pair]
    head = (m.mode, joints, m.counter, m.request, m.tool, m.enabling is True)
    confirmed, moving = m.tool_confirmed is True, m.base is not None
    return [*head, confirmed, moving, *positions[:6], *velocities[:6], *more, *_base_row(m.base)]


def _base_row(base: BaseMotion | None) -> list[float | None]:
    if base is None:
        return [None] * 6
    turn = remainder(base.yaw_rad, tau) if isfinite(base.yaw_rad) else None
    return [base.x_m, base.y_m, turn, base.vx_m_s, base.vy_m_s, base.yaw_rate_rad_s]


_ROW: dict[type, Callable[[Any], Sequence[Any]]] = {
    Advice: lambda m: (
        *(m.level, m.mode, m.reason, m.speed_limit_m_s, m.separation_m),
        *(m.predicted_separation_m, m.echo, m.age_s, m.latch_id, m.tool),
        *(m.time_to_breach_s, m.body_part, m.robot_link),
    ),
    Status: lambda m: (m.node_state, m.people, m.reason, m.predictor, m.cycle, m.age_s),
    Acknowledge: lambda m: (m.latch_id, m.ack_id),
    Schema: lambda m: (m.version, m.hash),
    RobotState: _robot_state_row,
}


def encode_payloads(message: Message, items: int | None = None) -> list[bytes]:
    """Return the payloads of ``message``: one, or for Zone and Pose one per frame.

    ``items`` is the number of items of a Zone or Pose in one payload; default: what fits a frame.

    Numbers saturate at the ends of their range; ``None`` and NaN become "not available".

    Raises:
        ValueError: a field cannot hold the robot index, the joint count or a ``None``.
    """
    if isinstance(message, Zone):
        capsules = [(c.segment, *c.a, *c.b, c.radius) for c in message.capsules]
        return _split(message, capsules, items)
    if isinstance(message, Pose):
        return _split(message, message.joints, items)
    kind = type(message)
    if isinstance(message, Advice | RobotState) and not 0 <= message.robot < MAX_ROBOTS:
        raise ValueError(f"robot {message.robot} is not one of 0..{MAX_ROBOTS - 1}")
    return [_FIXED[kind].pack(_ROW[kind](message))]


def _split(message: Zone | Pose, items: Sequence[Sequence[Any]], room: int | None) -> list[bytes]:
    """Distribute the items over as many payloads as needed, at least one."""
    kind = type(message)
    fixed, packer, room = _FIXED[kind], _ITEM[kind], room or BY_TYPE[kind].items_per_frame
    head = (message.person, message.step, message.horizon_s, message.age_s)
    if len(items) > MAX_ITEMS:
        raise ValueError(f"{kind.__name__} of {len(items)} items; at most {MAX_ITEMS} fit")
    payloads = []
    for first in range(0, max(1, len(items)), room):
        chunk = items[first : first + room]
        row = fixed.pack((*head, first, len(items), len(chunk)))
        payloads.append(row + b"".join(packer.pack(item) for item in chunk))
    return payloads


def decode_payload(
    definition: Definition, robot: int, payload: bytes, items: int | None = None
) -> Message:
    """Return the message in ``payload``; bytes after its end (padding) are ignored.

    Extra parts that it does not need may be missing or hold anything.

    ``items`` is the largest number of items of a Zone or Pose; default: what fits a frame.

    Raises:
        Malformed: too short, or an impossible value.
    """
    fixed = _FIXED[definition.type]
    if len(payload) < needed_bytes(definition, payload):
        raise Malformed(f"{definition.name} of {len(payload)} bytes")
    row = fixed.unpack(payload[: fixed.size])  # what is missing at its end reads as zeros
    if definition.item and row[-1] > (items or definition.items_per_frame):
        raise Malformed(f"{definition.name} holds {row[-1]} items")
    return _BUILD[definition.type](row, robot, payload)


def _advice(row: list[Any], robot: int, payload: bytes) -> Advice:
    level, mode, reason, speed, separation, predicted, echo, age, latch, *rest = row
    tool, breach, part, link = rest
    return Advice(
        robot=robot,
        level=level,
        reason=reason,
        latch_id=latch,
        separation_m=separation,
        predicted_separation_m=predicted,
        time_to_breach_s=breach,
        speed_limit_m_s=speed,
        body_part=part,
        robot_link=link,
        echo=echo,
        age_s=age,
        mode=mode,
        tool=tool,
    )


def _status(row: list[Any], robot: int, payload: bytes) -> Status:
    state, people, reason, predictor, cycle, age = row
    return Status(
        node_state=state, reason=reason, people=people, predictor=predictor, cycle=cycle, age_s=age
    )


def _robot_state(row: list[Any], robot: int, payload: bytes) -> RobotState:
    mode, joints, counter, request, tool, enabling, confirmed, moving, *rest = row
    if joints > MAX_JOINTS or moving > 1:
        raise Malformed(f"JOINTS {joints}, BASE {moving}")
    positions = [*rest[:6], *rest[12:18:2]][:joints]
    velocities = [*rest[6:12], *rest[13:18:2]][:joints]
    base = rest[18:] if moving else []
    if None in positions or None in velocities or None in base:
        raise Malformed(
            "a joint of RobotState, or its base, is not available: it is not a number, or beyond "
            "what its field holds (8.19 rad, 32.7 rad/s); radians are meant, not degrees"
        )
    return RobotState(
        robot=robot,
        mode=mode,
        counter=counter,
        positions=tuple(positions),
        velocities=tuple(velocities),
        request=request,
        enabling=enabling == 1,
        tool=tool,
        tool_confirmed=confirmed == 1,
        base=_base_of(*base) if base else None,
    )


def _base_of(*row: float) -> BaseMotion:
    x, y, yaw, vx, vy, rate = row
    return BaseMotion(x_m=x, y_m=y, yaw_rad=yaw, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=rate)


def _items(kind: type, row: list[Any], payload: bytes) -> list[list[Any]]:
    first, total, count = row[4:]
    packer, start = _ITEM[kind], _FIXED[kind].size
    if first + count > total:
        raise Malformed(f"{kind.__name__} holds items {first}..{first + count} of {total}")
    if len(payload) < start + count * packer.size:
        raise Malformed(f"{kind.__name__} of {len(payload)} bytes")
    offsets = range(start, start + count * packer.size, packer.size)
    return [packer.unpack(payload[i : i + packer.size]) for i in offsets]


def _zone(row: list[Any], robot: int, payload: bytes) -> Zone:
    capsules = tuple(
        ZoneCapsule(segment, (ax, ay, az), (bx, by, bz), radius)
        for segment, ax, ay, az, bx, by, bz, radius in _items(Zone, row, payload)
    )
    return Zone(person=row[0], step=row[1], horizon_s=row[2], capsules=capsules, age_s=row[3])


def _pose(row: list[Any], robot: int, payload: bytes) -> Pose:
    joints = tuple((j, x, y, z) for j, x, y, z in _items(Pose, row, payload))
    return Pose(person=row[0], step=row[1], horizon_s=row[2], joints=joints, age_s=row[3])


_BUILD: dict[type, Callable[[list[Any], int, bytes], Message]] = {
    Advice: _advice,
    Status: _status,
    Acknowledge: lambda row, robot, payload: Acknowledge(*row),
    Schema: lambda row, robot, payload: Schema(*row),
    RobotState: _robot_state,
    Zone: _zone,
    Pose: _pose,
}


def robot_of(message: Message) -> int:
    """Index of the robot of ``message``, 0 if it has none."""
    return message.robot if isinstance(message, Advice | RobotState) else 0
