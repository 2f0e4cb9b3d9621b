"""Positions of the touched points in the room: given, prompted, or from a robot's tool."""

import math
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.quantities.units import meant
from hri_predict.contracts.link import Received
from hri_predict.protocol.messages import RobotState
from hri_predict.robots.model import RobotModel
from hri_predict.run import assemble
from hri_predict.run.config import Config

FARTHEST_M = 100.0
"""Maximum coordinate of a touched point: a larger one is in millimetres."""
FRESH_S = 1.0
"""Time limit for the RobotState that gives the tool's position."""


def say(text: str) -> None:
    """Print for the user on standard error; standard output is reserved for the result."""
    print(text, file=sys.stderr, flush=True)


def ask(text: str) -> str:
    """Prompt for one line.

    Raises:
        ConfigError: the input ended.
    """
    print(text, end=" ", file=sys.stderr, flush=True)
    line = sys.stdin.readline()
    if not line:
        raise ConfigError("the input ended; run it in a terminal, or give --point and --every")
    return line.strip()


def point_from(text: str, numbers: int, where: str) -> Floats:
    """Return ``x,y,z`` (or ``x,y``) as metres.

    Raises:
        ConfigError: the number of finite values is wrong, or one is not in metres.
    """
    try:
        point = [float(part) for part in text.split(",")]
    except ValueError:
        point = []
    letters = ",".join("xyz"[:numbers])
    if len(point) != numbers or not all(map(math.isfinite, point)):
        raise ConfigError(f"{where} {text}: give {numbers} numbers: {letters} (m, room)")
    far = max(point, key=abs)
    if abs(far) > FARTHEST_M:
        raise ConfigError(
            f"{where} {text}: {letters[point.index(far) * 2]} is {far:g} m from the room's origin; "
            f"{meant(far, 'm')}"
        )
    return np.array(point)


class Hears(Protocol):
    """Data of a link needed to compute the position of a tool."""

    @property
    def last_error(self) -> str | None:
        """One line about the newest error."""

    def take(self) -> list[Received]:
        """See ``Link``."""


class Tool:
    """Position of a robot's tool, from the RobotState of its controller."""

    def __init__(self, *, model: RobotModel, index: int, link: Hears, tool: Floats) -> None:
        self._model, self._index, self._link, self._tool = model, index, link, tool

    def position(self) -> Floats:
        """(3,) metres in the room, now.

        Raises:
            ConfigError: no RobotState was received.
        """
        self._link.take()
        end_s = time.monotonic() + FRESH_S
        while time.monotonic() < end_s:
            for received in reversed(self._link.take()):
                state = received.message
                if isinstance(state, RobotState) and state.robot == self._index:
                    q = np.asarray(state.positions, np.float64)
                    if q.shape == (self._model.dof,) and np.isfinite(q).all():
                        return self._model.tool_position(q, self._tool)
            time.sleep(0.02)
        trouble = self._link.last_error or "the controller sends none"
        raise ConfigError(
            f"robot {self._model.name}: no RobotState within {FRESH_S:g} s ({trouble}); give the "
            f"points with --point instead"
        )


@contextmanager
def tool_of(config: Config, robot: str, tool: Floats) -> Iterator[Tool]:
    """Open the link on which a robot reports its state.

    Raises:
        ConfigError: the robot does not exist, or has no link to its controller.
    """
    names = [settings.name for settings in config.node.robots]
    if robot not in names:
        raise ConfigError(
            f"--robot {robot}: no such robot{nearest(robot, names)} (available: {', '.join(names)})"
        )
    if config.node.robots[names.index(robot)].base is not None:
        raise ConfigError(
            f"--robot {robot}: its base moves, so a point it touches is only as accurate as the "
            "base pose;"
            f" give the points with --point"
        )
    settings = next((k for k in config.links if not k.robots or robot in k.robots), None)
    if settings is None:
        raise ConfigError(f"--robot {robot}: no link to its controller; give --point instead")
    model = assemble.build_robots(config)[names.index(robot)]
    link = assemble.build_link(config, settings, MonotonicClock())
    link.start()
    try:
        yield Tool(model=model, index=names.index(robot), link=link, tool=tool)
    finally:
        link.stop()
