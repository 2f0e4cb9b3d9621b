"""More abilities that a kind of link may have or lack; ``link`` has the others."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from hri_predict.robots.settings import RobotSettings


@runtime_checkable
class OfRobots(Protocol):
    """A kind of link whose settings take defaults from the robots that it advises."""

    def of_robots(self, settings: Any, robots: Sequence[RobotSettings], /) -> Any:
        """Return the settings, completed.

        Raises:
            LinkError: they do not fit these robots: one line that names the link and the remedy.
        """


@runtime_checkable
class Unprotected(Protocol):
    """A kind of link that speaks a third-party protocol, which lacks this node's CRC and counters.

    What it writes is not our messages, so no receiver of ours decodes it.

    Attributes:
        unprotected: one line for the user.
    """

    unprotected: str
