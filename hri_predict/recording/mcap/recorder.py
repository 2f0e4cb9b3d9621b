"""Records all input and output into MCAP files, without ever delaying the node.

In real time the caller puts references into a bounded queue, and the recorder's own thread encodes
and writes them; items beyond the queue's size are dropped and counted. While a disk is full or
missing, items are lost; the recorder retries and continues when it can. On the virtual clock the
recorder writes immediately, and nothing in the file depends on the wall clock, so two virtual runs
give the same bytes.
"""

import contextlib
import errno
import logging
import os
import queue
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from hri_predict.base.errors import OsErrorAs, RecordingError
from hri_predict.recording.mcap.clocks import STEP_NS, Clocks, Reading, VirtualClocks
from hri_predict.recording.mcap.file import McapFile
from hri_predict.recording.mcap.info import RecordingInfo
from hri_predict.recording.mcap.items import Counters, Item, Items, Rates
from hri_predict.recording.mcap.places import OneFile, RecordingFiles

log = logging.getLogger(__name__)

QUEUE_ITEMS = 4096
GATHER_S = 0.05
"""Pause of the thread after it has emptied the queue, so it wakes once per tick, not for each
item."""
CLOSE_TIMEOUT_S = 10.0
FLUSH_NS = 500_000_000
"""Maximum time span lost by a killed writer, in addition to the queue's content."""
LOOK_NS = 1_000_000_000
"""Interval at which the clocks are compared and the free disk space is checked."""
RETRY_NS = 2_000_000_000
REMIND_NS = 60_000_000_000
"""Interval of the log message while nothing can be recorded."""


