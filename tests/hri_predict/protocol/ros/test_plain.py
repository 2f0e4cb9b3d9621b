"""Plain messages say what the advice says, on the safe side, and 0 wherever the robot must stop."""

import json
import math
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_drivers.links.ros2.codec import worst_bits
from hri_predict.protocol.messages import (
    Advice,
    Level,
    NodeState,
    OperatingMode,
    Pose,
    Schema,
    Status,
    Zone,
    ZoneCapsule,
)
from hri_predict.protocol.reasons import Reason
from hri_predict.protocol.ros.plain import (
    DIAGNOSTICS_NS,
    ERROR,
    OK,
    STALE,
    WARNING,
    PlainMessages,
    percent,
    rounded,
    speed_fraction,
)
from tests.hri_predict.protocol.ros.decoding import by_topic
from tests.messages import make_advice

FULL_M_S = 1.5
NOW_NS = 1_700_000_000_123_456_789
STOPS = (Level.STOP, Level.FAULT, Level.UNKNOWN)
any_number = st.none() | st.floats()
advices = st.builds(
    Advice,
    robot=st.integers(0, 7),
    level=st.sampled_from(Level),
    reason=st.sampled_from(Reason),
    latch_id=st.integers(0, 65_535),
    separation_m=any_number,
    predicted_separation_m=any_number,
    time_to_breach_s=any_number,
    speed_limit_m_s=any_number,
    age_s=any_number,
    mode=st.sampled_from(OperatingMode),
    tool=st.none() | st.integers(0, 255),
)
statuses = st.builds(
    Status,
    node_state=st.sampled_from(NodeState),
    reason=st.sampled_from(Reason),
    people=st.integers(0, 255),
    predictor=st.integers(0, 255),
    cycle=st.integers(0, 2**32),
    age_s=any_number,
)


class Wall:
    """UTC that a test sets."""

    def __init__(self) -> None:
        self.now_ns = NOW_NS

    def __call__(self) -> int:
        return self.now_ns


def plain(wall: Wall | None = None, frame_id: str = "room") -> PlainMessages:
    return PlainMessages(FULL_M_S, frame_id, wall or Wall())


def said(advice: Advice) -> dict[str, Any]:
    """The advice's JSON."""

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is not JSON")

    text = by_topic(plain().of(advice))["advice"].data
    fields: dict[str, Any] = json.loads(text, parse_constant=refuse)
    return fields


ADVICE = make_advice(Level.SLOW, Reason.PERSON_NEAR, speed_limit_m_s=0.75, separation_m=1.25)
BELOW_5_STEPS = replace(ADVICE, speed_limit_m_s=FULL_M_S * math.nextafter(5e-6, 0.0))
"""A fraction that is 5 millionths once it is multiplied, and less before."""


@given(advices)
@example(BELOW_5_STEPS)
def test_every_topic_of_an_advice_says_the_same(advice):
    messages = by_topic(plain().of(advice))
    fraction, fields = messages["speed_fraction"].data, said(advice)
    assert 0.0 <= fraction <= 1.0
    assert 0 <= messages["speed_ovr"].data <= 100.0 * fraction
    assert 0.0 <= fields["speed_fraction"] <= fraction
    assert fields["may_move"] is (fraction > 0)
    assert fields["level"] == advice.level.name.lower()
    assert fields["reason"] == advice.reason.name
    (status,) = messages["diagnostics"].status
    assert advice.reason.text in status.message
    if fraction:
        # one rounding; of numbers below 1e-300 it is a larger part
        assert fraction * FULL_M_S <= advice.speed_limit_m_s * (1 + 1e-15) + 1e-300
        assert fields["speed_limit_m_s"] <= advice.speed_limit_m_s
    else:
        assert fields["speed_limit_m_s"] == messages["speed_ovr"].data == 0


