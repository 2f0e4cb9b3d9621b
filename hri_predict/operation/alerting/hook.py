"""A running hook: each has its own thread, so a slow receiver delays nothing else."""

import logging
import threading
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from hri_predict.base.clock import Clock, MonotonicClock
from hri_predict.base.errors import failure
from hri_predict.operation.alerting.alert import AnyAlert, one_line
from hri_predict.operation.alerting.sender import Sender, SendError, said
from hri_predict.operation.alerting.settings import HookSettings

BACK_OFF_S, LONGEST_BACK_OFF_S = 1.0, 30.0
LONGEST_ASKED_S = 300.0
"""Longest pause that a receiver may request (``Retry-After``), so that it cannot switch alerts
off.
"""


@dataclass(slots=True, kw_only=True)
class Entry:
    """An alert that is waiting or being sent.

    Attributes:
        alert: the alert to send.
        more_changes: number of changes left out, reported with this alert.
        first_try_s: time of the first attempt; ``None`` before it.
    """

    alert: AnyAlert
    more_changes: int = 0
    first_try_s: float | None = None


class Outbox:
    """The waiting alerts of one hook. All times are seconds of one monotonic clock.

    Debounce, rate limit, retry and counters. At most one alert waits per robot and zone, the
    newest, so memory is bounded and a delayed alert is still current. The next alert gives the
    number of changes left out.

    Attributes:
        delivered: alerts that are known to have arrived.
        left_out: changes replaced by a newer one of the same robot or zone, here or earlier.
        dropped: alerts that were abandoned.
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
        """Queue an alert; it replaces an older one of the same subject.

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
        """Remove and return the alert to try now, if any; with ``hurry`` no alert has to wait."""
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
        """Count a failed attempt; keep the alert unless it is too old or ``again`` is false.

        The next attempt, for any alert, waits longer after each failure, and at least as long as
        the receiver requests (``again_s``).
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
        """Drop the waiting alerts, and the one ``under_way``, because the node is stopping."""
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
        """Earliest time at which the rate limit allows another alert."""
        while self._minute and self._minute[0] <= now_s - 60.0:
            self._minute.popleft()
        over = len(self._minute) - self._settings.rate_per_minute
        return self._minute[over] + 60.0 if over >= 0 else 0.0

    def _leave_out(self) -> None:
        self.left_out += 1
        self._untold += 1


log = logging.getLogger(__name__)

TELL_EVERY_S = 60.0
"""Minimum time between two log lines of one hook."""


class Hook:
    """Queues alerts without waiting; its thread delivers them."""

    def __init__(self, settings: HookSettings, sender: Sender, clock: Clock | None = None) -> None:
        self.settings = settings
        self._sender = sender
        self._clock = clock or MonotonicClock()
        self._outbox = Outbox(settings)
        self._changed = threading.Condition()
        self._stopping = self._abandoned = self._under_way = False
        self._told_s: float | None = None
        self._untold_failures = 0
        self.last_error = ""
        self._thread = threading.Thread(target=self._work, name="alert hook", daemon=True)

    def start(self) -> None:
        """Start the thread unless it is already running."""
        if self._thread.ident is None:
            self._thread.start()

    def put(self, alert: AnyAlert) -> None:
        """Queue an alert; the newest of each robot and zone wins. Never waits for the receiver."""
        with self._changed:
            if self._outbox.put(alert):  # else the thread wakes in time by itself
                self._changed.notify()

    def stop(self) -> None:
        """Ask the thread to try each queued alert once more and to stop; does not wait."""
        with self._changed:
            self._stopping = True
            self._changed.notify()

    def join(self, timeout_s: float) -> None:
        """Wait for the thread to stop, no longer than this; alerts not sent by then are lost.

        Safe to call twice.
        """
        if self._thread.ident is not None:
            self._thread.join(timeout_s)
        with self._changed:
            if not self._abandoned:
                self._outbox.give_up(int(self._under_way))
            self._abandoned = True
        self._sender.abort()

    @property
    def failures(self) -> int:
        """Number of failed attempts."""
        return self._outbox.failures

    def report(self) -> dict[str, Any]:
        """The hook's row in the summary."""
        with self._changed:
            box = self._outbox
            return {
                "name": self.settings.label,
                "delivered": box.delivered,
                "left_out": box.left_out,
                "dropped": box.dropped,
                "retried": box.retried,
                "failures": box.failures,
                "last_error": self.last_error,
            }

    def _work(self) -> None:
        self._tend()
        while not self._abandoned:
            with self._changed:
                entry = self._next()
                stopping = self._stopping
            if entry is not None:
                self._deliver(entry)
            elif stopping:
                break
            else:
                self._tend()
        try:
            self._sender.close()
        except BaseException as error:
            self._failed(failure(error))

    def _next(self) -> Entry | None:
        """Wait for an alert that is due, and return it; ``None`` if the connection needs attention
        or the hook is to stop.
        """
        entry = self._outbox.next(self._now_s(), hurry=self._stopping)
        if entry is None and not self._stopping:
            limits = (self._outbox.wait_s(self._now_s()), self._sender.tend_s)
            self._changed.wait(min((s for s in limits if s is not None), default=None))
            entry = self._outbox.next(self._now_s(), hurry=self._stopping)
        self._under_way = entry is not None
        return entry

    def _deliver(self, entry: Entry) -> None:
        error: Exception | None = None
        try:
            self._sender.send(entry.alert, entry.more_changes)
        except BaseException as raised:  # whatever a library raises, the thread continues
            error = failure(raised)
        with self._changed:
            self._under_way = False
            if self._abandoned:
                return
            if error is None:
                self._outbox.arrived(entry)
            else:
                permanent = isinstance(error, SendError) and error.permanent
                again = not permanent and not self._stopping
                asked = error.again_s if isinstance(error, SendError) else None
                self._outbox.failed(entry, self._now_s(), again=again, again_s=asked)
        if error is not None:
            self._failed(error)

    def _tend(self) -> None:
        if self._sender.tend_s is None:
            return
        try:
            self._sender.tend()
        except BaseException as error:
            with self._changed:
                self._outbox.failures += 1
            self._failed(failure(error))

    def _failed(self, error: Exception) -> None:
        """Keep the newest error, and log it at a limited rate."""
        self.last_error = without(self._sender.secrets, failure_text(error))
        self._untold_failures += 1
        now_s = self._now_s()
        if self._told_s is not None and now_s < self._told_s + TELL_EVERY_S:
            return
        self._told_s = now_s
        count, self._untold_failures = self._untold_failures, 0
        times = f" ({count} failures)" if count > 1 else ""
        log.warning("alert hook %s: %s%s", self.settings.label, self.last_error, times)

    def _now_s(self) -> float:
        return self._clock.now_ns() * 1e-9


def failure_text(error: Exception) -> str:
    """Return the failure as one line."""
    return one_line(str(error) if isinstance(error, SendError) else said(error), 200)


def without(secrets: Iterable[str], text: str) -> str:
    """Return ``text`` without secrets, because a server may echo them."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return text
