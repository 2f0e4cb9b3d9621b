"""When the loop ticks: at a fixed rate, or as soon as a capture is in.

Both kinds serve the loop in real time and the virtual clock. Only ``wait`` knows that time passes.
"""

import threading
from dataclasses import dataclass
from typing import Protocol

from hri_predict.base.clock import Clock
from hri_predict.node.publish_phase import PublishPhase
from hri_predict.risk.delay_budget import ENCODING_FRACTION
from hri_predict.run.rates import RateSettings

LEAVE_NS = 1_000_000
"""Pause of the loop after a tick, if a capture waits: the links' threads send the advice."""


@dataclass(frozen=True, slots=True)
class Ended:
    """End of a tick.

    Attributes:
        used: part of its time that the tick used; above 1 it was late.
        missed: ticks that were due meanwhile and are left out.
    """

    used: float
    missed: int = 0

    @property
    def is_late(self) -> bool:
        """Whether the tick held up the next."""
        return self.used > 1.0


class Ticks(Protocol):
    """The order of calls: ``wait`` until ``due_ns``, ``begin``, the tick, ``end``.

    Attributes:
        due_ns: when the next tick is due (node's clock); in the past: now.
    """

    @property
    def due_ns(self) -> int: ...  # noqa: D102

    def captured(self) -> None:
        """A scene is in; any thread may say so."""

    def wait(self, clock: Clock, stop: threading.Event) -> None:
        """Return at ``due_ns``, or sooner: at ``stop``, or because ``due_ns`` is sooner now."""

    def begin(self, now_ns: int) -> None:
        """Begin a tick at ``now_ns``. Scenes that come from now on may not be in it."""

    def end(self, now_ns: int) -> Ended:
        """End it; only in real time."""


class FixedTicks:
    """Ticks at absolute deadlines: a late one does not push back the others. See ``Ticks``."""

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
        """Set the next deadline, whenever this tick begins."""
        self._deadline_ns = self.due_ns
        self.due_ns += self._period_ns

    def end(self, now_ns: int) -> Ended:
        """Leave out whole cycles that have passed; keep the phase."""
        missed = max(0, (now_ns - self.due_ns) // self._period_ns)
        self.due_ns += missed * self._period_ns
        return Ended((now_ns - self._deadline_ns) / self._period_ns, missed)


class CaptureTicks:
    """A tick as soon as a capture is in; without captures, one each period. See ``Ticks``.

    Captures that come during a tick, or within ``gap_ns`` after its start, give one tick together.

    Args:
        start_ns: of the first tick.
        period_ns: the longest time from the start of a tick until the next is due.
        gap_ns: the shortest.
        room_ns: a tick that takes longer is late.
    """

    def __init__(self, start_ns: int, *, period_ns: int, gap_ns: int, room_ns: int) -> None:
        self._period_ns, self._gap_ns, self._room_ns = period_ns, gap_ns, room_ns
        self._began_ns = start_ns
        self._floor_ns = self._open_ns = start_ns
        self._captured = threading.Event()
        self._waits = False  # a capture

    @property
    def due_ns(self) -> int:
        """When the next tick is due."""
        return self._open_ns if self._waits else self._floor_ns

    def captured(self) -> None:
        """Let the next tick come as soon as it may."""
        self._waits = True  # first, so that whoever wakes sees it
        self._captured.set()

    def wait(self, clock: Clock, stop: threading.Event) -> None:
        """Return at ``due_ns`` or when a capture is in; a stop is noticed within one period."""
        clock.wait_until(self.due_ns, self._captured)
        self._captured.clear()

    def begin(self, now_ns: int) -> None:
        """Count the periods from now on."""
        self._waits = False
        self._began_ns = now_ns
        self._floor_ns = now_ns + self._period_ns
        self._open_ns = now_ns + self._gap_ns

    def end(self, now_ns: int) -> Ended:
        """Say how long it took."""
        self._open_ns = max(self._open_ns, now_ns + LEAVE_NS)
        return Ended((now_ns - self._began_ns) / self._room_ns)


def ticks_of(settings: RateSettings, source_rate_hz: float, start_ns: int) -> Ticks:
    """Return the configured kind of ticks; the first is due at ``start_ns``.

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
