"""Changes of level in all cells, for the alerts of the fleet page."""

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from hri_predict.operation.monitoring.fleet import NO_SCHEMA, CellRow, Fleet
from hri_predict.operation.monitoring.fleet_levels import findings

KEPT = 512
"""Maximum number of changes kept for a page; a page that fetches them too late counts the missed
ones.
"""
JOINS_S = 2.0
"""Time without alerts after a cell joins or rejoins, since it sends all messages within a
second.
"""


class FleetChanges:
    """Numbers each change of a level as it is found. Any thread may call any method.

    Args:
        fleet: source of the cells' states.
        now_ns: the clock of ``fleet``.
        utc_s: wall clock, UTC.

    Attributes:
        newest: number of the newest change; 0 before the first.
    """

    def __init__(
        self,
        fleet: Fleet,
        now_ns: Callable[[], int] = time.monotonic_ns,
        utc_s: Callable[[], float] = time.time,
    ) -> None:
        self.newest = 0
        self._fleet = fleet
        self._now_ns, self._utc_s = now_ns, utc_s
        self._levels: dict[str, dict[int | None, str]] = {}
        self._joining_ns: dict[str, int] = {}
        self._kept: deque[dict[str, Any]] = deque(maxlen=KEPT)
        self._lock = threading.Lock()

    def look(self) -> list[CellRow]:
        """Record all changes up to now; return the rows of all cells."""
        with self._lock:
            now_ns = self._now_ns()
            rows = self._fleet.rows(now_ns)
            for row in rows:
                self._look_at(row, now_ns)
            return rows

    def look_at(self, site: str, cell: str) -> None:
        """Record the changes of a cell after its message, so that a short stop is not missed."""
        with self._lock:
            now_ns = self._now_ns()
            self._look_at(self._fleet.row(site, cell, now_ns), now_ns)

    def after(self, number: int) -> list[dict[str, Any]]:
        """Return the changes after this number, oldest first, as plain data."""
        with self._lock:
            return [change for change in self._kept if change["number"] > number]

    def _look_at(self, row: CellRow, now_ns: int) -> None:
        name = f"{row.site}/{row.cell}"
        if row.why == NO_SCHEMA or row.heard_s is None:
            since_ns = self._joining_ns.setdefault(name, now_ns)
            if now_ns - since_ns < JOINS_S * 1e9:
                return
        else:
            self._joining_ns.pop(name, None)
        before = self._levels.get(name)
        found = findings(row)
        for each in found:
            is_news = before is not None or each.level != "CLEAR"
            if is_news and (before or {}).get(each.robot) != each.level:
                robot = each.robot if len(row.robots) > 1 else None
                self._note(name, robot, each.level, each.reason)
        self._levels[name] = {each.robot: each.level for each in found}

    def _note(self, cell: str, robot: int | None, level: str, reason: str) -> None:
        self.newest += 1
        self._kept.append(
            {
                "number": self.newest,
                "utc_s": self._utc_s(),
                "cell": cell,
                "robot": robot,
                "level": level,
                "reason": reason,
            }
        )
