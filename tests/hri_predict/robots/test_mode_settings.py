"""``robots[].modes``: nothing by default, and each mistake in one line with its remedy."""

from typing import Any

import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.robots.model import RobotSettings

ROBOT = {"name": "arm", "model": "ur5e", "room_from_robot": {}, "max_speed_m_s": 1.0}
PLANNED = {"kind": "state", "plan": "pick_and_place"}


def robot(modes: Any, motion: Any = PLANNED) -> RobotSettings:
    return validated(RobotSettings, {**ROBOT, "motion": motion, "modes": modes}, "robots.0")


def test_nothing_is_allowed_by_default() -> None:
    assert validated(RobotSettings, ROBOT, "robots.0").modes.allowed == []
    assert robot({}).modes.allowed == []
    assert robot({"teach": None}).modes.allowed == []


def test_each_mode_is_allowed_by_its_own_key() -> None:
    modes = robot({"teach": {}, "recovery": {"speed_m_s": 0.05}, "muting": {"max_s": 3}}).modes
    assert modes.allowed == ["teach", "recovery", "muting"]
    assert modes.teach is not None
    assert modes.teach.speed_m_s == 0.25
    assert robot({"muting": {"max_s": 3}}).modes.allowed == ["muting"]


@pytest.mark.parametrize(
    ("modes", "motion", "words"),
    [
        ({"teach": {"speed_m_s": 0.26}}, PLANNED, "modes.teach.speed_m_s"),
        ({"teach": {"speed_m_s": 0}}, PLANNED, "modes.teach.speed_m_s"),
        ({"teach": {"speed_m_s": float("nan")}}, PLANNED, "modes.teach.speed_m_s"),
        ({"recovery": {"speed_m_s": 0.2}}, PLANNED, "modes.recovery.speed_m_s"),
        ({"muting": {}}, PLANNED, "modes.muting.max_s: required key is missing"),
        ({"muting": {"max_s": 0}}, PLANNED, "modes.muting.max_s"),
        ({"muting": {"max_s": True}}, PLANNED, "modes.muting.max_s"),
        ({"muting": {"max_s": "5"}}, PLANNED, "modes.muting.max_s"),
        ({"muting": {"max_s": 1e9}}, PLANNED, "modes.muting.max_s"),
        ({"muting": {"max_s": float("inf")}}, PLANNED, "modes.muting.max_s"),
        ({"muted": {"max_s": 3}}, PLANNED, "unknown key; did you mean 'muting'"),
        ({"teach": True}, PLANNED, "modes.teach"),
        ([], PLANNED, "modes"),
        ({"recovery": {}}, {"kind": "state"}, "modes.recovery needs motion.plan"),
        (
            {"teach": {}},
            {"kind": "trajectory", "file": "pick_and_place"},
            "modes.teach is requested in RobotState; set motion: {kind: state}",
        ),
    ],
)
def test_a_mistake_is_one_line(modes: Any, motion: Any, words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        robot(modes, motion)
    assert words in str(caught.value)
    assert len(str(caught.value).splitlines()) == 1


def test_muting_rests_for_nine_times_its_time_by_default() -> None:
    muting = robot({"muting": {"max_s": 4}}).modes.muting
    assert muting is not None
    assert (muting.recovery_s, muting.share) == (36, 0.1)


def test_muting_for_more_than_half_of_the_time_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"rest_s 3 is shorter than max_s 4.*raise rest_s"):
        robot({"muting": {"max_s": 4, "rest_s": 3}})
