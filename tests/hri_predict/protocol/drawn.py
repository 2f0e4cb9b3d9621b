"""Drawn messages, and how they are sent through the CAN codec."""

from typing import Any

import pytest
from hypothesis import strategies as st

from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.messages import (
    Acknowledge,
    Advice,
    BaseMotion,
    Level,
    Message,
    NodeState,
    OperatingMode,
    Pose,
    RobotMode,
    RobotState,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason


def number(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False)


def maybe(strategy: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.none() | strategy


ages = maybe(number(0, 65.534))
points = st.tuples(*[number(-32.767, 32.767)] * 3)
robots = st.integers(0, 7)
advices = st.builds(
    Advice,
    robot=robots,
    level=st.sampled_from(Level),
    reason=st.sampled_from(Reason),
    latch_id=st.integers(0, 65535),
    separation_m=maybe(number(-32.767, 32.767)),
    predicted_separation_m=maybe(number(-32.767, 32.767)),
    time_to_breach_s=maybe(number(0, 4.094)),
    speed_limit_m_s=maybe(number(0, 65.534)),
    body_part=maybe(st.integers(0, 62)),
    robot_link=maybe(st.integers(0, 62)),
    echo=maybe(st.integers(0, 65534)),
    age_s=ages,
    mode=st.sampled_from(OperatingMode),
    tool=maybe(st.integers(0, 254)),
)
statuses = st.builds(
    Status,
    node_state=st.sampled_from(NodeState),
    reason=st.sampled_from(Reason),
    people=st.integers(0, 15),
    predictor=st.integers(0, 255),
    cycle=st.integers(0, 255),
    age_s=ages,
)
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
        mode=st.sampled_from(RobotMode),
        counter=st.integers(0, 65535),
        positions=st.tuples(*[number(-8.1917, 8.1917)] * drawn[0]),
        velocities=st.tuples(*[number(-32.767, 32.767)] * drawn[0]),
        request=st.sampled_from(OperatingMode),
        enabling=st.booleans(),
        tool=maybe(st.integers(0, 254)),
        tool_confirmed=st.booleans(),
        base=st.just(drawn[1]),
    )
)
acknowledges = st.builds(Acknowledge, st.integers(0, 65535), st.integers(0, 2**32 - 1))
schemas = st.builds(Schema, st.integers(0, 65535), st.integers(0, 2**32 - 1))
head = {
    "person": st.integers(0, 65535),
    "step": st.integers(0, 255),
    "horizon_s": number(0, 65.534),
    "age_s": ages,
}
capsules = st.builds(ZoneCapsule, st.integers(0, 255), points, points, number(0, 65.534))
zones = st.builds(Zone, **head, capsules=st.lists(capsules, max_size=18).map(tuple))
joints = st.tuples(st.integers(0, 255), *[number(-32.767, 32.767)] * 3)
poses = st.builds(Pose, **head, joints=st.lists(joints, max_size=22).map(tuple))
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
    """Equal but for the resolution: 1 mm, 1 ms, 1 mm/s, 0.25 mrad; rounding either way."""
    assert type(got) is type(want)
    for a, b in zip(flat(got), flat(want), strict=True):
        assert a == (pytest.approx(b, abs=0.001 + 1e-8) if isinstance(b, float) else b)


def joined(messages: list[Message]) -> Message:
    """Put the pieces of a split Zone or Pose together again."""
    first = messages[0]
    if isinstance(first, Zone):
        parts = [c for m in messages if isinstance(m, Zone) for c in m.capsules]
        return Zone(
            person=first.person,
            step=first.step,
            horizon_s=first.horizon_s,
            capsules=tuple(parts),
            age_s=first.age_s,
        )
    if isinstance(first, Pose):
        found = [j for m in messages if isinstance(m, Pose) for j in m.joints]
        return Pose(
            person=first.person,
            step=first.step,
            horizon_s=first.horizon_s,
            joints=tuple(found),
            age_s=first.age_s,
        )
    assert len(messages) == 1
    return first


def sent_through(message: Message, fd: bool, **ids: Any) -> Message:
    sender, receiver = CanSender(fd, **ids), CanReceiver(fd, **ids)
    got = [m for frame in sender.encode(message) for m in receiver.feed(frame)]
    assert receiver.counters.received == len(got)
    return joined(got)
