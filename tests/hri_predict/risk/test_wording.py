import pytest

from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import CLEARED, RISING, Reason
from hri_predict.risk.types import Grounds
from hri_predict.risk.wording import (
    NO_LINK,
    NOTE,
    apart_text,
    clears_beside,
    reason_beside,
    troubles,
)


def apart(
    pair_m: float | None,
    needed_m: float | None,
    *,
    speed_m_s: float = 0.0,
    level: Level = Level.STOP,
    reason: Reason = Reason.PERSON_NEAR,
    detail: str = "",
) -> str:
    slack_m = None if pair_m is None or needed_m is None else pair_m - needed_m
    why = Grounds(speed_m_s=speed_m_s, pair_m=pair_m, slack_m=slack_m)
    return apart_text(Advice(robot=0, level=level, reason=reason, detail=detail), why)


def test_at_clear_a_reason_is_a_note_and_holds_nothing_up() -> None:
    fast = Advice(robot=0, level=Level.CLEAR, reason=Reason.PERSON_FAST)
    assert reason_beside(fast) == NOTE + Reason.PERSON_FAST.text
    slow = Advice(robot=0, level=Level.SLOW, reason=Reason.PERSON_FAST)
    assert reason_beside(slow) == Reason.PERSON_FAST.text
    assert reason_beside(Advice(robot=0, level=Level.CLEAR, reason=Reason.NONE)) == Reason.NONE.text
    assert clears_beside(fast, 0.1) == ""


NAMED = [reason for reason in Reason if "risk.band_m" in reason.clears_when]


@pytest.mark.parametrize("reason", NAMED or [Reason.PERSON_NEAR])
def test_the_band_is_said_in_metres_as_configured(reason: Reason) -> None:
    advice = Advice(robot=0, level=Level.STOP, reason=reason)
    assert "by 0.05 m (risk.band_m)" in clears_beside(advice, 0.05)
    assert clears_beside(advice, None) == reason.clears_when  # not known: its key


@pytest.mark.parametrize(
    ("needed_m", "speed_m_s", "level", "said"),
    [
        (0.63, 0.0, Level.STOP, "to spare 0.02 m at 0.00 m/s; more is needed to start"),
        (0.63, 0.25, Level.STOP, "to spare 0.02 m at 0.25 m/s; more is needed to move on"),
        (0.63, 0.25, Level.SLOW, "to spare 0.02 m at 0.25 m/s; more is needed for full speed"),
        (0.55, 1.0, Level.WARN, "to spare 0.10 m at 1.00 m/s; the warning comes earlier"),
        (0.55, 1.0, Level.CLEAR, "to spare 0.10 m at 1.00 m/s"),
        (0.80, 0.0, Level.STOP, "0.15 m too near to start"),
        (0.80, 0.5, Level.STOP, "0.15 m too near at 0.50 m/s"),
    ],
)
def test_a_distance_says_what_it_suffices_for(
    needed_m: float, speed_m_s: float, level: Level, said: str
) -> None:
    assert apart(0.65, needed_m, speed_m_s=speed_m_s, level=level) == f"0.65 m, {said}"


@pytest.mark.parametrize("reason", [Reason.LATCHED, Reason.ROBOT_NOT_AUTOMATIC, Reason.MUTED])
def test_what_distance_does_not_decide_asks_for_no_more_of_it(reason: Reason) -> None:
    assert apart(3.0, 0.6, reason=reason) == "3.00 m, to spare 2.40 m at 0.00 m/s"


def test_what_is_not_known_is_not_said() -> None:
    assert apart(None, None) == "?"
    assert apart(0.5, None) == "0.50 m"
    assert apart(-0.1, None) == "0.00 m"


def test_a_degraded_node_always_says_why() -> None:
    late = [Reason.PREDICTOR_LATE, Reason.PREDICTOR_LATE, Reason.NONE]
    assert troubles(NodeState.DEGRADED, late) == [Reason.PREDICTOR_LATE.text]
    assert troubles(NodeState.DEGRADED, [Reason.NONE]) == [NO_LINK]
    assert troubles(NodeState.DEGRADED, [], ["plc"]) == ["link plc is not connected"]
    assert troubles(NodeState.RUNNING, [Reason.NONE]) == []


@pytest.mark.parametrize(
    ("detail", "level", "said"),
    [
        (CLEARED, Level.STOP, "new captures must confirm it"),
        (RISING, Level.SLOW, "the speed limit"),
    ],
)
def test_once_the_cause_has_cleared_no_more_distance_is_asked_for(
    detail: str, level: Level, said: str
) -> None:
    detail = f"arm: {detail}; clears when it is so"
    text = apart(1.36, 0.52, level=level, detail=detail)
    assert said in text
    assert "needed" not in text
    clears = clears_beside(
        Advice(robot=0, level=level, reason=Reason.PERSON_NEAR, detail=detail), 0.1
    )
    assert "farther" not in clears
    assert "captures" in clears
