"""Messages recorded around a moment, by topic."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field

from hri_predict.explaining.episodes import robot_of
from hri_predict.explaining.times import NS
from hri_predict.explaining.values import text
from hri_predict.recording import Told

TOPICS = (
    "/advice", "/status", "/scene", "/forecast", "/zones", "/node", "/clock", "/received",
    "/view/scene",
)  # fmt: skip
BEFORE_NS, AFTER_NS = 20 * NS, 10 * NS


@dataclass(slots=True)
class TimeWindow:
    """The messages of some seconds, in order; see ``TOPICS`` for their content.

    ``received`` has the times of controllers' messages by link.
    """

    advice: dict[str, list[Told]] = field(default_factory=dict)
    status: list[Told] = field(default_factory=list)
    scenes: list[Told] = field(default_factory=list)
    forecasts: list[Told] = field(default_factory=list)
    zones: list[Told] = field(default_factory=list)
    node: list[Told] = field(default_factory=list)
    clock: list[Told] = field(default_factory=list)
    views: list[Told] = field(default_factory=list)
    received: dict[str, list[int]] = field(default_factory=dict)

    @classmethod
    def of(cls, messages: Iterable[Told]) -> "TimeWindow":
        """Sort messages by topic."""
        window = cls()
        kept = {
            "/status": window.status,
            "/scene": window.scenes,
            "/forecast": window.forecasts,
            "/zones": window.zones,
            "/node": window.node,
            "/clock": window.clock,
            "/view/scene": window.views,
        }
        for told in messages:
            if told.topic in kept:
                kept[told.topic].append(told)
            elif told.topic == "/advice" or told.topic.startswith("/advice/"):
                window.advice.setdefault(robot_of(told.data), []).append(told)
            elif told.topic == "/received":
                link = text(told.data.get("link"))
                window.received.setdefault(link, []).append(told.utc_ns)
        return window


def newest(messages: list[Told], utc_ns: int, within_s: float = 2.0) -> Told | None:
    """Return the newest message at ``utc_ns`` that is not older than ``within_s``."""
    k = bisect_right(messages, utc_ns, key=lambda told: told.utc_ns)
    if not k or utc_ns - messages[k - 1].utc_ns > within_s * NS:
        return None
    return messages[k - 1]
