"""Convert messages to payloads and back; the links do the framing."""

import dataclasses
from collections.abc import Sequence
from itertools import count
from math import isfinite, remainder, tau
from typing import Any

from hri_predict.protocol.definition import (
    BY_TYPE,
    MAX_ITEMS,
    SCHEMA_HASH,
    SCHEMA_VERSION,
    needed_bytes,
)
from hri_predict.protocol.fields import MAX_ROBOTS, Definition
from hri_predict.protocol.messages import (
    BaseMotion,
    Message,
    Pose,
    RobotState,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.packing import Malformed, packer, unpacker
from hri_predict.protocol.robot_state import MAX_JOINTS

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
