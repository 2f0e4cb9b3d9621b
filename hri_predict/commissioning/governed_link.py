"""A link on which a test can restrict a robot further, but never permit more.

The node assesses people as always. The governor can lower a speed limit granted by the node, or
replace it with a stop; it cannot lift a stop of the node.
"""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

from hri_predict.contracts.link import Link, Received
from hri_predict.protocol.messages import Advice, Level, Message, RobotState
from hri_predict.protocol.reasons import Reason

Limit = Callable[[int], float]
"""Robot's index -> current maximum speed allowed by the test, in m/s; 0: stop."""


def lowered(advice: Advice, limit_m_s: float) -> Advice:
    """Return the advice with its limit capped at ``limit_m_s``, in m/s; a stop stays a stop."""
    granted = advice.speed_limit_m_s or 0.0
    if not advice.level.may_move or granted <= 0:
        return advice
    if not limit_m_s > 0:  # NaN too
        return replace(advice, level=Level.STOP, reason=Reason.SHADOW_MODE, speed_limit_m_s=0.0)
    if limit_m_s >= granted:
        return advice
    return replace(advice, level=Level.SLOW, speed_limit_m_s=limit_m_s)


class GovernedLink:
    """See ``hri_predict.contracts.link.Link``; all other members are those of the inner link."""

    def __init__(self, inner: Link, robots: Collection[int], limit: Limit) -> None:
        """Govern the link ``inner``, which sends advice to ``robots`` (indices)."""
        self.inner = inner
        self._robots, self._limit = frozenset(robots), limit

    def __getattr__(self, name: str) -> Any:
        return getattr(self.inner, name)

    @property
    def on_sent(self) -> Callable[[str, bytes, int], None] | None:
        """See ``Link``."""
        return self.inner.on_sent

    @on_sent.setter
    def on_sent(self, call: Callable[[str, bytes, int], None] | None) -> None:
        self.inner.on_sent = call

    def post(self, message: Message) -> None:
        """Post advice, with a lower limit if the test requires it; skip robots of other links."""
        if isinstance(message, Advice):
            if message.robot not in self._robots:
                return
            message = lowered(message, self._limit(message.robot))
        self.inner.post(message)

    def take(self) -> list[Received]:
        """Return received messages, without states of robots that belong to other controllers."""
        return [
            received
            for received in self.inner.take()
            if not isinstance(received.message, RobotState)
            or received.message.robot in self._robots
        ]
