"""Persistent state of the node: latches and lost people, in a small file.

Stateful parts offer ``remember``, ``recall`` and ``distrust``. Their stamps come from a monotonic
clock, which is meaningless to the next process. So the parts store the age of an event (``ago_s``),
and the file stores the wall-clock time of writing. Data that cannot be read or dated, or that are
not provably this cell's newest state, are distrusted: each part then assumes the safe state.

The same applies to missing data: a user who configures a state file relies on it, and a first start
cannot be distinguished from a deleted file. The loop's thread only compares the data and passes
them on; a separate thread writes. A file is replaced as a whole, after it has reached the disk, so
a crash or a power failure leaves the old or the new one.
"""

import contextlib
import errno
import fcntl
import json
import logging
import math
import os
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Protocol

from pydantic import Field

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.base.files import demand_kind
from hri_predict.base.settings import Abbreviated
from hri_predict.node.listeners import Listener, Tick
from hri_predict.node.marker import Mark

log = logging.getLogger(__name__)

VERSION = 2
LONG_AGO_S = 1e8
"""Age used if the elapsed time is unknown, because the wall clock went backwards."""
MAX_BYTES = 1_000_000
RETRY_S = 1.0
"""Time from a failed write to the next attempt."""
STUCK_S = 5.0
"""Time after which a write is treated as failed, because a disk may hang without an error."""
MISSING = (
    "there is no state file {}: this is the first start, or the file was deleted; make sure that "
    "no one is hidden in the room, then acknowledge once, 12 s or more after the start"
)
_WRONG = (KeyError, TypeError, ValueError, AttributeError, RecursionError, OverflowError)


class StateSettings(Abbreviated):
    """``state:`` in the configuration; a plain text is the file's path."""

    path: str = Field(min_length=1, description="file that stores latches and lost people")
    max_age_s: float = Field(
        86_400.0,
        ge=60,
        le=3650 * 86_400,
        description="maximum age of a trusted file; with an older one everything configured in "
        "risk.latch is latched",
    )


def demand_state_file(path: Path) -> None:
    """Check that ``path`` is suitable for a state file; opens nothing.

    Raises:
        ConfigError: something else exists there.
    """
    with OsErrorAs(ConfigError, f"state.path: {path} cannot be used", "check the path"):
        demand_kind(path)


class Remembers(Protocol):
    """A part of the node with persistent state."""

    def remember(self) -> dict[str, Any]:
        """Return the data to keep, JSON-compatible. Ages in seconds have the key ``ago_s``; their
        growth is not a change.
        """

    def recall(self, data: Mapping[str, Any], since_s: Callable[[], float]) -> None:
        """Restore the data of ``remember`` from an earlier run.

        Every ``ago_s`` is relative to this call; ``since_s`` returns the seconds since then, which
        the rest of the start may take.

        Raises:
            KeyError, TypeError, ValueError: ``data`` does not have the form of ``remember``.
        """

    def distrust(self, why: str) -> None:
        """Assume the safe state: an earlier run's data cannot be trusted; ``why`` is the reason."""


