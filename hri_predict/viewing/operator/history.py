"""The alerts that a page shows, and who has read them."""

import threading
from collections import Counter, OrderedDict
from collections.abc import Sequence
from typing import Any

KEPT = 200
QUIET = ("CLEAR",)
"""Changes to these levels end an alert and are none."""


class History:
    """The newest changes of level, each once, with whether it was read.

    Reading an alert changes nothing for the robot. A latched stop is acknowledged at the cell.

    Attributes:
        missed: changes that never arrived, because pictures were dropped for too long.
        forgotten: unread alerts that newer ones pushed out.
        version: rises with each change of what is kept.
    """

    def __init__(self) -> None:
        self.missed, self.forgotten, self.version = 0, 0, 0
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
                self.version += 1
                self._rows[number] = {**change, "read": change["level"] in QUIET}
                if len(self._rows) > KEPT:
                    self._forget_one()

    def _forget_one(self) -> None:
        """Forget the oldest of the cell with most: one that flaps must not push out the others'."""
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
        """All that is kept, newest first."""
        with self._lock:
            return [dict(row) for row in reversed(self._rows.values())]
