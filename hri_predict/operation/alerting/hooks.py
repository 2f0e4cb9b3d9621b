"""All hooks of a node, which may be exchanged while it runs."""

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
    """Hands each alert to every hook. What was counted stays, whichever hooks end.

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
        """Queue an alert for each hook; waits for no receiver."""
        with self._lock:
            for hook in self._live:
                hook.put(alert)

    def exchange(self, settings: Sequence[HookSettings]) -> Callable[[], None]:
        """Make the hooks of new settings, and return what puts them in force.

        A hook with the same settings as before continues, with all that waits in it. New ones start
        before those that are left out end; these try once more what waits in them, and nothing
        waits for that.

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
        """Ask all to try once more what waits and to end; returns at once."""
        with self._lock:
            self._stopping = True
            hooks = [*self._live, *self._ending]
        for hook in hooks:
            hook.stop()

    def join(self, begun_s: float) -> None:
        """Wait for their end, each within its bound since ``begun_s`` (``time.monotonic``)."""
        with self._lock:
            hooks = [*self._live, *self._ending]
        _join(hooks, begun_s)

    @property
    def failures(self) -> int:
        """Attempts that failed, until now."""
        return sum(row["failures"] for row in self.report())

    def report(self) -> list[dict[str, Any]]:
        """A row for each hook that works, and for each name that had one."""
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
        name = "alert hooks ending"  # a command may take long
        threading.Thread(target=self._see_off, args=(left,), name=name, daemon=True).start()

    def _see_off(self, left: list[Hook]) -> None:
        """Wait for the end of hooks that were left out, and keep what they counted."""
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
    """Counts added; of texts the newer one, unless it is empty."""
    return {k: old[k] + v if isinstance(v, int) else v or old[k] for k, v in new.items()}