class Memory(Listener):
    """The state file of one node.

    Args:
        settings: see ``StateSettings``.
        base_dir: base of a relative path.
        parts: name -> part.
        cell: identity of this cell; data of another cell are not trusted.
        wall_s: the wall clock, seconds since the epoch.
        monotonic_s: a monotonic clock, seconds; used if ``threaded``, because in virtual time a
            start takes no time.
        threaded: write in a thread; without it, each write blocks its caller.

    Attributes:
        written, failures: number of writes that did and did not reach the disk.
        failing: the newest data have not reached the disk.
        last_error: message of the newest failure.
    """

    def __init__(
        self,
        settings: StateSettings,
        base_dir: Path,
        parts: Mapping[str, Remembers],
        *,
        cell: str = "",
        wall_s: Callable[[], float] = time.time,
        monotonic_s: Callable[[], float] = time.monotonic,
        threaded: bool = True,
    ) -> None:
        self.path = base_dir / settings.path
        self.written = self.failures = 0
        self.failing = False
        self.last_error: str | None = None
        self._cell = cell
        self._mark = Mark.new()
        self._max_age_s = settings.max_age_s
        self._parts = parts
        self._wall_s, self._monotonic_s = wall_s, monotonic_s
        self._threaded = threaded
        self._lock: int | None = None
        self._kept: Any = None  # the data last handed over, without the ``ago_s``
        self._kept_at_s = 0.0
        self._waiting: dict[str, Any] | None = None  # the newest wins
        self._waits_since_s: float | None = None
        self._wake = threading.Event()
        self._stop = False
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Restore the parts' state from an earlier run; call it before the first tick.

        Raises:
            ConfigError: another node uses the file, or its folder cannot be used.
        """
        lock = self._claim()
        mark = Mark.read(lock)
        self._mark = mark or self._mark
        try:
            data = self._read()
            if data is None:
                self._distrust(MISSING.format(self.path))
            elif why := self._contradiction(data, mark):
                self._distrust(f"the state file {self.path} {why}")
            else:
                self._recall(data)
        except _WRONG as error:
            self._distrust(f"the state file {self.path} cannot be read: {_short(error)}")
        if self._threaded:
            self._thread = threading.Thread(target=self._run, name="state", daemon=True)
            self._thread.start()

    def on_tick(self, tick: Tick) -> None:
        """Pass changed data to the writer; never waits for the disk."""
        parts = {name: part.remember() for name, part in self._parts.items()}
        kept, now_s = _without_ago(parts), self._wall_s()
        since_s = self._waits_since_s
        self.failing |= since_s is not None and now_s - since_s > STUCK_S
        is_due = not 0 <= now_s - self._kept_at_s < self._max_age_s / 10
        if kept == self._kept and not is_due:
            return
        self._kept, self._kept_at_s = kept, now_s
        if self._waits_since_s is None:
            self._waits_since_s = now_s
        self._waiting = {"version": VERSION, "cell": self._cell, "written": now_s, "parts": parts}
        if self._threaded:
            self._wake.set()
        else:
            self._write_waiting()

    def close(self) -> None:
        """Write the remaining data and release the file; safe to call twice."""
        self._stop = True
        self._wake.set()
        if self._thread is not None:
            self._thread.join(5.0)
            if self._thread.is_alive():
                return  # the disk hangs: the lock must not be closed while it is written
            self._thread = None
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    # -- the disk ---------------------------------------------------------------------------------

    def _claim(self) -> int:
        """Lock the lock file; the lock is released at the latest when the process exits."""
        demand_state_file(self.path)
        lock = self.path.with_name(self.path.name + ".lock")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return self._lock
        except BlockingIOError:
            self.close()
            raise ConfigError(
                f"state.path: another node uses {self.path}; give each node a file of its own"
            ) from None
        except OSError as error:
            self.close()
            raise ConfigError(
                f"state.path: {self.path} cannot be used: {error.strerror}; check the path"
            ) from error

    def _read(self) -> dict[str, Any] | None:
        """Return the file's content; ``None`` if there is no file."""
        try:
            with self.path.open("rb") as file:
                raw = file.read(MAX_BYTES + 1)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise ValueError(error.strerror) from error
        if len(raw) > MAX_BYTES:
            raise ValueError(f"longer than {MAX_BYTES} bytes")
        data: dict[str, Any] = json.loads(raw)
        if data["version"] != VERSION:
            raise ValueError(f"version {data['version']}")
        return data

    def _contradiction(self, data: dict[str, Any], mark: Mark | None) -> str:
        """Return why the data are not provably this cell's newest; "" if they are."""
        if data["cell"] != self._cell:
            return (
                "belongs to another cell, or robots, source or configuration have been moved since"
            )
        if mark is None:
            return "has no lock file that proves it is the newest"
        return mark.contradiction(str(data["name"]), int(data["writes"]), self.path)

    def _recall(self, data: dict[str, Any]) -> None:
        age_s = self._wall_s() - float(data["written"])
        if not math.isfinite(age_s):
            raise ValueError("the time of writing is not a number")
        parts = _aged(data["parts"], age_s if age_s >= 0 else LONG_AGO_S)
        began_s = self._monotonic_s()
        for name, part in self._parts.items():
            part.recall(
                parts[name], lambda: self._monotonic_s() - began_s if self._threaded else 0.0
            )
        if age_s < 0:
            self._distrust(f"the state file {self.path} is from the future: check the clock")
        elif age_s > self._max_age_s:
            self._distrust(f"the state file {self.path} is {age_s / 3600:.1f} h old")

    def _distrust(self, why: str) -> None:
        log.warning("%s; everything in risk.latch is latched", why)
        for part in self._parts.values():
            part.distrust(why)

    def _run(self) -> None:
        while not self._stop or self._waiting is not None:
            self._wake.wait(RETRY_S if self._waiting is not None else None)
            self._wake.clear()
            if not self._write_waiting() and self._stop:
                return

    def _write_waiting(self) -> bool:
        """Write the waiting data; keep it for another attempt if that fails."""
        data = self._waiting
        if data is None:
            return True
        try:
            self._write(data)
        except (OSError, TypeError, ValueError) as error:  # the last two: not JSON, or NaN
            self.failures += 1
            self.failing = True
            self.last_error = getattr(error, "strerror", None) or str(error)
            if self.failures % 1000 == 1:
                log.warning("the state file %s is not written: %s", self.path, self.last_error)
            return False
        self.written += 1
        if self._waiting is data:
            self._waiting = self._waits_since_s = None
            self.failing = False
        return True

    def _write(self, data: dict[str, Any]) -> None:
        """Write the file, and the mark before and after it.

        Raises:
            OSError: one of them did not reach the disk.
        """
        if self._lock is None:
            raise OSError(errno.EBADF, "it is closed")
        try:
            self._mark = self._mark.begin(self._lock)
        except OSError:
            with contextlib.suppress(OSError):
                self.path.unlink()  # no file is distrusted, but an old one would be believed
            raise
        own = {"name": self._mark.name, "writes": self._mark.writes}
        _write_safely(self.path, json.dumps({**data, **own}, allow_nan=False).encode())
        self._mark = self._mark.end(self._lock, self.path)


def _write_safely(path: Path, data: bytes) -> None:
    """Replace ``path`` after the new content is on the disk; then sync the folder."""
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
    except OSError:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def _aged(data: Any, seconds: float) -> Any:
    """``data`` with every ``ago_s`` longer by ``seconds``."""
    if isinstance(data, dict):
        return {
            key: max(float(value), 0.0) + seconds if key == "ago_s" else _aged(value, seconds)
            for key, value in data.items()
        }
    return [_aged(value, seconds) for value in data] if isinstance(data, list) else data


def _without_ago(data: Any) -> Any:
    if isinstance(data, dict):
        return {key: _without_ago(value) for key, value in data.items() if key != "ago_s"}
    return [_without_ago(value) for value in data] if isinstance(data, list) else data


def _short(error: Exception) -> str:
    text = f"{type(error).__name__}: {error}" if not isinstance(error, ValueError) else str(error)
    return text.splitlines()[0][:80] if text else type(error).__name__
