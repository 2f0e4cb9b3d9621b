"""Points from the command line, from the keyboard, and from a robot that reports its state."""

import io
import re
import sys
from pathlib import Path

import numpy as np
import pytest

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import data_path
from hri_predict.cli.register import points
from hri_predict.cli.register.points import Tool, ask, point_from, tool_of
from hri_predict.cli.register.register import register
from hri_predict.contracts.link import Received
from hri_predict.protocol.messages import RobotState
from hri_predict.run import assemble
from hri_sim.baseline_demo import baseline_demo
from tests.messages import make_state

ZERO = np.zeros(3)


class Reports:
    """A link on which these states arrive, one batch at each ``take``."""

    last_error = None

    def __init__(self, *batches: list[RobotState]) -> None:
        self._batches = list(batches)

    def take(self) -> list[Received]:
        batch = self._batches.pop(0) if self._batches else []
        return [Received(state, 0) for state in batch]


def state(robot: int, *positions: float) -> RobotState:
    return make_state(positions, tuple(0.0 for _ in positions), robot=robot)


@pytest.fixture(scope="module")
def ur5e():
    return assemble.build_robots(baseline_demo())[0]


def test_the_tool_is_where_the_newest_state_puts_it(ur5e):
    stale, other = state(0, *[0.5] * 6), state(1, *[1.0] * 6)
    now = state(0, 0.0, -1.57, 1.57, -1.57, -1.57, 0.0)
    tool = Tool(model=ur5e, index=0, link=Reports([stale], [], [other, now]), tool=ZERO)
    assert tool.position() == pytest.approx(ur5e.tool_position(np.array(now.positions), ZERO))


def test_a_longer_tool_reaches_as_much_farther(ur5e):
    q = np.array([0.3, -1.0, 1.2, -0.4, 0.2, 0.1])
    tip = ur5e.tool_position(q, np.array([0.0, 0.0, 0.15]))
    assert np.linalg.norm(tip - ur5e.tool_position(q, ZERO)) == pytest.approx(0.15)
    near = ur5e.capsules(q)
    assert np.linalg.norm(near.b - tip, axis=-1).min() < 0.3


def test_a_robot_that_reports_nothing_is_named(ur5e, monkeypatch):
    monkeypatch.setattr(points, "FRESH_S", 0.05)
    with pytest.raises(ConfigError, match="robot arm: no RobotState within"):
        Tool(model=ur5e, index=0, link=Reports(), tool=ZERO).position()


def test_an_unknown_robot_and_one_without_link_are_named():
    with (
        pytest.raises(ConfigError, match=r"--robot arn: .*did you mean 'arm'"),
        tool_of(baseline_demo(), "arn", ZERO),
    ):
        pass


@pytest.mark.parametrize("text", ["1,2", "a,b,c", "1,2,nan", "1,2,3,4", ""])
def test_a_point_is_three_finite_numbers(text):
    with pytest.raises(ConfigError, match="give 3 numbers: x,y,z"):
        point_from(text, 3, "--point")


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("2000,100,1200", r"x is 2000 m from the room's origin; metres are meant: 2\?"),
        ("0.4,-120,1", r"y is -120 m from .* metres are meant: -0\.12\?"),
        ("1,2,1e9", r"z is 1e\+09 m from .* metres are meant$"),
    ],
)
def test_a_point_in_millimetres_is_named_as_such(text, why):
    with pytest.raises(ConfigError, match=f"--touched {re.escape(text)}: {why}"):
        point_from(text, 3, "--touched")


def test_an_input_that_ends_is_said(monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    with pytest.raises(ConfigError, match="the input ended"):
        ask("Point 1:")


def test_several_sensors_at_once_are_refused():
    with pytest.raises(ConfigError, match="name a configuration with one of them"):
        register(config=Path(data_path("two_sensors.yaml")), seconds=1.0)


@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"point": ["0,0,0"]}, "1 given; give at least 3"),
        ({"walk": True, "joint": "r_hand"}, "--walk: uses the feet"),
        ({"robot": "arm", "point": ["0,0,0"] * 3}, "--robot: provides the points itself"),
        ({"every": 1.0}, "--every: needs the points"),
        ({"point": ["0,0"] * 3}, "give 3 numbers"),
        ({"tool": "0,0,0.1"}, "--tool: has no effect without --robot"),
    ],
)
def test_options_that_do_not_go_together_are_refused_before_anything_is_opened(options, why):
    asked = {"seconds": 1.0} | options
    with pytest.raises(ConfigError, match=why):
        register(config=Path(data_path("live_udp.yaml")), **asked)
