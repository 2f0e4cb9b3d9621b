"""Decides which changes to report immediately while a robot's level or a zone alternates.

A sensor at its limit can make a level alternate several times a second. Each change is still sent
to the controllers and written to the alert file; an operator needs only the fact, the number of
changes, and the most severe level.
"""

from collections import deque
from collections.abc import Iterator
from dataclasses import replace

from hri_predict.operation.alerting.alert import Alert, ZoneAlert
from hri_predict.protocol.messages import Level

WINDOW_S = 15.0
REPEATS = 3
"""Number of changes to the same state within ``WINDOW_S`` from which on a change is a
repetition.
"""
HOLDS_S = 5.0
"""A repetition is reported when its state has held for this long,"""
FIRST_S, AGAIN_S = 10.0, 60.0
"""or at the latest after the first of these times, then at the second interval while changes
continue.
"""
_ZONES = {"empty": 0, "entry predicted": 1, "occupied": 2}

Change = Alert | ZoneAlert


class _Subject:
    """One robot or zone.

    Attributes:
        came: times of the newest changes, by state.
        reported: urgency of the last report; the state is never more severe than this.
        held: newest change, if its report is delayed.
        held_back: number of unreported changes since the last report.
    """

    def __init__(self) -> None:
        self.came: dict[tuple[str, str], deque[float]] = {}
        self.reported = -1
        self.held: Change | None = None
        self.held_back = 0
        self.reported_s = 0.0
        self.patience_s = FIRST_S


class Flapping:
    """Reports a change immediately unless it is a repetition and no more severe than the last
    report.
    """

    def __init__(self) -> None:
        self._subjects: dict[str, _Subject] = {}

    def take(self, change: Change) -> Change | None:
        """Return the change to report now; ``None`` if its report is delayed."""
        subject = self._subjects.setdefault(change.subject, _Subject())
        came = subject.came.setdefault(_state(change), deque(maxlen=REPEATS))
        repeats = len(came) == REPEATS and came[0] > change.time_s - WINDOW_S
        came.append(change.time_s)
        if not repeats or _urgency(change) > subject.reported:
            if not repeats and subject.held is None:
                subject.patience_s = FIRST_S
            return self._report(subject, change, change.time_s)
        subject.held = change
        subject.held_back += 1
        return None

    def due(self, now_s: float) -> Iterator[Change]:
        """Return the delayed changes that are now due."""
        for subject in self._subjects.values():
            held = subject.held
            if held is None:
                continue
            if now_s >= held.time_s + HOLDS_S:
                subject.patience_s = FIRST_S
            elif now_s >= subject.reported_s + subject.patience_s:
                subject.patience_s = AGAIN_S
            else:
                continue
            yield self._report(subject, held, now_s)

    def rest(self) -> Iterator[Change]:
        """Return all delayed changes."""
        for subject in self._subjects.values():
            if subject.held is not None:
                yield self._report(subject, subject.held, subject.held.time_s)

    def _report(self, subject: _Subject, change: Change, now_s: float) -> Change:
        others = subject.held_back - (change is subject.held)
        subject.held, subject.held_back = None, 0
        subject.reported, subject.reported_s = _urgency(change), now_s
        return replace(change, held_back=others) if others else change


def _state(change: Change) -> tuple[str, str]:
    if isinstance(change, ZoneAlert):
        return change.state, ""
    return change.level, change.reason


def _urgency(change: Change) -> int:
    if isinstance(change, ZoneAlert):
        return _ZONES.get(change.state, 0)
    return Level.__members__.get(change.level.upper(), Level.UNKNOWN).urgency
