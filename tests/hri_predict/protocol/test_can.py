"""CAN frames: round trips, saturation, bit errors, lost and mixed parts, hostile input."""

from dataclasses import replace
from itertools import pairwise
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.errors import ConfigError
from hri_predict.protocol.can import DEFAULT_BASE_ID, CanFrame, CanReceiver, CanSender
from hri_predict.protocol.codec import decode_payload, encode_payloads
from hri_predict.protocol.definition import BY_TYPE
from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    OperatingMode,
    Pose,
    Schema,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.protocol.drawn import (
    advices,
    all_messages,
    assert_close,
    classic_messages,
    flat,
    sent_through,
)
from tests.hri_predict.protocol.samples import ADVICE, NINE, SEVEN
from tests.messages import make_state, make_status


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
    high = Advice(
        robot=0,
        level=Level.CLEAR,
        reason=Reason.NONE,
        latch_id=10**9,
        separation_m=inf,
        predicted_separation_m=1e300,
        time_to_breach_s=inf,
        speed_limit_m_s=1e9,
        body_part=62,
        robot_link=62,
        echo=70000,
        age_s=inf,
    )
    got = sent_through(high, fd=False)
    assert flat(got)[3:12] == [65535, 32.767, 32.767, 4.094, 65.534, 62, 62, 65534, 65.534]
    low = Advice(
        robot=0,
        level=Level.CLEAR,
        reason=Reason.NONE,
        latch_id=-3,
        separation_m=-inf,
        predicted_separation_m=-1e300,
        time_to_breach_s=-1.0,
        speed_limit_m_s=-inf,
        body_part=0,
        robot_link=0,
        echo=0,
        age_s=-1.0,
    )
    got = sent_through(low, fd=False)
    assert flat(got)[3:12] == [0, -32.767, -32.767, 0.0, 0.0, 0, 0, 0, 0.0]
    status = make_status(people=99, cycle=300, predictor=999, age_s=1e9)
    assert sent_through(status, False) == make_status(
        people=15, cycle=300 % 256, predictor=255, age_s=65.534
    )
    state = make_state((8.1919, -8.1919), (inf, -inf), counter=65536 + 7)
    assert sent_through(state, False) == make_state(
        (8.19175, -8.19175), (32.767, -32.767), counter=7
    )


def test_the_echo_of_the_last_counter_never_looks_newer_than_it_is() -> None:
    """65535 means "not available": that counter is echoed as the one before it."""
    for counter, echo in ((65533, 65533), (65534, 65534), (65535, 65534), (0, 0)):
        got = sent_through(
            Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, echo=counter), False
        )
        assert isinstance(got, Advice)
        assert got.echo == echo


def test_an_operating_mode_that_nobody_knows_is_automatic() -> None:
    payload = bytearray(encode_payloads(ADVICE)[0])
    payload[0] |= 0xF0
    got = decode_payload(BY_TYPE[Advice], 0, bytes(payload))
    assert isinstance(got, Advice)
    assert (got.level, got.mode) == (ADVICE.level, OperatingMode.AUTOMATIC)


@pytest.mark.parametrize("step", range(-8, 9))
def test_saturation_is_sharp_at_the_ends(step: int) -> None:
    high, low, soon = 65.534 + step / 1000, -32.767 + step / 1000, 4.094 + step / 1000
    got = sent_through(
        Advice(
            robot=0,
            level=Level.CLEAR,
            reason=Reason.NONE,
            latch_id=65535 + step,
            separation_m=low,
            predicted_separation_m=-low,
            time_to_breach_s=soon,
            speed_limit_m_s=high,
            body_part=62 + min(step, 0),
        ),
        False,
    )
    want = [min(65535, 65535 + step), max(-32.767, low), min(32.767, -low)]
    want += [min(4.094, soon), min(65.534, high), 62 + min(step, 0)]
    assert flat(got)[3:9] == pytest.approx(want, abs=1e-9)


def test_every_step_is_kept_exactly() -> None:
    """What is rounded down or up is not moved by a step where the decimal is not exact."""
    for raw in range(65535):
        value, signed = raw / 1000, (raw - 32767) / 1000
        advice = Advice(
            robot=0,
            level=Level.CLEAR,
            reason=Reason.NONE,
            latch_id=0,
            separation_m=signed,
            predicted_separation_m=signed,
            time_to_breach_s=raw % 4095 / 1000,
            speed_limit_m_s=value,
            age_s=value,
        )
        (payload,) = encode_payloads(advice)
        assert decode_payload(BY_TYPE[Advice], 0, payload) == advice


def test_not_available_and_nan_come_back_as_none() -> None:
    none = Advice(robot=3, level=Level.STOP, reason=Reason.NO_INPUT)
    assert sent_through(none, fd=False) == none
    nans = Advice(
        robot=3,
        level=Level.STOP,
        reason=Reason.NO_INPUT,
        latch_id=0,
        separation_m=nan,
        predicted_separation_m=nan,
        time_to_breach_s=nan,
        speed_limit_m_s=nan,
        age_s=nan,
    )
    assert sent_through(nans, fd=False) == none


