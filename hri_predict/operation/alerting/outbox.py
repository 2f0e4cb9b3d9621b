"""Which alert goes out next, and when: debounce, rate limit, retry, and the count of each.

Per robot and zone at most one alert waits, the newest: so the memory is bounded, and a receiver
that hears from us late hears what holds now. What was left out is reported with the next alert.
"""

from collections import deque
from dataclasses import dataclass

from hri_predict.operation.alerting.alert import AnyAlert
from hri_predict.operation.alerting.settings import HookSettings

BACK_OFF_S, LONGEST_BACK_OFF_S = 1.0, 30.0
LONGEST_ASKED_S = 300.0
"""Longest pause that a receiver may ask for (``Retry-After``): it must not switch alerts off."""


@dataclass(slots=True, kw_only=True)
class Entry:
    """An alert that waits, or is on its way.

    Attributes:
        alert: the alert to send.
        more_changes: changes that were left out, to be reported with it.
        first_try_s: when it was first tried; ``None`` before.
    """

    alert: AnyAlert
    more_changes: int = 0
    first_try_s: float | None = None


class Outbox:
    """The waiting alerts of one hook. All times are seconds of one clock that only rises.

    Attributes:
        delivered: alerts that arrived, as far as is known.
        left_out: changes that a newer one of the same robot or zone replaced, here or before they
            came here.
        dropped: alerts that were given up.
        retried: further attempts.
        failures: attempts that failed.
    """

    def __init__(self, settings: HookSettings) -> None:
        self._settings = settings
        self._waiting: dict[str, Entry] = {}
        self._last: dict[str, float] = {}  # subject -> time of its last first attempt
        self._minute: deque[float] = deque()  # times of the first attempts within a minute
        self._failed_in_a_row = 0
        self._retry_at_s = 0.0
        self._untold = 0
        self.delivered = self.left_out = self.dropped = self.retried = self.failures = 0

    def put(self, alert: AnyAlert) -> bool:
        """Take an alert, instead of an older one of the same subject.

        Returns:
            Whether ``wait_s`` may be shorter than before.
        """
        if not self._settings.wants(alert):
            return False
        self.left_out += alert.held_back
        self._untold += alert.held_back
        replaced = alert.subject in self._waiting
        if replaced:
            self._leave_out()
        self._waiting[alert.subject] = Entry(alert=alert)
        return not replaced

    def next(self, now_s: float, *, hurry: bool = False) -> Entry | None:
        """Take out the alert to try now, if there is one; in a ``hurry`` nothing has to wait."""
        for subject, entry in self._waiting.items():
            if hurry or self._due_s(subject, entry, now_s) <= now_s:
                del self._waiting[subject]
                if entry.first_try_s is None:
                    entry.first_try_s = self._last[subject] = now_s
                    self._minute.append(now_s)
                else:
                    self.retried += 1
                entry.more_changes = self._untold
                return entry
        return None

    def wait_s(self, now_s: float) -> float | None:
        """Time until the next alert is due; ``None`` if none waits."""
        due = [self._due_s(subject, entry, now_s) for subject, entry in self._waiting.items()]
        return max(min(due) - now_s, 0.0) if due else None

    def arrived(self, entry: Entry) -> None:
        """Count an alert as delivered."""
        self.delivered += 1
        self._untold -= entry.more_changes
        self._failed_in_a_row, self._retry_at_s = 0, 0.0

    def failed(
        self, entry: Entry, now_s: float, *, again: bool, again_s: float | None = None
    ) -> None:
        """Count a failed attempt; keep the alert unless it is too old or not to be tried ``again``.

        The next attempt, of any alert, waits: longer after each failure, and as long as the
        receiver asks (``again_s``).
        """
        self.failures += 1
        pause = min(BACK_OFF_S * 2.0**self._failed_in_a_row, LONGEST_BACK_OFF_S)
        pause = max(pause, min(again_s or 0.0, LONGEST_ASKED_S))
        self._failed_in_a_row = min(self._failed_in_a_row + 1, 10)
        assert entry.first_try_s is not None
        newer = entry.alert.subject in self._waiting
        if newer:
            self._leave_out()
        elif not again or now_s + pause > entry.first_try_s + self._settings.retry_s:
            self.dropped += 1
            self._untold += 1
        else:
            self._waiting[entry.alert.subject] = entry
        if again:  # what the receiver refused for good says nothing about the next alert
            self._retry_at_s = now_s + pause

    def give_up(self, under_way: int) -> None:
        """Drop what waits, and what is ``under_way``: the node ends."""
        self.dropped += len(self._waiting) + under_way
        self._waiting.clear()

    def _due_s(self, subject: str, entry: Entry, now_s: float) -> float:
        due = self._retry_at_s
        if entry.first_try_s is None:
            last = self._last.get(subject)
            if last is not None:
                due = max(due, last + self._settings.debounce_s)
            due = max(due, self._rate_s(now_s))
        return due

    def _rate_s(self, now_s: float) -> float:
        """From when on the rate allows one more."""
        while self._minute and self._minute[0] <= now_s - 60.0:
            self._minute.popleft()
        over = len(self._minute) - self._settings.rate_per_minute
        return self._minute[over] + 60.0 if over >= 0 else 0.0

    def _leave_out(self) -> None:
        self.left_out += 1
        self._untold += 1
