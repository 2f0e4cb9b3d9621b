"""Convert messages to payloads and back; the links do the framing."""

import dataclasses
from collections.abc import Callable, Sequence
from itertools import count
from math import ceil, floor, isfinite, remainder, tau
from typing import Any

from hri_predict.protocol.definition import (
    BY_TYPE,
    MAX_ITEMS,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    needed_bytes,
)
from hri_predict.protocol.fields import MAX_ROBOTS, Definition, Field
from hri_predict.protocol.messages import (
    BaseMotion,
    Message,
    Pose,
    RobotState,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.robot_state import MAX_JOINTS

EPSILON = 1e-6
"""Tolerance in steps, against wrong rounding of decimal fractions, which are inexact in binary."""
_ROUNDED = {"down": "floor(s + EPSILON)", "up": "ceil(s - EPSILON)", "nearest": "round(s)"}


class Malformed(ValueError):
    """A payload with a correct CRC but an impossible length or value."""


Pack = Callable[[Any, Sequence[Any]], bytes]
"""Converts a message, and the values that are not attributes of it, to bytes."""
Unpack = Callable[[bytes], tuple[Any, ...]]
"""Converts bytes to the values of all fields; missing bytes at the end are read as zeros.

Raises:
    Malformed: a mandatory value is not available.
"""


def packer(fields: Sequence[Field], values: Sequence[str]) -> Pack:
    """Return a function that converts values to bytes.

    The bytes form one integer that contains the bits of all fields. Calling a function for each
    field would cost four times as much as the arithmetic itself. So the arithmetic for all fields
    is written as the source of one function and compiled, as in ``dataclasses``. The source is
    built from the definition only, never from data.

    Numbers saturate at the ends of their range; ``None`` and NaN become "not available".

    Args:
        fields: the fields, in order.
        values: the expression that gives each field's value: ``m.NAME`` from the message, or
            ``c[INDEX]`` from the other values.
    """
    lines = []
    for index, (field, value) in enumerate(zip(fields, values, strict=True)):
        lines += [f"v = {value}", *_packing(field, f"r{index}")]
    parts = [f"r{index} << {shift}" for index, shift in enumerate(_shifts(fields))]
    size = sum(field.bits for field in fields) // 8
    lines.append(f"return ({' | '.join(parts)}).to_bytes({size}, 'little')")
    return _compiled("pack", "m, c", lines, {})


def unpacker(fields: Sequence[Field]) -> Unpack:
    """Return a function that converts bytes to values."""
    lines, known = ["bits = int.from_bytes(data, 'little')"], dict[str, Any]()
    for index, (field, shift) in enumerate(zip(fields, _shifts(fields), strict=True)):
        value = f"v{index}"
        lines.append(f"{value} = bits >> {shift} & {_mask(field)}")
        lines += _unpacking(field, value)
        if field.enum is not None:
            known[f"KNOWN_{value}"] = {int(e): e for e in field.enum}
            known[f"FALLBACK_{value}"] = field.fallback
    lines.append(f"return ({', '.join(f'v{index}' for index in range(len(fields)))},)")
    return _compiled("unpack", "data", lines, known)


def _packing(field: Field, raw: str) -> list[str]:
    """Return the lines that set ``raw`` to the bits of ``v``."""
    mask, (low, high) = _mask(field), field.raw_range
    missing = None if field.not_available is None else field.not_available & mask
    if field.wraps:
        return [f"{raw} = int(v) & {mask}"]
    if field.flag:
        return [f"{raw} = 1 if v is True else 0"]
    if not field.scale:
        none = f"raise ValueError('{field.signal} must be a number')"
        below, above = (missing, missing) if field.bounded else (low, high)
        return [
            f"if v is None: {none if missing is None else f'{raw} = {missing}'}",
            f"elif v < {low}: {raw} = {below}",
            f"elif v > {high}: {raw} = {above}",
            f"else: {raw} = int(v)",
        ]
    assert missing is not None  # every scaled field has the code
    below, above = (missing, missing) if field.bounded else (low & mask, high & mask)
    return [
        f"if v is None or v != v: {raw} = {missing}",
        "else:",
        f"    s = v * {field.scale}",
        f"    if s >= {high}: {raw} = {high & mask} if s < {high + 1} else {above}",
        f"    elif s <= {low}: {raw} = {low & mask} if s > {low - 1} else {below}",
        f"    else: {raw} = {_ROUNDED[field.rounding]} & {mask}",
    ]


def _unpacking(field: Field, value: str) -> list[str]:
    """Return the lines that convert ``value`` from raw bits to the field's value."""
    if field.enum is not None:
        return [f"{value} = KNOWN_{value}.get({value}, FALLBACK_{value})"]
    if field.flag:
        return [f"{value} = {value} == 1"]
    if field.not_available is None:
        return []
    missing = f"raise Malformed('{field.signal} is not available')"
    lines = [
        f"if {value} == {field.not_available & _mask(field)}: "
        f"{f'{value} = None' if field.optional else missing}"
    ]
    signed = f"({value} - {1 << field.bits} if {value} >> {field.bits - 1} else {value})"
    number = signed if field.signed else value
    if field.scale:
        return [*lines, f"else: {value} = {number} / {field.scale}"]
    return [*lines, f"else: {value} = {number}"] if field.signed else lines


def _compiled(name: str, arguments: str, lines: Sequence[str], more: dict[str, Any]) -> Any:
    text = f"def {name}({arguments}):\n" + "".join(f"    {line}\n" for line in lines)
    names: dict[str, Any] = {
        "floor": floor,
        "ceil": ceil,
        "EPSILON": EPSILON,
        "Malformed": Malformed,
        **more,
    }
    exec(compile(text, f"<{name} of a message>", "exec"), names)
    return names[name]


def _mask(field: Field) -> int:
    return (1 << field.bits) - 1


def _shifts(fields: Sequence[Field]) -> list[int]:
    """Return the position of each field's first bit."""
    return [sum(field.bits for field in fields[:index]) for index in range(len(fields))]


__all__ = [
    "SCHEMA_HASH",
    "SCHEMA_VERSION",
    "Malformed",
    "decode_payload",
    "encode_payloads",
    "robot_of",
]


def _members(definition: Definition) -> tuple[str, ...]:
    """Return the attribute of the message for each field; "" where the codec computes the value."""
    own = {f.name for f in dataclasses.fields(definition.type)}
    return tuple(f.member if f.member in own else "" for f in definition.fields)


def _values(members: tuple[str, ...]) -> list[str]:
    """Return, for each field, the expression with which a packing function reads its value."""
    computed = count()
    return [f"m.{name}" if name else f"c[{next(computed)}]" for name in members]


_MEMBERS = {t: _members(d) for t, d in BY_TYPE.items()}
_PACK = {t: packer(d.fields, _values(_MEMBERS[t])) for t, d in BY_TYPE.items()}
_UNPACK = {t: unpacker(d.fields) for t, d in BY_TYPE.items()}
_WITH_ITEMS = {t: d for t, d in BY_TYPE.items() if d.item}
_PACK_ITEM = {
    t: packer(d.item, [f"c[{k}]" for k in range(len(d.item))]) for t, d in _WITH_ITEMS.items()
}
_UNPACK_ITEM = {t: unpacker(d.item) for t, d in _WITH_ITEMS.items()}
_COUNT = {t: [f.signal for f in d.fields].index("COUNT") for t, d in _WITH_ITEMS.items()}


def _robot_state_computed(m: RobotState) -> list[Any]:
    joints = len(m.positions)
    if joints > MAX_JOINTS or len(m.velocities) != joints:
        raise ValueError(
            f"RobotState holds {joints} positions and {len(m.velocities)} velocities; give the "
            f"same number of both, at most {MAX_JOINTS}"
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

    ``items`` is the number of items of a Zone or Pose in one payload; default: as many as fit in a
    frame.

    Numbers saturate at the ends of their range; ``None`` and NaN become "not available".

    Raises:
        ValueError: a field cannot hold the robot index, the joint count or a ``None``.
    """
    if isinstance(message, Zone):
        capsules = [(c.segment, *c.a, *c.b, c.radius) for c in message.capsules]
        return _split(message, capsules, items)
    if isinstance(message, Pose):
        return _split(message, message.joints, items)
    if not 0 <= (robot := robot_of(message)) < MAX_ROBOTS:
        raise ValueError(f"robot {robot} is not one of 0..{MAX_ROBOTS - 1}")
    computed = _robot_state_computed(message) if isinstance(message, RobotState) else ()
    return [_PACK[type(message)](message, computed)]


def _split(message: Zone | Pose, items: Sequence[Sequence[Any]], room: int | None) -> list[bytes]:
    """Distribute the items over as many payloads as necessary, but at least one."""
    kind = type(message)
    pack, pack_item, room = _PACK[kind], _PACK_ITEM[kind], room or BY_TYPE[kind].items_per_frame
    if len(items) > MAX_ITEMS:
        raise ValueError(f"{kind.__name__} of {len(items)} items; at most {MAX_ITEMS} fit")
    payloads = []
    for first in range(0, max(1, len(items)), room):
        chunk = items[first : first + room]
        head = pack(message, (first, len(items), len(chunk)))
        payloads.append(head + b"".join([pack_item(None, item) for item in chunk]))
    return payloads


def decode_payload(
    definition: Definition,
    robot: int,
    payload: bytes,
    items: int | None = None,
    *,
    with_items: bool = True,
) -> Message:
    """Return the message in ``payload``; bytes after its end (padding) are ignored.

    Extra parts that the message does not need may be missing or have any content.

    ``items`` is the maximum number of items of a Zone or Pose; default: as many as fit in a frame.
    Without ``with_items`` the items are not unpacked.

    Raises:
        Malformed: too short, or an impossible value.
    """
    if len(payload) < needed_bytes(definition, payload):
        raise Malformed(f"{definition.name} of {len(payload)} bytes")
    row = _UNPACK[definition.type](payload[: definition.fixed_bytes])
    if definition.item:
        held = row[_COUNT[definition.type]]
        if held > (items or definition.items_per_frame):
            raise Malformed(f"{definition.name} holds {held} items")
    return _message(definition, row, robot, payload if with_items else None)


def _message(
    definition: Definition, row: tuple[Any, ...], robot: int, payload: bytes | None
) -> Message:
    """Create the message; without ``payload``, a Zone or Pose has no items."""
    members = _MEMBERS[definition.type]
    given = dict(zip(members, row, strict=True))
    if definition.per_robot:
        given["robot"] = robot
    if "" not in given:
        return definition.type(**given)
    del given[""]
    computed = [value for name, value in zip(members, row, strict=True) if not name]
    if definition.type is RobotState:
        given |= _joints_and_base(computed)
    elif definition.type is Zone:
        given["capsules"] = tuple(
            ZoneCapsule(segment, (ax, ay, az), (bx, by, bz), radius)
            for segment, ax, ay, az, bx, by, bz, radius in _items(definition, computed, payload)
        )
    elif definition.type is Pose:
        given["joints"] = tuple(_items(definition, computed, payload))
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


def _items(
    definition: Definition, computed: list[Any], payload: bytes | None
) -> list[tuple[Any, ...]]:
    if payload is None:
        return []
    first, total, count = computed
    unpack, start, size = (
        _UNPACK_ITEM[definition.type],
        definition.fixed_bytes,
        definition.item_bytes,
    )
    if first + count > total:
        raise Malformed(f"{definition.name} holds items {first}..{first + count} of {total}")
    if len(payload) < start + count * size:
        raise Malformed(f"{definition.name} of {len(payload)} bytes")
    offsets = range(start, start + count * size, size)
    return [unpack(payload[i : i + size]) for i in offsets]


def robot_of(message: Message) -> int:
    """Index of the robot of ``message``, 0 if it has none."""
    robot: int = getattr(message, "robot", 0)
    return robot
