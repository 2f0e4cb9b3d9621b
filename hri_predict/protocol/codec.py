"""Messages to payloads and back; framing is up to the links.

Both directions are compiled once from the definition: a payload is one integer, each field a shift.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
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
    BaseMotion,
    Message,
    Pose,
    RobotState,
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

    if field.flag:
        return lambda value: int(value is True)

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
    if field.flag:
        return lambda raw: raw == 1
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


def _members(definition: Definition) -> tuple[str, ...]:
    """Return the attribute of the message for each field; "" where the codec computes the value."""
    own = {f.name for f in dataclasses.fields(definition.type)}
    return tuple(f.member if f.member in own else "" for f in definition.fields)


_MEMBERS = {t: _members(d) for t, d in BY_TYPE.items()}


def _row(message: Message, computed: Iterable[Any] = ()) -> list[Any]:
    """Return the values of all fields: attributes, and ``computed`` ones where there are none."""
    more = iter(computed)
    return [getattr(message, name) if name else next(more) for name in _MEMBERS[type(message)]]


def _robot_state_computed(m: RobotState) -> list[Any]:
    joints = len(m.positions)
    if joints > MAX_JOINTS or len(m.velocities) != joints:
        raise ValueError(
            f"RobotState holds {joints} positions and {len(m.velocities)} velocities; "
            f"give as many of each, at most {MAX_JOINTS}"
        )
    absent = (None,) * (MAX_JOINTS - joints)
    positions, velocities = (*m.positions, *absent), (*m.velocities, *absent)
    more = [number for pair in zip(positions[6:], velocities[6:], strict=True) for number in pair]
    return [
        *(joints, m.base is not None),
        *(*positions[:6], *velocities[:6], *more),
        *_base_row(m.base),
    ]


def _base_row(base: BaseMotion | None) -> list[float | None]:
    if base is None:
        return [None] * 6
    turn = remainder(base.yaw_rad, tau) if isfinite(base.yaw_rad) else None
    return [base.x_m, base.y_m, turn, base.vx_m_s, base.vy_m_s, base.yaw_rate_rad_s]


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
    if not 0 <= robot_of(message) < MAX_ROBOTS:
        raise ValueError(f"robot {robot_of(message)} is not one of 0..{MAX_ROBOTS - 1}")
    computed = _robot_state_computed(message) if isinstance(message, RobotState) else ()
    return [_FIXED[type(message)].pack(_row(message, computed))]


def _split(message: Zone | Pose, items: Sequence[Sequence[Any]], room: int | None) -> list[bytes]:
    """Distribute the items over as many payloads as needed, at least one."""
    kind = type(message)
    fixed, packer, room = _FIXED[kind], _ITEM[kind], room or BY_TYPE[kind].items_per_frame
    if len(items) > MAX_ITEMS:
        raise ValueError(f"{kind.__name__} of {len(items)} items; at most {MAX_ITEMS} fit")
    payloads = []
    for first in range(0, max(1, len(items)), room):
        chunk = items[first : first + room]
        head = fixed.pack(_row(message, (first, len(items), len(chunk))))
        payloads.append(head + b"".join(packer.pack(item) for item in chunk))
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
    return _message(definition, row, robot, payload)


def _message(definition: Definition, row: list[Any], robot: int, payload: bytes) -> Message:
    named = list(zip(_MEMBERS[definition.type], row, strict=True))
    given = {name: value for name, value in named if name}
    computed = [value for name, value in named if not name]
    if definition.per_robot:
        given["robot"] = robot
    if definition.type is RobotState:
        given |= _joints_and_base(computed)
    elif definition.type is Zone:
        given["capsules"] = tuple(
            ZoneCapsule(segment, (ax, ay, az), (bx, by, bz), radius)
            for segment, ax, ay, az, bx, by, bz, radius in _items(definition, computed, payload)
        )
    elif definition.type is Pose:
        given["joints"] = tuple(map(tuple, _items(definition, computed, payload)))
    return definition.type(**given)


def _joints_and_base(computed: list[Any]) -> dict[str, Any]:
    joints, moving, *rest = computed
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
    return {
        "positions": tuple(positions),
        "velocities": tuple(velocities),
        "base": _base_of(*base) if base else None,
    }


def _base_of(*row: float) -> BaseMotion:
    x, y, yaw, vx, vy, rate = row
    return BaseMotion(x_m=x, y_m=y, yaw_rad=yaw, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=rate)


def _items(definition: Definition, computed: list[Any], payload: bytes) -> list[list[Any]]:
    first, total, count = computed
    packer, start = _ITEM[definition.type], definition.fixed_bytes
    if first + count > total:
        raise Malformed(f"{definition.name} holds items {first}..{first + count} of {total}")
    if len(payload) < start + count * packer.size:
        raise Malformed(f"{definition.name} of {len(payload)} bytes")
    offsets = range(start, start + count * packer.size, packer.size)
    return [packer.unpack(payload[i : i + packer.size]) for i in offsets]


def robot_of(message: Message) -> int:
    """Index of the robot of ``message``, 0 if it has none."""
    robot: int = getattr(message, "robot", 0)
    return robot
