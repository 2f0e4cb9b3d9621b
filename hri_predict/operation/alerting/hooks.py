"""All hooks of a node; they can be replaced while the node runs."""

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from hri_predict.operation.alerting.alert import AnyAlert
from hri_predict.operation.alerting.hook import Hook
from hri_predict.operation.alerting.kinds import hooks_of
from hri_predict.operation.alerting.sender import HookContext
from hri_predict.operation.alerting.settings import HookSettings


class Hooks:
    """Passes each alert to every hook. Counters are kept when a hook is removed.

    Raises:
        ConfigError: a hook cannot be used.
    """

    def __init__(self, settings: Sequence[HookSettings], place: HookContext) -> None:
        self._place = place
        self._live = hooks_of(settings, place)
        self._ending: list[Hook] = []
        self._ended: dict[str, dict[str, Any]] = {}  # name -> what hooks of that name counted
        self._lock = threading.Lock()  # held for moments only: the node's loop takes it
        self._stopping = False

    def start(self) -> None:
        """Start each hook's thread."""
        with self._lock:
            for hook in self._live:
                hook.start()

    def put(self, alert: AnyAlert) -> None:
        """Queue an alert for each hook; does not wait for receivers."""
        with self._lock:
            for hook in self._live:
                hook.put(alert)

    def exchange(self, settings: Sequence[HookSettings]) -> Callable[[], None]:
        """Create the hooks for new settings, and return a function that applies them.

        A hook with unchanged settings continues and keeps its queued alerts. New hooks start before
        removed hooks stop; a removed hook tries its queued alerts once more in the background.

        Raises:
            ConfigError: a hook cannot be used; nothing has changed.
        """
        left = list(self._live)
        wanted = []
        for each in settings:
            same = next((hook for hook in left if hook.settings == each), None)
            if same is None:
                wanted += hooks_of([each], self._place)
            else:
                left.remove(same)
                wanted.append(same)
        return partial(self._put_in_force, wanted, left)

    def stop(self) -> None:
        """Ask all hooks to try their queued alerts once more and to stop; does not wait."""
        with self._lock:
            self._stopping = True
            hooks = [*self._live, *self._ending]
        for hook in hooks:
            hook.stop()

    def join(self, begun_s: float) -> None:
        """Wait for all hooks to stop, each within its time limit since ``begun_s``
        (``time.monotonic``).
        """
        with self._lock:
            hooks = [*self._live, *self._ending]
        _join(hooks, begun_s)

    @property
    def failures(self) -> int:
        """Number of failed attempts."""
        return sum(row["failures"] for row in self.report())

    def report(self) -> list[dict[str, Any]]:
        """Return a row for each running hook, and for each name that had one before."""
        with self._lock:
            rows = [hook.report() for hook in self._live]
            before = dict(self._ended)
            for hook in self._ending:
                before = _with(before, hook.report())
        told = [
            _sum(before.pop(row["name"]), row) if row["name"] in before else row for row in rows
        ]
        return told + list(before.values())

    def _put_in_force(self, wanted: list[Hook], left: list[Hook]) -> None:
        with self._lock:
            if self._stopping:
                return
            for hook in wanted:
                hook.start()
            self._live = wanted
            self._ending += left
        for hook in left:
            hook.stop()
        name = "stopping alert hooks"  # a command may take long
        threading.Thread(target=self._see_off, args=(left,), name=name, daemon=True).start()

    def _see_off(self, left: list[Hook]) -> None:
        """Wait for removed hooks to stop, and keep their counters."""
        _join(left, time.monotonic())
        with self._lock:
            for hook in left:
                self._ended = _with(self._ended, hook.report())
                self._ending.remove(hook)


def _join(hooks: Sequence[Hook], begun_s: float) -> None:
    for hook in hooks:
        hook.join(max(begun_s + hook.settings.stop_s - time.monotonic(), 0.0))


def _with(rows: dict[str, dict[str, Any]], row: dict[str, Any]) -> dict[str, dict[str, Any]]:
    name = row["name"]
    return {**rows, name: _sum(rows[name], row) if name in rows else row}


def _sum(old: dict[str, Any], new: dict[str, Any]) -> dict[str, Any]:
    """Return the sums of the counters, and the newer of two texts unless it is empty."""
    return {k: old[k] + v if isinstance(v, int) else v or old[k] for k, v in new.items()}
