"""What is filled in when a message goes out."""

import pytest

from hri_predict.protocol.messages import (
    Advice,
    Level,
    Message,
    NodeState,
    Pose,
    Schema,
    Status,
    Zone,
    at_encoding,
)
from hri_predict.reasons import Reason


@pytest.mark.parametrize(
    "message",
    [
        Status(NodeState.RUNNING, Reason.NONE, 0, 0, 0, capture_ns=5_000_000_000),
        Advice(0, Level.CLEAR, Reason.NONE, capture_ns=5_000_000_000),
        Zone(1, 0, 0.0, (), capture_ns=5_000_000_000),
        Pose(1, 0, 0.0, (), capture_ns=5_000_000_000),
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
    filled = at_encoding(Advice(0, Level.UNKNOWN, Reason.NO_INPUT), 5_000_000_000)
    assert isinstance(filled, Advice)
    assert filled.age_s is None


def test_only_advice_echoes() -> None:
    advice: Message = Advice(0, Level.CLEAR, Reason.NONE, echo=3)
    filled = at_encoding(advice, 0, echo=200)
    assert isinstance(filled, Advice)
    assert filled.echo == 200
    assert at_encoding(advice, 0) == advice
    assert at_encoding(Schema(1, 2), 0, echo=200) == Schema(1, 2)
