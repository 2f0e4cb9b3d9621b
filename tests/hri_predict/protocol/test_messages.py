"""What is filled in when a message goes out."""

import re

import pytest

from hri_predict.protocol.messages import (
    LEVELS,
    Advice,
    Level,
    Message,
    Pose,
    Schema,
    Status,
    Zone,
    at_encoding,
)
from hri_predict.protocol.reasons import Reason
from tests.messages import make_status


@pytest.mark.parametrize(
    "message",
    [
        make_status(cycle=0, capture_ns=5_000_000_000),
        Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, capture_ns=5_000_000_000),
        Zone(person=1, step=0, horizon_s=0.0, capsules=(), capture_ns=5_000_000_000),
        Pose(person=1, step=0, horizon_s=0.0, joints=(), capture_ns=5_000_000_000),
    ],
)
def test_age_counts_from_the_capture_to_the_encoding(
    message: Status | Advice | Zone | Pose,
) -> None:
    def age_at(now_ns: int) -> float | None:
        filled = at_encoding(message, now_ns)
        assert isinstance(filled, Status | Advice | Zone | Pose)
        return filled.age_s

    assert message.age_s is None
    assert age_at(5_040_000_000) == pytest.approx(0.04)
    assert age_at(4_000_000_000) == 0.0  # a capture of the future is not of negative age


def test_without_a_capture_the_age_is_not_available() -> None:
    filled = at_encoding(
        Advice(robot=0, level=Level.UNKNOWN, reason=Reason.NO_INPUT), 5_000_000_000
    )
    assert isinstance(filled, Advice)
    assert filled.age_s is None


def test_only_advice_echoes() -> None:
    advice: Message = Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE, echo=3)
    filled = at_encoding(advice, 0, echo=200)
    assert isinstance(filled, Advice)
    assert filled.echo == 200
    assert at_encoding(advice, 0) == advice
    assert at_encoding(Schema(1, 2), 0, echo=200) == Schema(1, 2)


def test_reasons_say_person_not_nobody_or_somebody():
    for reason in Reason:
        words = set(re.findall(r"[a-z]+", f"{reason.text} {reason.clears_when}".lower()))
        assert words.isdisjoint({"nobody", "somebody", "anybody", "everybody", "whoever"}), reason


def test_whatever_is_not_clear_warn_or_slow_stops_the_robot() -> None:
    assert {level for level in Level if level.may_move} == {Level.CLEAR, Level.WARN, Level.SLOW}


def test_to_a_robot_unknown_and_fault_are_stops() -> None:
    assert [level.rank for level in LEVELS] == [0, 1, 2, 3, 3, 3]
    for level in Level:
        assert level.may_move == (level.rank < Level.STOP.rank)


def test_people_see_a_fault_before_what_is_unknown_and_that_before_a_stop() -> None:
    assert sorted(Level, key=lambda level: level.urgency) == list(LEVELS)
    assert Level.STOP.urgency < Level.UNKNOWN.urgency < Level.FAULT.urgency
