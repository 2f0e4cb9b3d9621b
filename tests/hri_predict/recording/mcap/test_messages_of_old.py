"""RobotStates in recordings: every field comes back, and version 1 of the protocol is readable."""

import json
from typing import Any

import pytest
from hypothesis import given

from hri_predict.protocol.messages import (
    BaseMotion,
    OperatingMode,
    RobotMode,
    RobotState,
    SetChoice,
)
from hri_predict.recording.mcap.format import message_to_dict, received_from_dict, to_json
from tests.hri_predict.protocol.drawn import robot_states
from tests.messages import make_state

NEW = ("request", "enabling", "tool", "tool_confirmed", "base")
STATE = RobotState(
    robot=2,
    mode=RobotMode.MANUAL,
    counter=9,
    positions=(0.5, 1.0),
    velocities=(0.0, 0.25),
    request=OperatingMode.TEACH,
    enabling=True,
    tool=4,
    tool_confirmed=True,
    base=BaseMotion(x_m=1.0, y_m=2.0, yaw_rad=0.5, vx_m_s=0.1, vy_m_s=-0.1, yaw_rate_rad_s=0.0),
)


def recorded(state: RobotState | SetChoice) -> dict[str, Any]:
    """As a file holds it."""
    data: dict[str, Any] = json.loads(to_json(message_to_dict(state)))
    return data


@given(robot_states)
def test_every_field_of_a_state_comes_back(state: RobotState) -> None:
    assert received_from_dict(recorded(state)) == state


@pytest.mark.parametrize("number", [0, 2, 65_535])
def test_a_choice_of_a_set_comes_back(number: int) -> None:
    assert received_from_dict(recorded(SetChoice(number))) == SetChoice(number)


@pytest.mark.parametrize("number", [-1, 65_536, "x", None])
def test_a_choice_of_an_impossible_set_is_refused(number: object) -> None:
    with pytest.raises((ValueError, TypeError)):
        received_from_dict({"type": "SetChoice", "number": number})


def test_a_state_of_version_1_asks_for_nothing() -> None:
    old = {k: v for k, v in recorded(STATE).items() if k not in NEW}
    assert received_from_dict(old) == make_state(
        (0.5, 1.0), (0.0, 0.25), counter=9, robot=2, mode=RobotMode.MANUAL
    )


@pytest.mark.parametrize(
    ("key", "value", "read"),
    [
        ("request", "WHATEVER", OperatingMode.AUTOMATIC),
        ("request", 1, OperatingMode.AUTOMATIC),
        ("enabling", 1, False),
        ("enabling", "true", False),
        ("tool_confirmed", "yes", False),
    ],
)
def test_a_value_that_nobody_knows_permits_nothing(key: str, value: Any, read: Any) -> None:
    got = received_from_dict({**recorded(STATE), key: value})
    assert isinstance(got, RobotState)
    assert getattr(got, key) == read


def test_a_base_of_other_numbers_is_no_state() -> None:
    with pytest.raises((TypeError, ValueError)):
        received_from_dict({**recorded(STATE), "base": {"x_m": 1.0}})


@pytest.mark.parametrize("base", ["x", 1, [1.0], True])
def test_a_base_that_is_no_mapping_is_refused(base: object) -> None:
    with pytest.raises(TypeError):
        received_from_dict({**recorded(STATE), "base": base})