@pytest.mark.parametrize("fd", [False, True])
@pytest.mark.parametrize("bad", range(4))
def test_a_joint_that_is_no_number_never_arrives(fd: bool, bad: int) -> None:
    sender, receiver = CanSender(fd), CanReceiver(fd)
    row = [nan if i == bad else 0.0 for i in range(4)]
    state = make_state(tuple(row[:2]), tuple(row[2:]))
    assert [m for frame in sender.encode(state) for m in receiver.feed(frame)] == []
    assert receiver.counters.malformed == 1


def test_a_zone_that_is_no_number_never_arrives() -> None:
    zone = Zone(
        person=1,
        step=0,
        horizon_s=0.0,
        capsules=(ZoneCapsule(0, (0.0, nan, 0.0), (0.0, 0.0, 0.0), 0.1),),
    )
    receiver = CanReceiver(True)
    assert [m for frame in CanSender(True).encode(zone) for m in receiver.feed(frame)] == []
    assert receiver.counters.malformed == 1


@given(st.integers(0, 2), st.integers(0, 20))
def test_a_lost_part_withholds_its_message_alone(part: int, at: int) -> None:
    sender, receiver = CanSender(), CanReceiver()
    got = []
    for i in range(24):
        frames = sender.encode(Advice(robot=1, level=Level.CLEAR, reason=Reason.NONE, latch_id=i))
        if i == at:
            del frames[part]
        got += [m.latch_id for f in frames for m in receiver.feed(f) if isinstance(m, Advice)]
    assert got == [i for i in range(24) if i != at]
    assert receiver.counters.incomplete == 1
    assert receiver.counters.counter_errors == (0 if at == 0 else 1)


def test_a_part_that_is_repeated_after_the_message_is_counted() -> None:
    receiver = CanReceiver()
    first, *others = CanSender().encode(ADVICE)
    got = [m for f in (first, *others, others[0], first) for m in receiver.feed(f)]
    assert len(got) == 1
    assert receiver.counters.counter_errors == 2


def test_a_part_that_is_repeated_within_the_message_makes_it_void() -> None:
    """Two senders whose counters are equal: their parts must not make one message."""
    receiver, sender = CanReceiver(), CanSender()
    first, *others = sender.encode(ADVICE)
    assert not any(receiver.feed(f) for f in (first, first, *others, others[0]))
    assert receiver.counters.counter_errors == 4
    assert receiver.counters.incomplete == 0
    assert [m for f in sender.encode(ADVICE) for m in receiver.feed(f)]


@given(st.lists(st.tuples(st.integers(0, 19), st.integers(0, 2)), max_size=60))
def test_parts_in_any_order_never_mix(order: list[tuple[int, int]]) -> None:
    """Whatever subset and order of parts arrives, what comes out was sent so."""
    sender, receiver = CanSender(), CanReceiver()
    sent = [
        Advice(
            robot=1,
            level=Level.SLOW,
            reason=Reason.NONE,
            latch_id=i,
            separation_m=i * 0.5,
            predicted_separation_m=i * 0.25,
            speed_limit_m_s=i * 0.125,
        )
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
        groups.append(
            sender.encode(Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, latch_id=i))
        )
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


def test_what_cannot_be_sent_is_said() -> None:
    with pytest.raises(ValueError, match="classic CAN does not carry Zone"):
        CanSender().encode(Zone(person=1, step=0, horizon_s=0.0, capsules=()))
    with pytest.raises(ValueError, match="at most 9"):
        CanSender().encode(replace(SEVEN, positions=(0.0,) * 10, velocities=(0.0,) * 10))
    with pytest.raises(ValueError, match="robots 0 to 3 only, not for robot 4; use FD or serial"):
        CanSender().encode(replace(NINE, robot=4))
    assert CanSender(fd=True).encode(replace(NINE, robot=4))
    with pytest.raises(ValueError, match="at most 255"):
        CanSender(True).encode(
            Pose(person=1, step=0, horizon_s=0.0, joints=((0, 0.0, 0.0, 0.0),) * 256)
        )
    with pytest.raises(ValueError, match="robot 8"):
        CanSender().encode(Advice(robot=8, level=Level.STOP, reason=Reason.NONE))


def test_reset_forgets_the_sequence_and_parts_under_way() -> None:
    sender, receiver = CanSender(), CanReceiver()
    groups = [sender.encode(ADVICE) for _ in range(50)]
    assert [m for f in groups[0] for m in receiver.feed(f)]
    receiver.feed(groups[1][0])
    receiver.reset()
    assert [m for f in groups[40] for m in receiver.feed(f)]
    assert receiver.counters.incomplete == 0


def test_robots_and_links_keep_apart() -> None:
    sender, receiver = CanSender(), CanReceiver()
    for i in range(50):
        for robot in range(8):
            frames = sender.encode(
                Advice(robot=robot, level=Level.WARN, reason=Reason.NONE, latch_id=i)
            )
            assert [f.arbitration_id for f in frames] == [
                DEFAULT_BASE_ID + 8 * robot + part for part in range(3)
            ]
            assert [m for f in frames for m in receiver.feed(f)] == [
                Advice(robot=robot, level=Level.WARN, reason=Reason.NONE, latch_id=i)
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
