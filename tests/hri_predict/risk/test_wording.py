import pytest

from hri_predict.protocol.messages import Level, NodeState
from hri_predict.protocol.reasons import CLEARED, RISING, Reason
from hri_predict.risk.wording import (
    NO_LINK,
    NOTE,
    apart_text,
    clears_beside,
    reason_beside,
    troubles,
)


def test_at_clear_a_reason_is_a_note_and_holds_nothing_up() -> None:
    assert reason_beside(Level.CLEAR, Reason.PERSON_FAST) == NOTE + Reason.PERSON_FAST.text
    assert reason_beside(Level.SLOW, Reason.PERSON_FAST) == Reason.PERSON_FAST.text
    assert reason_beside(Level.CLEAR, Reason.NONE) == Reason.NONE.text
    assert clears_beside(Level.CLEAR, Reason.PERSON_FAST, "", 0.1) == ""


NAMED = [reason for reason in Reason if "risk.band_m" in reason.clears_when]


@pytest.mark.parametrize("reason", NAMED or [Reason.PERSON_NEAR])
def test_the_band_is_said_in_metres_as_configured(reason: Reason) -> None:
    said = clears_beside(Level.STOP, reason, "", 0.05)
    assert "by 0.05 m (risk.band_m)" in said
    assert clears_beside(Level.STOP, reason, "", None) == reason.clears_when  # not known: its key


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
    text = apart_text(
        pair_m=0.65,
        needed_m=needed_m,
        speed_m_s=speed_m_s,
        level=level,
        reason=Reason.PERSON_NEAR,
        detail="",
    )
    assert text == f"0.65 m, {said}"


@pytest.mark.parametrize("reason", [Reason.LATCHED, Reason.ROBOT_NOT_AUTOMATIC, Reason.MUTED])
def test_what_distance_does_not_decide_asks_for_no_more_of_it(reason: Reason) -> None:
    text = apart_text(
        pair_m=3.0, needed_m=0.6, speed_m_s=0.0, level=Level.STOP, reason=reason, detail=""
    )
    assert text == "3.00 m, to spare 2.40 m at 0.00 m/s"


def test_what_is_not_known_is_not_said() -> None:
    def of(pair_m: float | None, needed_m: float | None) -> str:
        return apart_text(
            pair_m=pair_m,
            needed_m=needed_m,
            speed_m_s=0.0,
            level=Level.STOP,
            reason=Reason.PERSON_NEAR,
            detail="",
        )

    assert of(None, None) == "?"
    assert of(0.5, None) == "0.50 m"
    assert of(-0.1, None) == "0.00 m"


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
    text = apart_text(
        pair_m=1.36,
        needed_m=0.52,
        speed_m_s=0.0,
        level=level,
        reason=Reason.PERSON_NEAR,
        detail=detail,
    )
    assert said in text
    assert "needed" not in text
    clears = clears_beside(level, Reason.PERSON_NEAR, detail, 0.1)
    assert "farther" not in clears
    assert "captures" in clears
