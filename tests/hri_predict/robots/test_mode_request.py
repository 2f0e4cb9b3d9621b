"""What a robot's controllers ask for counts only where all of them ask it, freshly."""

from dataclasses import replace

import pytest

from hri_predict.protocol.messages import OperatingMode, RobotMode, RobotState
from hri_predict.robots.mode_request import NOTHING_ASKED, ModeRequest, ModeRequests
from tests.messages import make_state

MS = 1_000_000
TEACH = make_state((), (), mode=RobotMode.MANUAL, request=OperatingMode.TEACH, enabling=True)
TAUGHT = ModeRequest(RobotMode.MANUAL, OperatingMode.TEACH, enabling=True, heard=True)


def asked(*states: tuple[RobotState, int], now_ms: int = 100) -> ModeRequest:
    """Each state on a link of its own, at its time in ms."""
    links = ModeRequests()
    for i, (state, at_ms) in enumerate(states):
        links.take(state, at_ms * MS, f"link {i}")
    return links.at(now_ms * MS, 0.1)


def test_one_controller_asks_for_itself() -> None:
    assert asked((TEACH, 0)) == TAUGHT
    assert asked((TEACH, 0), now_ms=101) == NOTHING_ASKED  # stale
    assert asked() == NOTHING_ASKED
    assert not NOTHING_ASKED.heard


def test_two_controllers_must_agree() -> None:
    assert asked((TEACH, 0), (TEACH, 50)) == TAUGHT
    other = asked((TEACH, 0), (replace(TEACH, request=OperatingMode.AUTOMATIC), 50))
    assert not other.agreed
    lets_go = asked((TEACH, 0), (replace(TEACH, enabling=False), 50))
    assert lets_go == replace(TAUGHT, enabling=False)
    differs = asked((TEACH, 0), (replace(TEACH, mode=RobotMode.AUTOMATIC), 50))
    assert differs.mode is RobotMode.UNKNOWN


@pytest.mark.parametrize("request_", OperatingMode)
def test_a_controller_that_falls_silent_agrees_with_nothing(request_) -> None:
    silent = (replace(TEACH, request=request_), 0)
    assert asked(silent, (TEACH, 50), now_ms=120) == replace(TAUGHT, agreed=False)
    assert asked(silent, (TEACH, 0), now_ms=120) == NOTHING_ASKED


def test_only_a_true_enabling_device_is_held() -> None:
    state = replace(TEACH, enabling="yes")  # type: ignore[arg-type]
    assert not asked((state, 0)).enabling
