"""Reports the node's state to systemd, from the loop's own thread.

The watchdog ping must prove that the loop publishes. Therefore the loop itself sends it, after the
tick's messages and after every other listener; a helper thread must not. A loop that hangs anywhere
sends no ping, and systemd kills and restarts the node.
"""

import time
from collections.abc import Callable, Sequence

from hri_predict.node.listeners import Listener, Tick
from hri_predict.operation.service.notify import Notifier
from hri_predict.protocol.messages import NodeState

STATUS_S = 1.0
"""Minimum time between two status lines."""


class Watched(Listener):
    """Reports the node's state to ``notifier``; add it as the last listener.

    Args:
        notifier: receiver of the reports.
        robots: names of the robots.
        monotonic_s: the machine's clock, not the node's, because the watchdog uses it.
    """

    def __init__(
        self,
        notifier: Notifier,
        robots: Sequence[str],
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._notifier, self._robots, self._monotonic_s = notifier, robots, monotonic_s
        self._is_ready = False
        self._status, self._said_s = "", 0.0
        self._pinged_s: float | None = None

    def on_tick(self, tick: Tick) -> None:
        """Report a changed state; ping after half of the watchdog's time."""
        state = tick.status.node_state
        if state is NodeState.STOPPING:
            self._notifier.stopping()
            return
        if state is NodeState.STARTING and tick.snapshot is None:
            return  # the announcement: nothing was judged yet
        now_s, status = self._monotonic_s(), _status(tick, self._robots)
        if not self._is_ready:
            self._is_ready = True
            self._notifier.ready(status)
            self._status, self._said_s = status, now_s
        elif status != self._status and now_s - self._said_s >= STATUS_S:
            self._notifier.says(status)
            self._status, self._said_s = status, now_s
        self._ping(now_s)

    def _ping(self, now_s: float) -> None:
        watchdog_s = self._notifier.watchdog_s
        if watchdog_s is None:
            return
        if self._pinged_s is None or now_s - self._pinged_s >= watchdog_s / 2:
            self._notifier.alive()
            self._pinged_s = now_s


def _status(tick: Tick, robots: Sequence[str]) -> str:
    levels = ", ".join(f"{robots[a.robot]} {a.level.name.lower()}" for a in tick.advices)
    reason = tick.status.reason.name
    why = "" if reason == "NONE" else f" ({reason})"
    people = tick.status.people
    who = "1 person" if people == 1 else f"{people} people"
    return f"{tick.status.node_state.name.lower()}{why}: {levels}; {who}"
