"""Keeps the seconds around each event in a separate file, next to the chained log.

The loop's thread holds the newest items in a ring buffer, and hands them over when an event starts.
A separate thread encodes, writes and chains them, pausing between items so that a burst does not
take the interpreter from the loop. No code here can delay a tick, and items that could not be kept
are counted.
"""

import errno
import fcntl
import hashlib
import logging
import os
import queue
import re
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from hri_predict.base.errors import ConfigError, OsErrorAs, RecordingError
from hri_predict.base.files import demand_kind
from hri_predict.base.skeleton import CANONICAL
from hri_predict.node.listeners import Tick
from hri_predict.operation.evidence import chain
from hri_predict.operation.evidence.events import Event, Events
from hri_predict.operation.evidence.room import Room
from hri_predict.operation.evidence.settings import EvidenceSettings
from hri_predict.recording import Recorder, RecordingInfo
from hri_predict.recording.mcap.clocks import Clocks
from hri_predict.recording.mcap.items import Item, Items, Rates

log = logging.getLogger(__name__)

LONGEST_NS = 60_000_000_000
"""Maximum length of one event; a longer one continues in a new file."""
MOST_ALSO = 50
"""Maximum number of events described per file; further events are only counted."""
EVERY_TICK_HZ = 1000.0
"""Around an event, the forecast of every tick is kept."""
RING_ITEMS = 20_000
QUEUE_ITEMS = 20_000
CLOSE_TIMEOUT_S = 10.0
_BURST, _PAUSE_S = 10, 0.005


@dataclass(slots=True)
class _Open:
    """An event whose seconds are being kept."""

    first: Event
    at: datetime
    began_ns: int
    end_ns: int
    before_s: float
    also: list[dict[str, Any]] = field(default_factory=list)
    more: int = 0
    path: Path = Path()


_Job = Item | tuple[_Open, list[Item]] | _Open | None
"""Message to the thread: an item, an event with the preceding items, an event's end, or a stop
request.
"""


