"""UTC of times on the node's clock; the node itself never reads the wall clock.

The node's clock stops while the machine is suspended, and is not affected when the wall clock is
set. A recording holds both, and their offset once a second.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Protocol

from hri_predict.base.clock import Clock

STEP_NS = 1_000_000_000
"""A larger change of the wall clock against the node's clock means that it was set or that the
machine was suspended; a smaller one is drift."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Three clocks read at one moment, nanoseconds.

    Attributes:
        node_ns: the node's clock.
        utc_ns: since 1970, UTC.
        boot_ns: since the machine's start, with the time that it was suspended.
    """

    node_ns: int
    utc_ns: int
    boot_ns: int

    @property
    def offset_ns(self) -> int:
        """Offset to add to a time of the node for UTC."""
        return self.utc_ns - self.node_ns

    def moved_ns(self, before: "Reading") -> int:
        """Return the change of the wall clock against the node's since ``before``."""
        return self.offset_ns - before.offset_ns

    def to_dict(self, before: "Reading | None") -> dict[str, Any]:
        """As a message on /clock; ``before`` is the reading of the message before it."""
        last = before or self
        suspended_ns = (self.boot_ns - self.node_ns) - (last.boot_ns - last.node_ns)
        return {
            "now_ns": self.node_ns,
            "utc": iso(self.utc_ns),
            "utc_ns": self.utc_ns,
            "boot_ns": self.boot_ns,
            "utc_moved_s": round(self.moved_ns(last) * 1e-9, 6),
            "suspended_s": round(suspended_ns * 1e-9, 6),
        }


class Clocks(Protocol):
    """Source of clock readings."""

    name: str
    """``system``, or ``virtual`` if UTC is only a name for the node's time."""

    def read(self, node_ns: int) -> Reading:
        """Read now; ``node_ns`` is the time of the newest item."""


class VirtualClocks:
    """The node's clock alone: two virtual runs give the same bytes, and start in 1970.

    Args:
        start_ns: when the recording begins.
        offset_ns: Offset of UTC, where it is known, as of a part of a recording.
    """

    def __init__(self, start_ns: int = 0, offset_ns: int | None = None) -> None:
        self._start_ns, self._offset_ns = start_ns, offset_ns or 0
        self.name = "virtual" if offset_ns is None else "system"

    def read(self, node_ns: int) -> Reading:
        """Return the item's time for all three clocks."""
        at_ns = max(node_ns, self._start_ns)
        return Reading(node_ns=at_ns, utc_ns=at_ns + self._offset_ns, boot_ns=at_ns)


class SystemClocks:
    """The machine's clocks besides the node's.

    Args:
        clock: the node's.
        is_true: its seconds are real. Otherwise (``--speed 2``) UTC counts the node's seconds from
            the first reading.
        utc_ns, boot_ns: the machine's clocks.
    """

    name = "system"

    def __init__(
        self,
        clock: Clock,
        *,
        is_true: bool = True,
        utc_ns: Callable[[], int] = time.time_ns,
        boot_ns: Callable[[], int] | None = None,
    ) -> None:
        self._clock, self._is_true = clock, is_true
        self._utc_ns, self._boot_ns = utc_ns, boot_ns or _since_boot_ns
        self._first: Reading | None = None

    def read(self, node_ns: int) -> Reading:
        """Read the three clocks together; the item's time is not needed."""
        now_ns, utc_ns, boot_ns = self._clock.now_ns(), self._utc_ns(), self._boot_ns()
        if self._first is None:
            self._first = Reading(node_ns=now_ns, utc_ns=utc_ns, boot_ns=boot_ns)
        if not self._is_true:
            since_ns = now_ns - self._first.node_ns
            utc_ns, boot_ns = self._first.utc_ns + since_ns, self._first.boot_ns + since_ns
        return Reading(node_ns=now_ns, utc_ns=utc_ns, boot_ns=boot_ns)


def iso(utc_ns: int) -> str:
    """``2026-03-09T14:03:07.123456Z``."""
    seconds, rest = divmod(utc_ns, 1_000_000_000)
    at = datetime.fromtimestamp(seconds, UTC)
    return f"{at:%Y-%m-%dT%H:%M:%S}.{rest // 1000:06d}Z"


def _since_boot_ns() -> int:
    boottime = getattr(time, "CLOCK_BOOTTIME", None)  # Linux alone has it
    return time.monotonic_ns() if boottime is None else time.clock_gettime_ns(boottime)