@given(advices, st.sampled_from(STOPS))
def test_a_robot_that_must_stop_gets_0_whatever_its_limit(advice, level):
    assert speed_fraction(replace(advice, level=level), FULL_M_S) == 0.0


@pytest.mark.parametrize("limit", [None, math.nan, math.inf, -math.inf, -1.0, 0.0])
@pytest.mark.parametrize("level", Level)
def test_a_limit_that_makes_no_sense_is_0(level, limit):
    assert speed_fraction(replace(ADVICE, level=level, speed_limit_m_s=limit), FULL_M_S) == 0.0


def test_the_fraction_is_of_full_speed_and_at_most_1():
    assert speed_fraction(ADVICE, 1.5) == 0.5
    assert speed_fraction(ADVICE, 0.5) == 1.0


@given(st.floats(0, 1))
def test_percent_is_rounded_down(fraction):
    assert 100.0 * fraction - 1 < percent(fraction) <= 100.0 * fraction


@pytest.mark.parametrize("to", [math.floor, math.ceil])
@given(st.floats())
def test_numbers_are_rounded_to_their_side_or_not_available(to, value):
    got = rounded(value, to)
    if math.isfinite(value):
        assert got is not None
        assert (got <= value) if to is math.floor else (got >= value)
        # the product and the quotient are each rounded once
        assert abs(got - value) <= 1e-4 + 4e-16 * abs(value)
    else:
        assert got is None


def test_the_json_has_level_reason_limit_distance_stamp_age_and_counters():
    messages = plain()
    messages.of(Status(node_state=NodeState.RUNNING, reason=Reason.NONE, people=1, predictor=0,
                       cycle=41))  # fmt: skip
    advice = replace(ADVICE, age_s=0.03401, latch_id=7)
    for counter in range(3):
        text = by_topic(messages.of(advice)[:3])["advice"].data
        fields = json.loads(text)
        assert fields["counter"] == counter
    assert fields["stamp"] == pytest.approx(NOW_NS * 1e-9, abs=1e-6)
    del fields["counter"], fields["stamp"]
    assert fields == {
        "robot": 0,
        "level": "slow",
        "may_move": True,
        "reason": "PERSON_NEAR",
        "reason_text": Reason.PERSON_NEAR.text,
        "clears_when": Reason.PERSON_NEAR.clears_when,
        "speed_fraction": 0.5,
        "speed_limit_m_s": 0.75,
        "separation_m": 1.25,
        "predicted_separation_m": None,
        "time_to_breach_s": None,
        "age_s": 0.0341,
        "latch_id": 7,
        "mode": "automatic",
        "tool": None,
        "cycle": 41,
    }


@pytest.mark.parametrize(
    ("level", "severity"),
    [
        (Level.CLEAR, OK),
        (Level.WARN, WARNING),
        (Level.SLOW, WARNING),
        (Level.STOP, ERROR),
        (Level.FAULT, ERROR),
        (Level.UNKNOWN, STALE),
    ],
)
def test_diagnostics_have_the_severity_of_the_level(level, severity):
    (status,) = by_topic(plain().of(replace(ADVICE, level=level)))["diagnostics"].status
    assert status.level == severity
    assert status.name == "hri_predict: robot_0"


def test_diagnostics_come_at_a_change_and_once_a_second():
    wall = Wall()
    messages = plain(wall)

    def shown(advice: Advice) -> bool:
        return len(messages.of(advice)) == 4

    assert shown(ADVICE)
    assert not shown(ADVICE)
    assert shown(replace(ADVICE, level=Level.STOP))
    assert shown(replace(ADVICE, level=Level.STOP, robot=1)), "each robot for itself"
    assert shown(replace(ADVICE, level=Level.STOP, reason=Reason.ZONE_OCCUPIED))
    wall.now_ns += DIAGNOSTICS_NS
    assert shown(replace(ADVICE, level=Level.STOP, reason=Reason.ZONE_OCCUPIED))
    wall.now_ns -= 10 * DIAGNOSTICS_NS
    assert shown(replace(ADVICE, level=Level.STOP, reason=Reason.ZONE_OCCUPIED)), "clock set back"


