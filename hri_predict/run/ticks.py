"""Timing of the loop's ticks: at a fixed rate, or as soon as a capture arrives.

Both kinds work in real time and on the virtual clock. Only ``wait`` depends on the passing of time.
"""

import threading
from dataclasses import dataclass
from typing import Protocol

from hri_predict.base.clock import Clock
from hri_predict.node.publish_phase import PublishPhase
from hri_predict.risk.delay_budget import ENCODING_FRACTION
from hri_predict.run.rates import RateSettings

LEAVE_NS = 1_000_000
"""Pause of the loop after a tick if a capture is waiting, so that the links' threads can send the
advice.
"""


@dataclass(frozen=True, slots=True)
class Ended:
    """End of a tick.

    Attributes:
        used: share of its available time that the tick took; above 1 it was late.
        missed: number of ticks that became due since the one before and are skipped.
    """

    used: float
    missed: int = 0

    @property
    def is_late(self) -> bool:
        """Whether the tick delayed the next one."""
        return self.used > 1.0


class Ticks(Protocol):
    """Order of calls: ``wait`` until ``due_ns``, ``begin``, the tick, ``end``.

    Attributes:
        due_ns: time at which the next tick is due (node's clock); a past time means now.
    """

    @property
    def due_ns(self) -> int: ...  # noqa: D102

    def captured(self) -> None:
        """Signal that a scene has arrived; may be called from any thread."""

    def wait(self, clock: Clock, stop: threading.Event) -> None:
        """Return at ``due_ns``, or sooner if ``stop`` is set or ``due_ns`` becomes earlier."""

    def begin(self, now_ns: int) -> None:
        """Start a tick at ``now_ns``. Scenes arriving after this call may miss it."""

    def end(self, now_ns: int) -> Ended:
        """End the tick; only called in real time."""


class FixedTicks:
    """Ticks at absolute deadlines: a late tick does not delay later ones. See ``Ticks``."""

    def __init__(self, start_ns: int, period_ns: int) -> None:
        self._period_ns = period_ns
        self._deadline_ns = start_ns - period_ns  # of the newest tick
        self.due_ns = start_ns

    def captured(self) -> None:
        """Change nothing."""

    def wait(self, clock: Clock, stop: threading.Event) -> None:
        """Return at ``due_ns`` or at ``stop``."""
        clock.wait_until(self.due_ns, stop)

    def begin(self, now_ns: int) -> None:
        """Set the next deadline, independent of the start time of this tick."""
        self._deadline_ns = self.due_ns
        self.due_ns += self._period_ns

    def end(self, now_ns: int) -> Ended:
        """Skip whole cycles that have passed; keep the phase."""
        missed = max(0, (now_ns - self.due_ns) // self._period_ns)
        self.due_ns += missed * self._period_ns
        return Ended((now_ns - self._deadline_ns) / self._period_ns, missed)


class CaptureTicks:
    """Ticks as soon as a capture arrives; without captures, once per period.

    See ``Ticks``. Captures arriving during a tick, or within ``gap_ns`` after its start, are
    handled in one common tick.

    Args:
        start_ns: time of the first tick.
        period_ns: maximum time from the start of a tick until the next is due.
        gap_ns: minimum time between them.
        room_ns: duration above which a tick is late.
    """

    def __init__(self, start_ns: int, *, period_ns: int, gap_ns: int, room_ns: int) -> None:
        self._period_ns, self._gap_ns, self._room_ns = period_ns, gap_ns, room_ns
        self._began_ns = start_ns
        self._floor_ns = self._open_ns = start_ns
        self._missed = 0  # cycles that passed before the newest tick began
        self._captured = threading.Event()
        self._waits = False  # a capture

    @property
    def due_ns(self) -> int:
        """Time at which the next tick is due."""
        return self._open_ns if self._waits else self._floor_ns

    def captured(self) -> None:
        """Make the next tick due as soon as permitted."""
        self._waits = True  # first, so that whoever wakes sees it
        self._captured.set()

    def wait(self, clock: Clock, stop: threading.Event) -> None:
        """Return at ``due_ns`` or when a capture arrives; a stop is detected within one period."""
        clock.wait_until(self.due_ns, self._captured)
        self._captured.clear()

    def begin(self, now_ns: int) -> None:
        """Start the period now."""
        self._waits = False
        self._missed = max(0, (now_ns - self._floor_ns) // self._period_ns)
        self._began_ns = now_ns
        self._floor_ns = now_ns + self._period_ns
        self._open_ns = now_ns + self._gap_ns

    def end(self, now_ns: int) -> Ended:
        """Report the tick's duration, and the whole cycles that passed before it began."""
        self._open_ns = max(self._open_ns, now_ns + LEAVE_NS)
        return Ended((now_ns - self._began_ns) / self._room_ns, self._missed)


def ticks_of(settings: RateSettings, source_rate_hz: float, start_ns: int) -> Ticks:
    """Return the configured kind of ticks; the first tick is due at ``start_ns``.

    ``source_rate_hz``: nominal scenes per second.
    """
    period_ns = round(1e9 / settings.rate_hz)
    if settings.ticks == "fixed":
        return FixedTicks(start_ns, period_ns)
    gap_ns = round(1e9 / settings.largest_rate_hz)
    room_ns = max(gap_ns, min(period_ns, round(1e9 / source_rate_hz)))
    return CaptureTicks(start_ns, period_ns=period_ns, gap_ns=gap_ns, room_ns=room_ns)


def phase_of(settings: RateSettings, clock: Clock) -> PublishPhase | None:
    """Return the part that delays a tick's messages to a fixed time; ``None``: nothing does."""
    if settings.ticks != "fixed" or settings.publish_phase_s == 0.0:
        return None
    longest_s = ENCODING_FRACTION / settings.rate_hz
    return PublishPhase(clock, settings.publish_phase_s, longest_s, settings.rate_hz)
