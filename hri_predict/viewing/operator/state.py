"""Data for an operator's page, from the newest picture and the history."""

import threading
import time
from collections import Counter, OrderedDict
from collections.abc import Sequence
from typing import Any

from hri_predict.viewing.picture import Picture

# -- the alerts that a page shows, and who has read them -------------------------------------------

KEPT = 200
QUIET = ("CLEAR",)
"""Changes to these levels end an alert and are not alerts themselves."""


class History:
    """The newest changes of level, each once, and whether it was read.

    Reading an alert changes nothing for the robot. A latched stop is acknowledged at the cell.

    Attributes:
        missed: number of changes that never arrived, because pictures were dropped for too long.
        forgotten: number of unread alerts displaced by newer ones.
        version: increases with each change of the history.
    """

    def __init__(self) -> None:
        self.missed, self.forgotten, self.version = 0, 0, 0
        self._newest = 0
        self._rows: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, changes: Sequence[dict[str, Any]]) -> None:
        """Add the changes of a picture, oldest first; known ones are skipped."""
        with self._lock:
            for change in changes:
                number = change["number"]
                if number <= self._newest:
                    continue
                if self._newest:
                    self.missed += number - self._newest - 1
                self._newest = number
                self.version += 1
                self._rows[number] = {**change, "read": change["level"] in QUIET}
                if len(self._rows) > KEPT:
                    self._forget_one()

    def _forget_one(self) -> None:
        """Drop the oldest alert of the cell with most: a flapping cell must not displace others."""
        most = Counter(row.get("cell") for row in self._rows.values()).most_common(1)[0][0]
        number = next(n for n, row in self._rows.items() if row.get("cell") == most)
        self.forgotten += not self._rows.pop(number)["read"]

    def acknowledge(self, number: int, with_older: bool = False) -> bool:
        """Mark an alert, or all up to it, as read; return whether there is any."""
        with self._lock:
            if with_older:
                found = [row for n, row in self._rows.items() if n <= number]
            else:
                found = [self._rows[number]] if number in self._rows else []
            for row in found:
                row["read"] = True
            self.version += len(found)
            return bool(found)

    def rows(self) -> list[dict[str, Any]]:
        """Return the whole history, newest first."""
        with self._lock:
            return [dict(row) for row in reversed(self._rows.values())]


# --------------------------------------------------------------------------------------------------

SILENT_S = 1.0
"""Maximum age of a picture; after that the current state is unknown."""


class State:
    """The newest facts, for any number of browsers. Threads wait for updates.

    Attributes:
        history: history of the alerts.
        ended: whether the pictures have ended.
        who: name of the sender of the pictures.
        told_s: minimum interval between updates to browsers, unless there is an alert.
    """

    who = "the node"
    told_s = 0.2

    def __init__(self) -> None:
        self.history = History()
        self.ended = False
        self._facts: dict[str, Any] = {}
        self._came_s = 0.0
        self._version = 0
        self._changed = threading.Condition()

    def take(self, picture: Picture, now_s: float) -> None:
        """Store the newest picture at ``now_s``; time spent in the pipe counts towards its age."""
        self.history.add(picture.facts.get("changes", []))
        with self._changed:
            self._facts = picture.facts
            self._came_s = min(now_s, picture.facts.get("made_s", now_s))
        self.tell()

    def end(self) -> None:
        """Notify all browsers that no more pictures will arrive."""
        self.ended = True
        self.tell()

    def acknowledge(self, number: int, with_older: bool = False) -> bool:
        """Mark an alert, or all up to it, as read; return whether there is any."""
        found = self.history.acknowledge(number, with_older)
        self.tell()
        return found

    def tell(self) -> None:
        """Wake waiting threads."""
        with self._changed:
            self._version += 1
            self._changed.notify_all()

    def wait(self, seen: int, timeout_s: float) -> int:
        """Wait at most this long for a version newer than ``seen``; return the newest."""
        with self._changed:
            self._changed.wait_for(lambda: self._version > seen, timeout_s)
            return self._version

    def wait_for_alerts(self, seen: int, timeout_s: float) -> None:
        """Wait at most this long until the history's version differs from ``seen``."""
        with self._changed:
            self._changed.wait_for(lambda: self.history.version != seen or self.ended, timeout_s)

    def told(self, alerts: int = -1) -> dict[str, Any]:
        """Return the page's current content; for a silent node, the time of silence without a
        level.

        Args:
            alerts: the version of the history that the page has; the history is left out unless
                it is newer.
        """
        with self._changed:
            facts, silent_s = self._facts, time.monotonic() - self._came_s
        known = bool(facts) and silent_s <= SILENT_S and not self.ended
        said: dict[str, Any] = {
            "known": known,
            "sent_ms": time.monotonic() * 1e3,
            "why": self._why(bool(facts), silent_s),
            "alerts": self.history.version,
            **self._always(facts, silent_s),
        }
        if said["alerts"] != alerts:
            said |= {
                "history": self.history.rows(),
                "missed": self.history.missed,
                "forgotten": self.history.forgotten,
            }
        return said | (self._now(facts, silent_s) if known else {})

    def _always(self, facts: dict[str, Any], silent_s: float) -> dict[str, Any]:
        """Return the data sent even while the state is unknown: names, and the picture's age."""
        return {
            "silent_s": silent_s if facts else None,
            "cell": facts["room"]["cell"] if facts else "",
            "robots": [robot["name"] for robot in facts.get("robots", [])],
        }

    def _now(self, facts: dict[str, Any], since_s: float) -> dict[str, Any]:
        """Return the state shown while the picture, made ``since_s`` ago, is current."""
        tracked = facts["tracked"]
        return {
            "levels": [_robot(robot) for robot in facts["robots"]],
            "state": facts["state"].lower(),
            "reasons": facts["reasons"],
            "people": tracked,
            "lost": len(facts["people"]) - tracked,
            "age_s": facts["age_s"],
        }

    def _why(self, any_facts: bool, silent_s: float) -> str:
        if self.ended:
            return f"{self.who} has ended"
        if not any_facts:
            return f"waiting for {self.who}"
        return f"nothing from {self.who} for {silent_s:.0f} s" if silent_s > SILENT_S else ""


def _robot(robot: dict[str, Any]) -> dict[str, Any]:
    kept = ("name", "level", "reason", "near", "clears", "latch", "limit_m_s", "separation_m")
    return {name: robot[name] for name in kept}
