"""The alerts that a page shows, and who has read them."""

import threading
from collections import OrderedDict
from collections.abc import Sequence
from typing import Any

KEPT = 200
QUIET = ("CLEAR",)
"""Changes to these levels end an alert and are none."""


class History:
    """The newest changes of level, each once, with whether somebody has read it.

    Reading an alert changes nothing for the robot. A latched stop is acknowledged at the cell.

    Attributes:
        missed: changes that never arrived, because pictures were dropped for too long.
    """

    def __init__(self) -> None:
        self.missed = 0
        self._newest = 0
        self._rows: OrderedDict[int, dict[str, Any]] = OrderedDict()
        self._lock = threading.Lock()

    def add(self, changes: Sequence[dict[str, Any]]) -> None:
        """Take the changes of a picture, oldest first; those already known are left out."""
        with self._lock:
            for change in changes:
                number = change["number"]
                if number <= self._newest:
                    continue
                if self._newest:
                    self.missed += number - self._newest - 1
                self._newest = number
                self._rows[number] = {**change, "read": change["level"] in QUIET}
            while len(self._rows) > KEPT:
                self._rows.popitem(last=False)

    def acknowledge(self, number: int) -> bool:
        """Mark an alert as read; return whether it is there."""
        with self._lock:
            row = self._rows.get(number)
            if row is not None:
                row["read"] = True
            return row is not None

    def rows(self) -> list[dict[str, Any]]:
        """All that is kept, newest first."""
        with self._lock:
            return [dict(row) for row in reversed(self._rows.values())]
