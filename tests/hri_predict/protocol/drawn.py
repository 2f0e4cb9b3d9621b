"""Drawn messages, and how they are sent through the CAN codec."""

import dataclasses
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import strategies as st

from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.fields import Field
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


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


def maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


def value_of(field: Field) -> st.SearchStrategy[Any]:
    """Any value that a field can hold."""
    low, high = field.raw_range
    values: st.SearchStrategy[Any] = st.integers(low, high)
    if field.enum:
        values = st.sampled_from(field.enum)
    elif field.flag:
        values = st.booleans()
    elif field.scale:
        values = number(low / field.scale, high / field.scale)
    return maybe(values) if field.optional else values


def named(kind: type[Message]) -> dict[str, st.SearchStrategy[Any]]:
    """Values for the attributes of a message that are fields."""
    own = {f.name for f in dataclasses.fields(kind)}
    return {f.member: value_of(f) for f in BY_TYPE[kind].fields if f.member in own}


def items_of(kind: type[Message]) -> list[st.SearchStrategy[Any]]:
    """Values for the fields of one item."""
    return [value_of(f) for f in BY_TYPE[kind].item]


robots = st.integers(0, 7)
advices = st.builds(Advice, robot=robots, **named(Advice))
statuses = st.builds(Status, **named(Status))
bases = st.builds(
    BaseMotion,
    x_m=number(-32.767, 32.767),
    y_m=number(-32.767, 32.767),
    yaw_rad=number(-3.1415, 3.1415),
    vx_m_s=number(-32.767, 32.767),
    vy_m_s=number(-32.767, 32.767),
    yaw_rate_rad_s=number(-32.767, 32.767),
)
robot_states = st.tuples(st.integers(0, 9), maybe(bases)).flatmap(
    lambda drawn: st.builds(
        RobotState,
        robot=robots if drawn[1] is None else st.integers(0, 3),
        **named(RobotState),
        positions=st.tuples(*[number(-8.1917, 8.1917)] * drawn[0]),
        velocities=st.tuples(*[number(-32.767, 32.767)] * drawn[0]),
        base=st.just(drawn[1]),
    )
)
acknowledges = st.builds(Acknowledge, **named(Acknowledge))
schemas = st.builds(Schema, **named(Schema))
capsules = st.tuples(*items_of(Zone)).map(
    lambda row: ZoneCapsule(row[0], row[1:4], row[4:7], row[7])
)
zones = st.builds(Zone, **named(Zone), capsules=st.lists(capsules, max_size=18).map(tuple))
joints = st.tuples(*items_of(Pose))
poses = st.builds(Pose, **named(Pose), joints=st.lists(joints, max_size=22).map(tuple))
classic_messages = st.one_of(advices, statuses, robot_states, acknowledges, schemas)
all_messages = st.one_of(classic_messages, zones, poses)


def flat(value: Any) -> list[Any]:
    """All numbers of a message in order, however nested."""
    if isinstance(value, tuple | list):
        return [x for v in value for x in flat(v)]
    if hasattr(value, "__dataclass_fields__"):
        return [x for name in value.__dataclass_fields__ for x in flat(getattr(value, name))]
    return [value]


def assert_close(got: Any, want: Any) -> None:
    """Equal but for the resolution of the message's coarsest field; rounding either way."""
    assert type(got) is type(want)
    definition = BY_TYPE[type(want)]
    steps = [f.resolution for f in (*definition.fields, *definition.item) if f.scale]
    slack = max(steps, default=0.0) + 1e-8  # a decimal fraction is inexact in binary
    for a, b in zip(flat(got), flat(want), strict=True):
        assert a == (pytest.approx(b, abs=slack) if isinstance(b, float) else b)


def joined(messages: list[Message]) -> Message:
    """Put the pieces of a split Zone or Pose together again."""
    first = messages[0]
    name = BY_TYPE[type(first)].items
    if not name:
        assert len(messages) == 1
        return first
    whole: dict[str, Any] = {name: tuple(i for m in messages for i in getattr(m, name))}
    return replace(first, **whole)


def sent_through(message: Message, fd: bool, **ids: Any) -> Message:
    sender, receiver = CanSender(fd, **ids), CanReceiver(fd, **ids)
    got = [m for frame in sender.encode(message) for m in receiver.feed(frame)]
    assert receiver.counters.received == len(got)
    return joined(got)