@given(statuses)
def test_a_status_is_one_row_of_the_diagnostics(status):
    (row,) = by_topic(plain().of(status))["diagnostics"].status
    assert row.name == "hri_predict: node"
    assert (row.level == OK) is (status.node_state is NodeState.RUNNING)


def test_the_forecast_is_at_its_time_and_a_missing_joint_is_not_a_number():
    pose = Pose(
        person=1,
        step=3,
        horizon_s=0.5,
        joints=((0, 1.0, 2.0, 3.0), (2, 4.0, 5.0, 6.0)),
        age_s=0.1,
    )
    array = by_topic(plain().of(pose))["forecast"]
    stamp = array.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == pytest.approx(NOW_NS + 400_000_000, abs=1)
    xs = [p.position.x for p in array.poses]
    assert xs[0] == 1.0
    assert math.isnan(xs[1])
    assert xs[2] == 4.0


@given(st.floats(), any_number)
@example(1e300, None)
@example(-1e300, 1e300)
@example(1.75, None)
def test_a_forecast_of_any_time_is_sent(horizon_s, age_s):
    pose = Pose(person=1, step=0, horizon_s=horizon_s, joints=((0, 1.0, 2.0, 3.0),), age_s=age_s)
    stamp = by_topic(plain().of(pose))["forecast"].header.stamp
    ahead_s = horizon_s - (age_s or 0.0)
    if abs(ahead_s) < 1e8:  # from 1970 to 2038; half a nanosecond, and 3 roundings of 1e17 ns
        stamp_ns = stamp.sec * 10**9 + stamp.nanosec
        assert stamp_ns - NOW_NS == pytest.approx(1e9 * ahead_s, abs=64)


def test_colours_are_those_of_the_most_urgent_robot():
    messages = plain()
    assert messages.level is Level.UNKNOWN
    messages.of(replace(ADVICE, level=Level.CLEAR))
    assert messages.level is Level.CLEAR
    messages.of(replace(ADVICE, robot=1, level=Level.STOP))
    assert messages.level is Level.STOP
    messages.of(replace(ADVICE, robot=1, level=Level.WARN))
    assert messages.level is Level.WARN


def test_the_last_words_are_0_for_each_robot_that_was_advised():
    messages = plain()
    assert messages.last_words() == []
    for robot in (0, 3):
        messages.of(replace(ADVICE, robot=robot, level=Level.CLEAR))
    words = messages.last_words()
    for robot in (0, 3):
        own = [w for w in words if w.topic.startswith(f"robot_{robot}/")]
        said_last = by_topic(own)
        assert said_last["speed_fraction"].data == 0.0
        assert said_last["speed_ovr"].data == 0
        assert json.loads(said_last["advice"].data)["level"] == "unknown"


def test_a_schema_is_not_a_plain_message():
    assert plain().of(Schema(1, 2)) == []


LONGEST = "f" * 64
capsules = st.integers(0, 255).map(
    lambda n: tuple(ZoneCapsule(k, (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.1) for k in range(n))
)
bodies = st.builds(
    Zone, person=st.just(65_535), step=st.just(255), horizon_s=st.just(0.5), capsules=capsules
) | st.builds(
    Pose,
    person=st.just(65_535),
    step=st.just(255),
    horizon_s=st.just(0.5),
    joints=st.integers(0, 255).map(lambda n: tuple((j, 0.0, 0.0, 0.0) for j in range(n))),
)


@given(advices | statuses | bodies)
def test_no_message_is_longer_than_the_load_assumes(message):
    messages = plain(frame_id=LONGEST)
    content = sum(len(sample.data) for sample in messages.of(message))
    assert 8 * content <= worst_bits(message)
