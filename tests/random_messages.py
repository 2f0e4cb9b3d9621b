"""Messages with every field drawn from its whole range, and what each signal must then say."""

import dataclasses
from typing import Any

import numpy as np

from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.fields import MAX_ROBOTS, Field
from hri_predict.protocol.messages import BaseMotion, Message, Pose, RobotState, Zone, ZoneCapsule
from hri_predict.protocol.robot_state import BASE_ROBOTS, MAX_JOINTS

NOT_GIVEN = 0.15  # share of the values that may be missing, and are


def random_value(rng: np.random.Generator, field: Field, beyond: float = 1.0) -> Any:
    """Return a value of a field; ``beyond`` times its range, if it has a unit."""
    if field.optional and rng.random() < NOT_GIVEN:
        return None
    if field.enum:
        return field.enum(int(rng.choice(list(field.enum))))
    if field.flag:
        return bool(rng.integers(2))
    low, high = field.raw_range
    if field.scale:
        return float(rng.uniform(low * beyond, high * beyond)) / field.scale
    return int(rng.integers(low, high + 1))


def random_message(
    rng: np.random.Generator, kind: type[Message], items: int = 21, beyond: float = 1.0
) -> Message:
    """Return a message; ``items``: maximum number of capsules of a Zone, or joints of a Pose."""
    definition = BY_TYPE[kind]
    values: dict[str, Any] = {
        f.member: random_value(rng, f, beyond) for f in definition.fields if f.member in _own(kind)
    }
    if definition.per_robot:
        values["robot"] = int(rng.integers(MAX_ROBOTS))
    if definition.item:
        rows = [
            [random_value(rng, f) for f in definition.item] for _ in range(rng.integers(1, items))
        ]
        values[definition.items] = tuple(
            ZoneCapsule(row[0], tuple(row[1:4]), tuple(row[4:7]), row[7])
            if kind is Zone
            else tuple(row)
            for row in rows
        )
    if kind is RobotState:
        values |= _joints_and_base(rng, values["robot"])
    return kind(**values)


def _own(kind: type[Message]) -> set[str]:
    return {f.name for f in dataclasses.fields(kind)}


def _joints_and_base(rng: np.random.Generator, robot: int) -> dict[str, Any]:
    joints = int(rng.integers(MAX_JOINTS + 1))
    base = None
    if robot < BASE_ROBOTS and rng.random() < 0.5:
        x, y, vx, vy, rate = rng.uniform(-32.7, 32.7, 5).tolist()
        yaw = float(rng.uniform(-3.14, 3.14))
        base = BaseMotion(x_m=x, y_m=y, yaw_rad=yaw, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=rate)
    return {
        "positions": tuple(rng.uniform(-8.1, 8.1, joints).tolist()),
        "velocities": tuple(rng.uniform(-20.4, 20.4, joints).tolist()),
        "base": base,
    }


def signals(message: Message) -> dict[str, Any]:
    """Return the value of each signal of the message; items are numbered from 0."""
    kind = type(message)
    named = [f for f in BY_TYPE[kind].fields if f.member in _own(kind)]
    found = {f.signal: getattr(message, f.member) for f in named}
    if isinstance(message, RobotState):
        found |= _signals_of_joints_and_base(message)
    elif isinstance(message, Zone):
        for i, (segment, a, b, radius) in enumerate(message.capsules):
            found |= {f"SEGMENT_{i}": segment, f"RADIUS_{i}": radius}
            for axis, from_, to in zip("XYZ", a, b, strict=True):
                found |= {f"A_{axis}_{i}": from_, f"B_{axis}_{i}": to}
    elif isinstance(message, Pose):
        for i, row in enumerate(message.joints):
            found |= {f"{k}_{i}": v for k, v in zip(("JOINT", "X", "Y", "Z"), row, strict=True)}
    return found


def _signals_of_joints_and_base(state: RobotState) -> dict[str, Any]:
    joints = len(state.positions)
    found: dict[str, Any] = {"JOINTS": joints, "BASE": int(state.base is not None)}
    for i in range(max(6, joints)):
        found[f"POSITION_{i + 1}"] = state.positions[i] if i < joints else None
        found[f"VELOCITY_{i + 1}"] = state.velocities[i] if i < joints else None
    base = state.base
    if base is not None:
        found |= {"BASE_X": base.x_m, "BASE_Y": base.y_m, "BASE_YAW": base.yaw_rad}
        found |= {"BASE_VX": base.vx_m_s, "BASE_VY": base.vy_m_s}
        found["BASE_YAW_RATE"] = base.yaw_rate_rad_s
    return found
