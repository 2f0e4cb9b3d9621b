"""Builds one part for each robot of a configuration, and names the key of each one that fails."""

from collections.abc import Callable
from typing import TypeVar

from hri_predict.base.errors import ConfigMistakes, RobotError
from hri_predict.base.quantities.whole import whole
from hri_predict.robots.model import RobotSettings
from hri_predict.run.config import Config

T = TypeVar("T")


def each_robot(config: Config, make: Callable[[int, RobotSettings], T]) -> tuple[T, ...]:
    """Return ``make(index, settings)`` of each robot, in the configuration's order.

    ``make`` raises RobotErrors that start with a key of the robot's entry.

    Raises:
        RobotError, ConfigMistakes: one or several robots are wrong; one line for each.
    """
    made, wrong = [], []
    for index, settings in enumerate(config.node.robots):
        try:
            made.append(make(index, settings))
        except RobotError as error:
            key, _, rest = str(error).partition(":")
            keys = (key if (number := whole(key)) is None else number for key in key.split("."))
            wrong.append(RobotError(f"{config.place('robots', index, *keys)}:{rest}"))
    if len(wrong) == 1:
        raise wrong[0]
    if wrong:
        raise ConfigMistakes(map(str, wrong))
    return tuple(made)
