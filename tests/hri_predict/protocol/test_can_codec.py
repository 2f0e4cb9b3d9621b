"""CAN frames: round trips, saturation, bit errors, lost and mixed parts, hostile input."""

from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.errors import ConfigError
from hri_predict.protocol.can_codec import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.codec import decode_payload, encode_payloads
from hri_predict.protocol.definition import BY_TYPE
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
    ZoneCapsule,
)
from hri_predict.reasons import Reason


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
    time_to_breach_s=maybe(number(0, 65.534)),
    speed_limit_m_s=maybe(number(0, 65.534)),
    body_part=maybe(st.integers(0, 254)),
    robot_link=maybe(st.integers(0, 254)),
    echo=maybe(st.integers(0, 65534)),
    age_s=ages,
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
robot_states = st.integers(0, 7).flatmap(
    lambda joints: st.builds(
        RobotState,
        robot=robots,
        mode=st.sampled_from(RobotMode),
        counter=st.integers(0, 65535),
        positions=st.tuples(*[number(-8.188, 8.188)] * joints),
        velocities=st.tuples(*([number(-32.767, 32.767)] * 6 + [number(-20.47, 20.47)])[:joints]),
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
    """Equal but for the resolution: 1 mm, 1 ms, 1 mm/s, 0.25 mrad; rounding either way.

    The seventh joint has 4 mrad and 10 mrad/s.
    """
    assert type(got) is type(want)
    if isinstance(got, RobotState) and isinstance(want, RobotState):
        assert got.positions[6:] == pytest.approx(want.positions[6:], abs=0.002 + 1e-8)
        assert got.velocities[6:] == pytest.approx(want.velocities[6:], abs=0.005 + 1e-8)
        got = replace(got, positions=got.positions[:6], velocities=got.velocities[:6])
        want = replace(want, positions=want.positions[:6], velocities=want.velocities[:6])
    for a, b in zip(flat(got), flat(want), strict=True):
        assert a == (pytest.approx(b, abs=0.001 + 1e-8) if isinstance(b, float) else b)


def joined(messages: list[Message]) -> Message:
    """Put the pieces of a split Zone or Pose together again."""
    first = messages[0]
    if isinstance(first, Zone):
        parts = [c for m in messages if isinstance(m, Zone) for c in m.capsules]
        return Zone(first.person, first.step, first.horizon_s, tuple(parts), first.age_s)
    if isinstance(first, Pose):
        found = [j for m in messages if isinstance(m, Pose) for j in m.joints]
        return Pose(first.person, first.step, first.horizon_s, tuple(found), first.age_s)
    assert len(messages) == 1
    return first


def sent_through(message: Message, fd: bool, **ids: Any) -> Message:
    sender, receiver = CanSender(fd, **ids), CanReceiver(fd, **ids)
    got = [m for frame in sender.encode(message) for m in receiver.feed(frame)]
    assert receiver.counters.received == len(got)
    return joined(got)


@given(classic_messages)
def test_classic_round_trip(message: Message) -> None:
    assert_close(sent_through(message, fd=False), message)


@given(all_messages)
def test_fd_round_trip(message: Message) -> None:
    assert_close(sent_through(message, fd=True), message)


@given(classic_messages)
def test_what_was_decoded_encodes_to_the_same_bytes(message: Message) -> None:
    again = sent_through(message, fd=False)
    assert CanSender().encode(again) == CanSender().encode(message)


@given(st.data())
def test_rounding_goes_to_the_safe_side(data: st.DataObject) -> None:
    advice = data.draw(advices)
    got = sent_through(advice, fd=False)
    assert isinstance(got, Advice)
    for name in ("separation_m", "predicted_separation_m", "time_to_breach_s", "speed_limit_m_s"):
        if getattr(advice, name) is not None:
            assert getattr(got, name) <= getattr(advice, name) + 1e-8
    if advice.age_s is not None and got.age_s is not None:
        assert got.age_s >= advice.age_s - 1e-8


def test_extremes_saturate() -> None:
    high = Advice(0, Level.CLEAR, Reason.NONE, 10**9, inf, 1e300, inf, 1e9, 254, 254, 70000, inf)
    got = sent_through(high, fd=False)
    assert flat(got)[3:12] == [65535, 32.767, 32.767, 65.534, 65.534, 254, 254, 65534, 65.534]
    low = Advice(0, Level.CLEAR, Reason.NONE, -3, -inf, -1e300, -1.0, -inf, -5, -5, 0, -1.0)
    got = sent_through(low, fd=False)
    assert flat(got)[3:12] == [0, -32.767, -32.767, 0.0, 0.0, 0, 0, 0, 0.0]
    status = Status(NodeState.RUNNING, Reason.NONE, 99, 999, 300, 1e9)
    assert sent_through(status, False) == Status(
        NodeState.RUNNING, Reason.NONE, 15, 255, 300 % 256, 65.534
    )
    state = RobotState(0, RobotMode.AUTOMATIC, 65536 + 7, (100.0, -100.0), (inf, -inf))
    assert sent_through(state, False) == RobotState(
        0, RobotMode.AUTOMATIC, 7, (8.19175, -8.19175), (32.767, -32.767)
    )
    seven = RobotState(0, RobotMode.AUTOMATIC, 65535, (0.0,) * 6 + (-9.0,), (0.0,) * 6 + (99.0,))
    assert sent_through(seven, False) == RobotState(
        0, RobotMode.AUTOMATIC, 65535, (0.0,) * 6 + (-8.188,), (0.0,) * 6 + (20.47,)
    )


def test_the_echo_of_the_last_counter_never_looks_newer_than_it_is() -> None:
    """65535 means "not available": that counter is echoed as the one before it."""
    for counter, echo in ((65533, 65533), (65534, 65534), (65535, 65534), (0, 0)):
        got = sent_through(Advice(0, Level.CLEAR, Reason.NONE, echo=counter), False)
        assert isinstance(got, Advice)
        assert got.echo == echo


def test_the_bytes_of_a_robot_state() -> None:
    """As PROTOCOL.md says: mode and joints, counter, joint 7 in twelve bits each, then the rest."""
    six = RobotState(0, RobotMode.AUTOMATIC, 0x1234, (0.25,) * 6, (-0.001,) * 6)
    (payload,) = encode_payloads(six)
    assert payload == bytes.fromhex("61 34 12 00 08 80" + "E8 03" * 6 + "FF FF" * 6)
    seven = RobotState(0, RobotMode.AUTOMATIC, 0x1234, (0.0,) * 6 + (1.0,), (0.0,) * 6 + (-1.0,))
    (payload,) = encode_payloads(seven)
    word = (250 & 0xFFF) | (-100 & 0xFFF) << 12
    assert payload == bytes((0x71, 0x34, 0x12)) + word.to_bytes(3, "little") + bytes(24)


@pytest.mark.parametrize("step", range(-8, 9))
def test_saturation_is_sharp_at_the_ends(step: int) -> None:
    high, low = 65.534 + step / 1000, -32.767 + step / 1000
    got = sent_through(
        Advice(0, Level.CLEAR, Reason.NONE, 65535 + step, low, -low, high, high, 254 + step), False
    )
    want = [min(65535, 65535 + step), max(-32.767, low), min(32.767, -low)]
    want += [min(65.534, high), min(65.534, high), min(254, 254 + step)]
    assert flat(got)[3:9] == pytest.approx(want, abs=1e-9)


def test_every_step_is_kept_exactly() -> None:
    """What is rounded down or up is not moved by a step where the decimal is not exact."""
    for raw in range(65535):
        value, signed = raw / 1000, (raw - 32767) / 1000
        advice = Advice(
            *(0, Level.CLEAR, Reason.NONE, 0, signed, signed, value, value), age_s=value
        )
        (payload,) = encode_payloads(advice)
        assert decode_payload(BY_TYPE[Advice], 0, payload) == advice


def test_not_available_and_nan_come_back_as_none() -> None:
    none = Advice(3, Level.STOP, Reason.NO_INPUT)
    assert sent_through(none, fd=False) == none
    nans = Advice(3, Level.STOP, Reason.NO_INPUT, 0, nan, nan, nan, nan, age_s=nan)
    assert sent_through(nans, fd=False) == none


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("bad", range(4))
def test_a_joint_that_is_no_number_never_arrives(fd: bool, bad: int) -> None:
    sender, receiver = CanSender(fd), CanReceiver(fd)
    row = [nan if i == bad else 0.0 for i in range(4)]
    state = RobotState(0, RobotMode.AUTOMATIC, 1, tuple(row[:2]), tuple(row[2:]))
    assert [m for frame in sender.encode(state) for m in receiver.feed(frame)] == []
    assert receiver.counters.malformed == 1


def test_a_zone_that_is_no_number_never_arrives() -> None:
    zone = Zone(1, 0, 0.0, (ZoneCapsule(0, (0.0, nan, 0.0), (0.0, 0.0, 0.0), 0.1),))
    receiver = CanReceiver(True)
    assert [m for frame in CanSender(True).encode(zone) for m in receiver.feed(frame)] == []
    assert receiver.counters.malformed == 1


ADVICE = Advice(1, Level.SLOW, Reason.PERSON_NEAR, 5, 1.25, 0.4, 0.32, 0.75, 12, 6, 200, 0.041)


@given(st.integers(0, 2), st.integers(0, 20))
def test_a_lost_part_withholds_its_message_alone(part: int, at: int) -> None:
    sender, receiver = CanSender(), CanReceiver()
    got = []
    for i in range(24):
        frames = sender.encode(Advice(1, Level.CLEAR, Reason.NONE, latch_id=i))
        if i == at:
            del frames[part]
        got += [m.latch_id for f in frames for m in receiver.feed(f) if isinstance(m, Advice)]
    assert got == [i for i in range(24) if i != at]
    assert receiver.counters.incomplete == 1
    assert receiver.counters.counter_errors == (0 if at == 0 else 1)


def test_a_repeated_part_is_counted() -> None:
    receiver = CanReceiver()
    first, *others = CanSender().encode(ADVICE)
    got = [m for f in (first, first, *others, others[0]) for m in receiver.feed(f)]
    assert len(got) == 1
    assert receiver.counters.counter_errors == 2


@given(st.lists(st.tuples(st.integers(0, 19), st.integers(0, 2)), max_size=60))
def test_parts_in_any_order_never_mix(order: list[tuple[int, int]]) -> None:
    """Whatever subset and order of parts arrives, what comes out was sent so."""
    sender, receiver = CanSender(), CanReceiver()
    sent = [
        Advice(1, Level.SLOW, Reason.NONE, i, i * 0.5, i * 0.25, speed_limit_m_s=i * 0.125)
        for i in range(20)
    ]
    groups = [sender.encode(m) for m in sent]
    got = [m for group, part in order for m in receiver.feed(groups[group][part])]
    assert all(m in sent for m in got)
    assert all(a != b for a, b in pairwise(got))


@given(st.data())
def test_old_and_repeated_frames_between_new_ones_are_never_fresh(data: st.DataObject) -> None:
    fd = data.draw(st.booleans())
    sender, receiver = CanSender(fd), CanReceiver(fd)
    groups: list[list[CanFrame]] = []
    for i in range(data.draw(st.integers(1, 20))):
        groups.append(sender.encode(Advice(0, Level.CLEAR, Reason.NONE, latch_id=i)))
        got = [m for f in groups[-1] for m in receiver.feed(f)]
        assert [m.latch_id for m in got if isinstance(m, Advice)] == [i]
        old = data.draw(st.sampled_from(groups))
        errors = receiver.counters.counter_errors
        assert [m for f in old for m in receiver.feed(f)] == []
        assert receiver.counters.counter_errors > errors


@pytest.mark.parametrize("fd", [False, True])
def test_the_schema_of_a_restarted_node_is_heard_at_once(fd: bool) -> None:
    receiver = CanReceiver(fd)
    for run in range(3):
        sender = CanSender(fd)
        for _ in range(1 + 20 * run):
            (frame,) = sender.encode(Schema(1, run))
            assert receiver.feed(frame) == [Schema(1, run)]
    assert receiver.counters.counter_errors == 0


def test_robots_and_links_keep_apart() -> None:
    sender, receiver = CanSender(), CanReceiver()
    for i in range(50):
        for robot in range(8):
            frames = sender.encode(Advice(robot, Level.WARN, Reason.NONE, latch_id=i))
            assert [f.arbitration_id for f in frames] == [
                DEFAULT_BASE_ID + 8 * robot + part for part in range(3)
            ]
            assert [m for f in frames for m in receiver.feed(f)] == [
                Advice(robot, Level.WARN, Reason.NONE, latch_id=i)
            ]
    elsewhere = CanReceiver(base_id=0x100)
    assert elsewhere.feed(frames[0]) == []
    assert elsewhere.counters.ignored == 1


@pytest.mark.parametrize("fd", [False, True])
def test_extended_ids(fd: bool) -> None:
    ids: dict[str, Any] = {"base_id": 0x18FF4000, "extended": True}
    assert sent_through(ADVICE, fd, **ids)
    assert all(f.extended for f in CanSender(fd, **ids).encode(ADVICE))
    standard = CanReceiver(fd)
    for frame in CanSender(fd, extended=True).encode(ADVICE):
        assert standard.feed(frame) == []
    assert standard.counters.received == 0


@pytest.mark.parametrize(("base", "extended"), [(0x7C0, False), (-1, False), (0x1FFFFFFF, True)])
def test_a_base_id_without_room_is_refused(base: int, extended: bool) -> None:
    with pytest.raises(ConfigError, match="choose one between 0x0 and"):
        CanSender(base_id=base, extended=extended)


def test_what_cannot_be_sent_is_said() -> None:
    with pytest.raises(ValueError, match="classic CAN does not carry Zone"):
        CanSender().encode(Zone(1, 0, 0.0, ()))
    with pytest.raises(ValueError, match="at most 7"):
        CanSender().encode(RobotState(0, RobotMode.MANUAL, 0, (0.0,) * 8, (0.0,) * 8))
    with pytest.raises(ValueError, match="at most 255"):
        CanSender(True).encode(Pose(1, 0, 0.0, ((0, 0.0, 0.0, 0.0),) * 256))
    with pytest.raises(ValueError, match="robot 8"):
        CanSender().encode(Advice(8, Level.STOP, Reason.NONE))


def test_reset_forgets_the_sequence_and_parts_under_way() -> None:
    sender, receiver = CanSender(), CanReceiver()
    groups = [sender.encode(ADVICE) for _ in range(50)]
    assert [m for f in groups[0] for m in receiver.feed(f)]
    receiver.feed(groups[1][0])
    receiver.reset()
    assert [m for f in groups[40] for m in receiver.feed(f)]
    assert receiver.counters.incomplete == 0
