"""A running hook: each has its own thread, so a slow receiver delays nothing else."""

import logging
import threading
from collections.abc import Iterable
from typing import Any

from hri_predict.base.clock import Clock, MonotonicClock
from hri_predict.operation.alerting.alert import AnyAlert
from hri_predict.operation.alerting.outbox import Entry, Outbox
from hri_predict.operation.alerting.sender import Sender, SendError, said
from hri_predict.operation.alerting.settings import HookSettings
from hri_predict.operation.alerting.text import one_line

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
        except Exception as error:
            self._failed(error)

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
        except Exception as failure:  # whatever a library raises, the thread continues
            error = failure
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
        except Exception as error:
            with self._changed:
                self._outbox.failures += 1
            self._failed(error)

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
