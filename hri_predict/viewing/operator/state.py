"""What the operator's page is told, of the newest picture and the history."""

import threading
import time
from typing import Any

from hri_predict.viewing.operator.history import History
from hri_predict.viewing.picture import Picture

SILENT_S = 1.0
"""No picture for so long: nothing is known of now."""


class State:
    """The newest facts, for any number of browsers. Threads wait for what is new.

    Attributes:
        history: of the alerts.
        ended: whether the node has ended.
    """

    def __init__(self) -> None:
        self.history = History()
        self.ended = False
        self._facts: dict[str, Any] = {}
        self._came_s = 0.0
        self._version = 0
        self._changed = threading.Condition()

    def take(self, picture: Picture, now_s: float) -> None:
        """Take the newest picture."""
        self.history.add(picture.facts.get("changes", []))
        with self._changed:
            self._facts, self._came_s = picture.facts, now_s
        self.tell()

    def end(self) -> None:
        """Tell everybody that the node has ended."""
        self.ended = True
        self.tell()

    def acknowledge(self, number: int) -> bool:
        """Mark an alert as read; return whether it is there."""
        found = self.history.acknowledge(number)
        self.tell()
        return found

    def tell(self) -> None:
        """Wake those who wait."""
        with self._changed:
            self._version += 1
            self._changed.notify_all()

    def wait(self, seen: int, timeout_s: float) -> int:
        """Wait until there is something newer than ``seen``, at most so long; return the newest."""
        with self._changed:
            self._changed.wait_for(lambda: self._version > seen, timeout_s)
            return self._version

    def told(self) -> dict[str, Any]:
        """What the page shows now: of a node that is silent no level, only since when."""
        with self._changed:
            facts, silent_s = self._facts, time.monotonic() - self._came_s
        known = bool(facts) and silent_s <= SILENT_S and not self.ended
        said: dict[str, Any] = {
            "known": known,
            "sent_ms": time.monotonic() * 1e3,
            "why": self._why(bool(facts), silent_s),
            "cell": facts["room"]["cell"] if facts else "",
            "robots": [robot["name"] for robot in facts.get("robots", [])],
            "history": self.history.rows(),
            "missed": self.history.missed,
        }
        if known:
            tracked = facts["tracked"]
            said |= {
                "levels": [_robot(robot) for robot in facts["robots"]],
                "state": facts["state"].lower(),
                "people": tracked,
                "lost": len(facts["people"]) - tracked,
                "age_s": facts["age_s"],
            }
        return said

    def _why(self, any_facts: bool, silent_s: float) -> str:
        if self.ended:
            return "the node has ended"
        if not any_facts:
            return "waiting for the node"
        return f"nothing from the node for {silent_s:.0f} s" if silent_s > SILENT_S else ""


def _robot(robot: dict[str, Any]) -> dict[str, Any]:
    kept = ("name", "level", "reason", "clears", "latch", "limit_m_s", "separation_m")
    return {name: robot[name] for name in kept}
