"""The risk stage with tools that change and with a base that moves."""

from typing import Any

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import Region
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.settings import RiskSettings
from hri_predict.robots.settings import RobotSettings
from tests.hri_predict.risk.engine_cell import ROBOT, Cell
from tests.hri_predict.robots import mobile

CLAW = {"name": "claw", "a": [0, 0, 0], "b": [0, 0, 0.1], "radius": 0.15}
DRUM = {"name": "drum", "a": [0, 0, 0.1], "b": [0, 0, 0.1], "radius": 0.45}
TOOLS: list[dict[str, Any]] = [
    {"name": "drum", "number": 2, "tool": [DRUM], "payload_kg": 5.0},
    {"name": "claw", "number": 1, "tool": [CLAW], "payload_kg": 0.0},
]
BOTH = RobotSettings.model_validate(ROBOT.model_dump() | {"tools": TOOLS})
MODES = pytest.mark.parametrize("mode", ["iso", "predictive", "reactive", "fixed"])


def with_tools(mode: str, tools: list[dict[str, Any]] | None = None) -> Cell:
    robot = RobotSettings.model_validate(ROBOT.model_dump() | {"tools": tools or TOOLS})
    return Cell(RiskSettings(release_captures=2, mode=mode), robot=robot)


def confirmed(cell: Cell, tool: int | None, is_confirmed: bool = True) -> None:
    cell.said = {"tool": tool, "tool_confirmed": is_confirmed}


@MODES
def test_the_advice_names_the_tool_that_counts(mode: str) -> None:
    cell = with_tools(mode)
    for tool, is_confirmed, named in (
        (1, True, 1),
        (2, False, None),
        (2, True, 2),
        (7, True, None),
    ):
        confirmed(cell, tool, is_confirmed)
        assert cell.step(2.5).tool == named
    assert Cell(RiskSettings(mode=mode)).step(2.5).tool is None


@pytest.mark.parametrize("mode", ["iso", "predictive"])
def test_the_worst_counts_at_once_and_the_milder_after_it_is_confirmed(mode: str) -> None:
    """Somebody stands where the small tool is far from, and the large one is not."""
    cell = with_tools(mode)
    confirmed(cell, 1)
    calm = cell.settle(-2.2)
    confirmed(cell, 1, is_confirmed=False)
    worse = cell.step(-2.2)
    assert worse.separation_m is not None
    assert calm.separation_m is not None
    assert worse.separation_m < calm.separation_m - 0.2
    assert (worse.speed_limit_m_s or 0.0) < (calm.speed_limit_m_s or 0.0)
    assert "no tool is confirmed" in worse.detail
    still = cell.settle(-2.2)
    assert (still.speed_limit_m_s or 0.0) < (calm.speed_limit_m_s or 0.0)
    confirmed(cell, 1)
    again = cell.settle(-2.2)
    assert again.speed_limit_m_s == pytest.approx(calm.speed_limit_m_s)
    assert again.separation_m == pytest.approx(calm.separation_m)


@pytest.mark.parametrize("mode", ["iso", "predictive"])
def test_one_tool_alone_counts_as_if_there_were_no_other(mode: str) -> None:
    both, alone = with_tools(mode), with_tools(mode, TOOLS[1:])
    confirmed(both, 1)
    confirmed(alone, 1)
    for x in (-3.0, -2.0, -1.5):
        one, other = both.settle(x, ticks=8), alone.settle(x, ticks=8)
        assert one.speed_limit_m_s == other.speed_limit_m_s
        assert one.separation_m == other.separation_m
        assert one.predicted_separation_m == other.predicted_separation_m


def test_the_link_is_numbered_as_among_all_tools() -> None:
    cell = with_tools("predictive")
    confirmed(cell, 1)
    # the claw is the second tool's capsule, but the first of those that count
    names = cell.tracker.model.capsule_names
    advice = cell.settle(-1.0)
    assert advice.robot_link is not None
    assert names[advice.robot_link] == "claw/claw"
    assert "from claw/claw" in advice.detail