class Evidence(Items):
    """The evidence of one run, as a listener of the node.

    ``dropped`` counts items that could not be written to a file; ``failures`` counts events that
    could not be kept.
    """

    def __init__(
        self,
        settings: EvidenceSettings,
        base_dir: Path,
        info: RecordingInfo,
        *,
        robots: list[str],
        links: list[tuple[str, ...]],
        threaded: bool = True,
        wall: Callable[[], datetime] = lambda: datetime.now(UTC),
        clocks: Clocks | None = None,
    ) -> None:
        """Continue the log of the folder, or start one.

        Args:
            settings: see ``EvidenceSettings``.
            base_dir: base of a relative folder.
            info: facts that a replay of a file needs.
            robots: names of the robots; ``links`` has those of their capsules.
            threaded: write in a thread (real time) or synchronously (virtual clock).
            wall: the wall clock, UTC.
            clocks: gives the UTC of each message; see ``Recorder``.

        Raises:
            ConfigError: the folder cannot be used, or another node uses it.
        """
        super().__init__(info, Rates(poses_hz=EVERY_TICK_HZ))
        self.folder = base_dir / settings.folder
        self.dropped = self.failures = self.kept = 0
        self._settings, self._info, self._wall = settings, info, wall
        self._clocks = clocks
        self._robots, self._links = robots, links
        self._before_ns, self._after_ns = (
            round(each * 1e9) for each in (settings.before_s, settings.after_s)
        )
        self._events = Events()
        self._lock = threading.Lock()
        self._ring: deque[Item] = deque(maxlen=RING_ITEMS)
        self._open: _Open | None = None
        self._recorder: Recorder | None = None
        self._closed = False
        self._last = self._begin()
        self._queue: queue.SimpleQueue[_Job] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="evidence", daemon=True)
            self._thread.start()

    def take(self, item: Item) -> None:
        """Keep the item for as long as an event may need it."""
        with self._lock:
            if self._closed:
                return
            self._ring.append(item)
            while self._ring and self._ring[0].log_ns < item.log_ns - self._before_ns:
                self._ring.popleft()
            if self._open is not None:
                self._hand(item)

    def on_tick(self, tick: Tick) -> None:
        """Keep the tick's results; start and end events."""
        super().on_tick(tick)
        for event in self._events.of(tick):
            if event.kind in self._settings.of:
                self._begins(event)
        with self._lock:
            if self._open is not None and tick.now_ns >= self._open.end_ns:
                self._hand(self._open)
                self._open = None

    def close(self) -> None:
        """End the open event, write the queued items, and close the log. Safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
            if self._open is not None:
                self._hand(self._open)
                self._open = None
        if self._thread is not None:
            self._queue.put_nowait(None)
            self._thread.join(CLOSE_TIMEOUT_S)
            if self._thread.is_alive():  # the disk is stuck: the chain is left as it is
                self.failures += 1
                return
        self._append({"kind": "end", "at": self._now(), **self._counts()})
        self._only.close()

    def report(self) -> dict[str, Any]:
        """Plain data for ``--json`` and the summary."""
        return {"folder": str(self.folder), "newest_hash": self._last, **self._counts()}

    def _counts(self) -> dict[str, Any]:
        return {
            **self._events.report(self._robots, self._links),
            "kept": self.kept,
            "dropped": self.dropped,
            "failures": self.failures,
        }

    def _begin(self) -> str:
        config = hashlib.sha256(self._info.config.encode()).hexdigest()
        start: dict[str, Any] = {"kind": "start", "at": self._now(), "config_sha256": config}
        with OsErrorAs(ConfigError, f"evidence.folder {self.folder}", "name another folder"):
            demand_kind(self.folder, folder=True)
            self.folder.mkdir(parents=True, exist_ok=True)
            self._only = _alone(self.folder)
            try:
                last = chain.newest(self.folder)
            except RecordingError as error:  # as after a power failure: nothing of it is lost
                start["broken"] = chain.set_aside(self.folder, self._wall())
                log.warning("%s; the broken log is kept as %s", error, start["broken"])
                last = _newest_left(self.folder)
            robots = [_plain(name) for name in self._robots]
            self._room = Room(self.folder, robots, self._settings.max_mb * 1e6)
            return chain.append(self.folder, start, last)

    def _begins(self, event: Event) -> None:
        with self._lock:
            there = self._open
            if there is not None and event.now_ns + self._after_ns > there.began_ns + LONGEST_NS:
                self._hand(there)  # its seconds afterwards would not all be kept
                there = self._open = None
            if there is not None:
                if len(there.also) < MOST_ALSO:
                    there.also.append(self._described(event, self._wall()))
                else:
                    there.more += 1
                there.end_ns = event.now_ns + self._after_ns
                return
            before = list(self._ring)
            held_s = (event.now_ns - before[0].log_ns) * 1e-9 if before else 0.0
            self._open = _Open(
                event, self._wall(), event.now_ns, event.now_ns + self._after_ns, held_s
            )
            self._hand((self._open, before))

    def _hand(self, job: _Job) -> None:
        if self._thread is None:
            self._do(job)
            return
        if isinstance(job, Item) and self._queue.qsize() >= QUEUE_ITEMS:
            self.dropped += 1
        else:  # begin and end of an event are never dropped: there are few
            self._queue.put_nowait(job)

    def _run(self) -> None:
        while (job := self._queue.get()) is not None:
            self._do(job)

    def _do(self, job: _Job) -> None:
        try:
            if isinstance(job, Item):
                self._write([job])
            elif isinstance(job, tuple):
                job[0].path = self._path(job[0])
                self._recorder = Recorder(
                    job[0].path, self._info, threaded=False, clocks=self._clocks
                )
                self._write(job[1])
            elif isinstance(job, _Open):
                self._ended(job)
        except (OSError, RecordingError) as error:
            self.failures += 1
            log.error("evidence: an event could not be kept: %s", error)
            self._recorder = None
        except Exception:  # one event must not end the keeping of all others
            self.failures += 1
            log.exception("evidence: an event could not be kept")
            self._recorder = None

    def _write(self, items: Sequence[Item]) -> None:
        if self._recorder is None:
            self.dropped += len(items)
            return
        for number, item in enumerate(items, 1):
            self._recorder.take(item)
            if self._thread is not None and number % _BURST == 0 and not self._closed:
                time.sleep(_PAUSE_S)

    def _ended(self, event: _Open) -> None:
        recorder, self._recorder = self._recorder, None
        entry = self._described(event.first, event.at)
        entry |= {"also": event.also, "more": event.more}
        if recorder is not None:
            recorder.close()
            path = event.path
            _sync(path)
            self.dropped += recorder.dropped
            entry |= {"file": path.name, "before_s": round(event.before_s, 3)}
            entry |= {"messages": recorder.written, "lost": recorder.dropped}
            entry["sha256"] = chain.file_hash(path)
            self._room.add(path)
            if recorder.error is None:
                self.kept += 1
            else:
                entry["error"] = recorder.error
                self.failures += 1
        self._append(entry)
        self._make_room()

    def _described(self, event: Event, at: datetime) -> dict[str, Any]:
        advice, links = event.advice, self._links[event.robot]
        part, link = advice.body_part, advice.robot_link
        found: dict[str, Any] = {
            "kind": event.kind,
            "at": at.isoformat(timespec="milliseconds"),
            "robot": self._robots[event.robot],
            "level": advice.level.name.lower(),
            "reason": advice.reason.name,
            "detail": advice.detail,
            "separation_m": advice.separation_m,
            "speed_limit_m_s": advice.speed_limit_m_s,
            "body_part": None if part is None else CANONICAL.segment_names[part],
            "robot_link": None if link is None else links[link],
        }
        if (miss := event.near_miss) is not None:
            found |= {
                "body_part": miss.segment,
                "robot_link": links[miss.link],
                "separation_m": round(miss.separation_m, 4),
                "limit_m": round(miss.limit_m, 4),
            }
        return found

    def _path(self, event: _Open) -> Path:
        robot = _plain(self._robots[event.first.robot])
        stamp = f"{event.at:%Y%m%dT%H%M%S}.{event.at.microsecond // 1000:03d}Z"
        name = f"{stamp}-{robot}-{event.first.kind}"
        path, number = self.folder / f"{name}.mcap", 1
        while os.path.lexists(path):  # the wall clock was set back
            number += 1
            path = self.folder / f"{name}-{number}.mcap"
        return path

    def _append(self, entry: dict[str, Any]) -> bool:
        """Append a line to the log, and return whether it was written."""
        try:
            self._last = chain.append(self.folder, entry, self._last)
        except OSError as error:
            self.failures += 1
            log.error("evidence %s: cannot be written: %s", self.folder, error.strerror)
            return False
        return True

    def _make_room(self) -> None:
        """Remove the oldest files while their total size exceeds the limit."""
        names = self._room.put_aside()
        if not names:
            return
        if self._append({"kind": "room", "at": self._now(), "removed": names}):
            self._room.delete(names)
        else:
            self._room.restore(names)

    def _now(self) -> str:
        return self._wall().isoformat(timespec="milliseconds")


def _sync(path: Path) -> None:
    """Force a file and its folder's entry to the disk, so that a power failure cannot leave a line
    with the hash of data that were lost: it would look as if the file had been changed.

    Raises:
        OSError: the disk did not take them.
    """
    for each in (path, path.parent):
        descriptor = os.open(each, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _plain(robot: str) -> str:
    """A robot's name as used in file names."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", robot)


def _newest_left(folder: Path) -> str:
    """Return the hash to continue with after a broken log was set aside."""
    try:
        return chain.newest(folder)
    except RecordingError:  # the log before it is broken, too
        return chain.START


def _alone(folder: Path) -> IO[str]:
    """Return the folder's lock, held until closed.

    Raises:
        OSError: another node holds it, or the folder is not writable.
    """
    file = os.fdopen(os.open(folder / ".lock", os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644), "w")
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        file.close()
        raise OSError(errno.EBUSY, "another node keeps its evidence there") from error
    return file