class Recorder(Items):
    """Writes a recording, as a listener of the node.

    Every method may be called from any thread, and none but ``close`` waits for the disk.

    Counters: ``written`` messages; ``dropped`` messages (queue full, or the disk took none);
    ``failures``: how often the disk refused; ``files``; ``error`` is why nothing is recorded now,
    or ``None``.
    """

    def __init__(
        self,
        where: Path | RecordingFiles,
        info: RecordingInfo,
        *,
        threaded: bool,
        rates: Rates | None = None,
        counters: Counters | None = None,
        clocks: Clocks | None = None,
        queue_items: int = QUEUE_ITEMS,
    ) -> None:
        """Create the first file.

        Args:
            where: the file to write, which must not exist, or a ``RecordingFiles``.
            info: facts that a replay needs.
            threaded: write in a thread (real time) or at once (virtual clock).
            rates: rates of bulky data.
            counters: see ``Items``.
            clocks: source of each moment's UTC; default: UTC is the node's clock.
            queue_items: messages that may wait for the thread.

        Raises:
            RecordingError: the file exists, or cannot be created.
        """
        super().__init__(info, rates, counters)
        self.dropped = self.written = self.failures = self.files = 0
        self.error: str | None = None
        self._place: RecordingFiles = OneFile(where) if isinstance(where, Path) else where
        self._info, self._threaded = info, threaded
        self._clocks = clocks or VirtualClocks()
        self._file: McapFile | None = None
        self._look_ns = self._flush_ns = self._retry_ns = 0
        self._remind_ns: int | None = None
        self._told_dropped = 0
        self._lock = threading.Lock()
        self._closed = False
        self._ends = threading.Event()
        self._reading = self._clocks.read(0)
        self._start()
        self._queue: queue.Queue[Item | None] = queue.Queue(queue_items)
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
            self._thread.start()

    def _start(self) -> None:
        """Start the first file, so that mistakes show immediately.

        Raises:
            RecordingError: it cannot be created.
        """
        what, remedy = f"recording {self._place.name}", "name another file or folder"
        with OsErrorAs(RecordingError, f"{what}: cannot be written", remedy):
            if why := self._place.why_not(None):
                self._fails(why, 0)
            else:
                self._begin()

    def close(self) -> None:
        """Write waiting messages, finish the file and close it. Safe to call twice.

        A file without any message is removed.
        """
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._ends.set()
        if self._thread is not None:
            try:
                self._queue.put(None, timeout=CLOSE_TIMEOUT_S)
            except queue.Full:
                self.error = self.error or "the disk did not keep up"
            self._thread.join(CLOSE_TIMEOUT_S)
            if self._thread.is_alive():  # it is stuck in the operating system and keeps the file
                self.error = self.error or "the disk did not keep up"
                return
        file, is_empty = self._file, self.files == 1 and self.written == self.dropped == 0
        self._end_file()
        if file is not None and is_empty and file.path.is_file():
            file.path.unlink(
                missing_ok=True
            )  # a start that failed must not stand in the next's way
            self.files = 0
        self._place.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def take(self, item: Item) -> None:
        """Queue it, or write it immediately; messages that fail are counted."""
        if self._closed:
            self._drop()
        elif self._thread is None:
            self._write(item)
        else:
            try:
                self._queue.put_nowait(item)
            except queue.Full:
                self._drop()

    def report(self) -> dict[str, Any]:
        """Return plain data for ``--json`` and the summary."""
        return {
            "path": str(self._place.name),
            "files": self.files,
            "written": self.written,
            "dropped": self.dropped,
            "failures": self.failures,
            "error": self.error,
        }

    def _run(self) -> None:
        while True:
            try:
                item = self._queue.get(timeout=FLUSH_NS * 1e-9)
            except queue.Empty:
                self._idle()
                continue
            while item is not None:
                self._write(item)
                try:
                    item = self._queue.get_nowait()
                except queue.Empty:
                    break
            else:
                return
            self._ends.wait(GATHER_S)

    def _idle(self) -> None:
        """After a pause in the input, write all pending data to the disk."""
        if self._file is not None and self.error is None and self._file.unsafe:
            try:
                self._file.flush()
            except OSError as error:
                self._fails(_why(error), self._flush_ns)

    def _write(self, item: Item) -> None:
        is_added = False
        try:
            self._do_what_is_due(item.log_ns)
            if self._file is None or self.error is not None:
                self._drop()
                self._remind(item.log_ns)
                return
            self._file.add(item, item.log_ns + self._reading.offset_ns)
            self.written += 1
            is_added = True
            self._file.push()
        except OSError as error:
            self._fails(_why(error), item.log_ns)
            if not is_added:
                self._drop()
        except Exception:  # one message that cannot be encoded must not end the recording
            if self.dropped == 0:
                log.exception("a message for %s could not be recorded", item.topic)
            self._drop()

    def _do_what_is_due(self, now_ns: int) -> None:
        """Compare the clocks, start the next file, retry, and flush.

        Raises:
            OSError: the disk refused.
        """
        if self.error is not None and now_ns >= self._retry_ns:
            self._retry(now_ns)
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + LOOK_NS
            self._look(now_ns)
        if now_ns >= self._flush_ns and self._file is not None and self.error is None:
            self._flush_ns = now_ns + FLUSH_NS
            self._file.flush()

    def _look(self, now_ns: int) -> None:
        before, self._reading = self._reading, self._clocks.read(now_ns)
        if self._file is None or self.error is not None:
            return
        if why := self._place.why_not(self._file.path):
            self._file.flush()
            self._fails(why, now_ns)
            return
        stepped = abs(self._reading.moved_ns(before)) > STEP_NS
        if self._place.wants_next(self._file, self._reading, stepped):
            self._end_file()
            self._begin()
        self._tell_clocks(self._file, before)
        if self.dropped > self._told_dropped and self._may_say(now_ns):
            self._told_dropped = self.dropped
            log.warning("recording %s: messages lost so far: %d", self._place.name, self.dropped)

    def _tell_clocks(self, file: McapFile, before: Reading) -> None:
        reading = self._reading
        said = {**reading.to_dict(before), "dropped": self.dropped}
        file.write("/clock", reading.node_ns, reading.utc_ns, said)

    def _begin(self) -> None:
        path, descriptor = self._place.open(self._reading)
        try:
            self._file = McapFile(
                path,
                descriptor,
                self._info,
                began=self._reading,
                clocks=self._clocks.name,
                sync=self._threaded,
            )
        except OSError:
            os.close(descriptor)
            self._place.discard(path)  # an empty file would be in the way of the next start
            raise
        self.files += 1

    def _end_file(self) -> None:
        """Finish the file and close it; data rejected by the disk are then lost."""
        file, self._file = self._file, None
        if file is None:
            return
        try:
            file.finish()
        except OSError as error:
            self._fails(_why(error), self._flush_ns)
        self._give_up(file)

    def _give_up(self, file: McapFile) -> None:
        with self._lock:
            self.dropped += file.unsafe
        self.written -= file.unsafe
        with contextlib.suppress(OSError):
            file.close()

    def _retry(self, now_ns: int) -> None:
        """Try to record again: in the same file, or in a new one if that one is broken."""
        self._retry_ns = now_ns + RETRY_NS
        why = self._place.why_not(None if self._file is None else self._file.path)
        try:
            if why:
                self.error = why
                return
            if self._file is not None:
                self._file.flush()
            else:
                self._begin()
        except OSError as error:
            self.error = _why(error)
            self.failures += 1
            broken = error.errno not in (errno.ENOSPC, errno.EDQUOT)
            if broken and self._place.has_many and self._file is not None:
                file, self._file = self._file, None
                self._give_up(file)
            return
        log.warning("recording %s: continues; lost: %d", self._place.name, self.dropped)
        self.error, self._remind_ns, self._told_dropped = None, None, self.dropped
        self._look_ns = now_ns

    def _fails(self, why: str, now_ns: int) -> None:
        self.error = why
        self.failures += 1
        self._retry_ns = now_ns + RETRY_NS
        if self._may_say(now_ns):
            log.error("recording %s: %s; it continues when it can", self._place.name, why)

    def _drop(self) -> None:
        with self._lock:  # several threads write
            self.dropped += 1

    def _remind(self, now_ns: int) -> None:
        """Log at a limited rate that nothing is recorded."""
        if self._may_say(now_ns):
            log.error("recording %s: %s; lost: %d", self._place.name, self.error, self.dropped)

    def _may_say(self, now_ns: int) -> bool:
        if self._remind_ns is not None and now_ns < self._remind_ns:
            return False
        self._remind_ns = now_ns + REMIND_NS
        return True


def _why(error: OSError) -> str:
    return error.strerror or str(error)