def test_the_circle_is_that_of_the_worst() -> None:
    cell = with_tools("fixed")
    confirmed(cell, 1)
    cell.settle(-9.0)
    levels = [cell.settle(x, ticks=2).level for x in np.arange(-4.5, -2.4, 0.3)]
    assert {levels[0], levels[-1]} == {Level.CLEAR, Level.STOP}
    confirmed(cell, None)
    cell.settle(-9.0)
    assert [cell.settle(x, ticks=2).level for x in np.arange(-4.5, -2.4, 0.3)] == levels


# --- a base that moves ---

AMR = mobile.settings_of(max_speed_m_s=1.0)


def driving(mode: str, x_m: float = 0.0, **motion: float) -> Cell:
    cell = Cell(RiskSettings(release_captures=2, mode=mode), robot=AMR, horizon_steps=40)
    cell.turn = 0.0
    cell.said = {"base": mobile.moving(x_m=x_m, **motion)}
    return cell


@MODES
def test_where_the_base_is_decides(mode: str) -> None:
    near, far = driving(mode, x_m=3.0), driving(mode, x_m=-20.0)
    assert near.settle(4.0).level is Level.STOP
    assert far.settle(4.0).level is Level.CLEAR
    far.said = {"base": mobile.standing(x_m=3.0)}
    assert far.step(4.0).level is Level.STOP


@MODES
def test_without_its_base_the_robot_is_unknown(mode: str) -> None:
    cell = driving(mode, x_m=-20.0)
    assert cell.settle(4.0).level is Level.CLEAR
    cell.said = {"base": None}
    advice = cell.step(4.0)
    assert (advice.level, advice.reason) == (Level.UNKNOWN, Reason.ROBOT_BASE_UNKNOWN)
    assert advice.speed_limit_m_s == 0.0


@pytest.mark.parametrize("mode", ["iso", "predictive", "reactive"])
def test_a_base_that_drives_needs_more_distance(mode: str) -> None:
    """Towards somebody, in a mode that knows directions; anywhere, in the others."""
    standing, drives = driving(mode), driving(mode, vx=0.6)
    one, other = standing.settle(3.2), drives.settle(3.2)
    assert one.predicted_separation_m is not None
    assert other.predicted_separation_m is not None
    assert other.predicted_separation_m < one.predicted_separation_m - 0.2
    assert drives.engine.robots(drives.now_ns)[0].speed_m_s >= 0.6


def test_the_circle_moves_with_the_base() -> None:
    apart = [driving("fixed", x_m=x).settle(x + 3.0, ticks=5).level for x in (-8.0, 0.0, 7.0)]
    assert apart == [Level.STOP] * 3
    assert driving("fixed", x_m=5.0).settle(5.2).level is Level.STOP
    assert driving("fixed", x_m=-5.0).settle(5.2).level is Level.CLEAR


def test_doors_are_refused() -> None:
    door = Region(polygon=[[30, 0], [31, 0], [31, 1]])
    with pytest.raises(ConfigError, match=r"people.exits.0: the base of robot amr moves"):
        Cell(robot=AMR, doors={"people.exits.0": door}, horizon_steps=40)


def test_what_the_sensor_does_not_see_is_judged_where_the_base_is() -> None:
    view = Region(polygon=[[-10, -10], [10, -10], [10, 10], [-10, 10]])
    cell = Cell(RiskSettings(mode="iso"), robot=AMR, view=view, horizon_steps=40)
    cell.turn = 0.0
    cell.said = {"base": mobile.standing()}
    assert cell.settle(ticks=150).level is Level.CLEAR
    cell.said = {"base": mobile.standing(x_m=9.5)}
    advice = cell.step()
    assert (advice.level, advice.reason) == (Level.STOP, Reason.OUT_OF_VIEW)
