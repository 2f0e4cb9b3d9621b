"""Further optional abilities of a kind of link; ``link`` has the others."""

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

from hri_predict.robots.settings import RobotSettings


@runtime_checkable
class OfRobots(Protocol):
    """A kind of link with defaults that depend on its advised robots."""

    def of_robots(self, settings: Any, robots: Sequence[RobotSettings], /) -> Any:
        """Return the settings, completed.

        Raises:
            LinkError: they do not fit these robots: one line that names the link and the remedy.
        """


@runtime_checkable
class RefusesOld(Protocol):
    """Settings of a link that itself refuses old advice, since its controller sees no ages.

    Attributes:
        max_age_s: maximum age of the capture at this end of the link; ``None``: the maximum that
            the delay budget allows, which the node fills in.
    """

    max_age_s: float | None


@runtime_checkable
class Unprotected(Protocol):
    """A kind of link that uses a third-party protocol without this node's CRC and counters.

    Its data are not this project's messages, so this project's receivers cannot decode them.

    Attributes:
        unprotected: one line for the user.
    """

    unprotected: str
