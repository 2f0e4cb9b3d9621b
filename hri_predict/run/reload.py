"""Reads the configuration again while the node runs, and takes what may change safely.

What decides about robots and people, or opens a device, never changes under a running node: it was
checked, and commissioned, as a whole. Such keys are named, and wait for a restart.
"""

import logging
import queue
import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from hri_predict.base.errors import HriPredictError
from hri_predict.operation.service.notify import Notifier
from hri_predict.run.config import Config, NodeSettings

log = logging.getLogger(__name__)

Takes = Callable[[NodeSettings], Callable[[], None]]
"""Checks new settings, or raises HriPredictError, and returns what puts them in force: that never
fails."""


class Reload:
    """Reload of a service on SIGHUP.

    Args:
        config: the configuration that runs.
        load: reads it again, as it was read at the start.
        parts: key or dotted key of the configuration -> who takes it, and all beneath it. They are
            asked in this order.
        notifier: notified when a reload begins and ends.

    Attributes:
        count, failures: reloads, and those of them that changed nothing because the new file is
            wrong.
    """

    def __init__(
        self,
        config: Config,
        load: Callable[[], Config],
        parts: Mapping[str, Takes],
        notifier: Notifier | None = None,
    ) -> None:
        self._load, self._parts, self._notifier = load, parts, notifier
        self._running: dict[str, Any] = config.node.model_dump()
        self.count = self.failures = 0
        self._asked: queue.SimpleQueue[bool] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Wait for ``ask`` in a thread: reading a configuration takes longer than a tick."""
        self._thread = threading.Thread(target=self._work, name="reload", daemon=True)
        self._thread.start()

    def ask(self) -> None:
        """Reload soon. A signal's handler may call this: ``SimpleQueue.put`` is reentrant."""
        self._asked.put(True)

    def close(self) -> None:
        """Reload no more; safe to call twice."""
        if self._thread is not None:
            self._asked.put(False)
            self._thread.join(2.0)
            self._thread = None

    def now(self) -> None:
        """Read the file; take what may change, or nothing at all if anything in it is wrong."""
        self.count += 1
        if self._notifier is not None:
            self._notifier.reloading()
        try:
            said = self._take(self._load())
        except HriPredictError as error:
            self.failures += 1
            first, *others = str(error).splitlines()
            more = f" (and {len(others)} more: hri-predict check)" if others else ""
            said = [f"nothing changed: {first}{more}"]
        except Exception as error:  # the node goes on as it was
            self.failures += 1
            said = [f"nothing changed: {type(error).__name__}: {error}"]
        for line in said:
            log.warning("reload: %s", line)
        if self._notifier is not None:
            self._notifier.ready(f"reload: {'; '.join(said)}")

    def _take(self, new: Config) -> list[str]:
        wanted = new.node.model_dump()
        changed = list(differences(self._running, wanted))
        taken = {key: part for key in changed if (part := self._part_of(key)) is not None}
        parts = [part for part in self._parts if part in taken.values()]
        put_in_force = [self._parts[part](new.node) for part in parts]
        for each in put_in_force:
            each()
        for part in parts:
            _copy(part.split("."), wanted, self._running)
        said = [f"{key}: changed" for key in taken]
        said += [f"{key}: needs a restart" for key in changed if key not in taken]
        return said or ["nothing differs"]

    def _part_of(self, key: str) -> str | None:
        fits = (part for part in self._parts if key == part or key.startswith(f"{part}."))
        return next(fits, None)

    def _work(self) -> None:
        while self._asked.get():
            self.now()


def differences(old: Any, new: Any, at: str = "") -> Iterator[str]:
    """Dotted keys of what differs; of a list that grew or shrank, the list's own key."""
    if isinstance(old, dict) and isinstance(new, dict):
        for key in dict.fromkeys([*old, *new]):
            where = f"{at}.{key}" if at else str(key)
            if key not in old or key not in new:
                yield where
            else:
                yield from differences(old[key], new[key], where)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for i, (a, b) in enumerate(zip(old, new, strict=True)):
            yield from differences(a, b, f"{at}.{i}")
    elif old != new:
        yield at


def _copy(keys: list[str], source: dict[str, Any], target: dict[str, Any]) -> None:
    for key in keys[:-1]:
        source, target = source[key], target[key]
    target[keys[-1]] = source[keys[-1]]
