"""Records all input and output into one MCAP file, without ever delaying the node.

In real time the caller hands references over to a bounded queue, and a thread of the recorder's
encodes and writes; what the queue cannot take is dropped and counted. On the virtual clock the
recorder writes at once. Nothing in the file depends on the wall clock, so that two virtual runs
give the same bytes.
"""

import json
import logging
import queue
import threading
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Self

from mcap.writer import CompressionType, Writer

from hri_predict.errors import RecordingError
from hri_predict.files import refuse_named_pipe
from hri_predict.recording.mcap.format import (
    LIBRARY,
    METADATA,
    SCHEMAS,
    RecordingInfo,
    to_json,
)
from hri_predict.recording.mcap.items import Item, Items

log = logging.getLogger(__name__)

# A chunk is written when it is full; a crash loses at most one chunk, about half a second.
CHUNK_BYTES = 64 * 1024
QUEUE_ITEMS = 4096
CLOSE_TIMEOUT_S = 10.0
REMIND_NS = 60_000_000_000
"""After a failed write, the log says again what is lost, each minute."""


class Recorder(Items):
    """Writes a recording, as a listener of the node.

    Every method may be called from any thread, and none but ``close`` waits for the disk.

    Counters: ``written`` messages; ``dropped`` messages (queue full, or the disk failed);
    ``error`` is why writing failed, or ``None``.
    """

    def __init__(
        self,
        path: Path,
        info: RecordingInfo,
        *,
        threaded: bool,
        horizon_stride: int = 5,
        zones_every: int = 5,
        queue_items: int = QUEUE_ITEMS,
    ) -> None:
        """Create the file; an older one is overwritten.

        Args:
            path: the file to write.
            info: what a replay needs to know.
            threaded: write in a thread (real time) or at once (virtual clock).
            horizon_stride: record every n-th step of forecast and zones.
            zones_every: record the zones of every n-th tick; they are the bulkiest, and follow
                from the forecast.
            queue_items: messages that may wait for the thread.

        Raises:
            RecordingError: the file cannot be created.
        """
        super().__init__(horizon_stride=horizon_stride, zones_every=zones_every)
        self.dropped = self.written = 0
        self.error: str | None = None
        self._path = path
        try:
            refuse_named_pipe(path)
            self._file: IO[bytes] = path.open("wb")
            self._writer, self._channels = _begin(self._file, info)
        except OSError as error:  # a full disk shows at the first write
            raise RecordingError(
                f"recording {path}: cannot be written: {error.strerror}; name another file"
            ) from error
        self._sequence = dict.fromkeys(self._channels, 0)
        self._lock = threading.Lock()
        self._closed = False
        self._remind_ns: int | None = None
        self._queue: queue.Queue[Item | None] = queue.Queue(queue_items)
        self._thread: threading.Thread | None = None
        if threaded:
            self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Write waiting messages, finish the file and close it. Safe to call twice."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        if self._thread is not None:
            try:
                self._queue.put(None, timeout=CLOSE_TIMEOUT_S)
            except queue.Full:
                self.error = self.error or "the disk did not keep up"
            self._thread.join(CLOSE_TIMEOUT_S)
            if self._thread.is_alive():  # it is stuck in the operating system and keeps the file
                self.error = self.error or "the disk did not keep up"
                return
        try:
            if self.error is None:
                self._writer.finish()
            self._file.close()
        except OSError as error:
            self._failed(error)

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
        """Queue it, or write it at once; what cannot be written is counted."""
        if self._closed or self.error is not None:
            self._drop()
            self._remind(item.log_ns)
        elif self._thread is None:
            self._write(item)
        else:
            try:
                self._queue.put_nowait(item)
            except queue.Full:
                self._drop()

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            self._write(item)

    def _write(self, item: Item) -> None:
        if self.error is not None:
            self._drop()
            return
        try:
            data = to_json(item.encode(*item.args))
            log_ns = max(0, item.log_ns)
            self._sequence[item.topic] += 1
            self._writer.add_message(
                self._channels[item.topic],
                log_time=log_ns,
                data=data,
                publish_time=log_ns,
                sequence=self._sequence[item.topic],
            )
            self.written += 1
        except OSError as error:
            self._failed(error)
        except Exception:  # one message that cannot be encoded must not end the recording
            if self.dropped == 0:
                log.exception("a message for %s could not be recorded", item.topic)
            self._drop()

    def _drop(self) -> None:
        with self._lock:  # several threads write
            self.dropped += 1

    def _remind(self, now_ns: int) -> None:
        """Say again and again, at a limited rate, that nothing is recorded any more."""
        if self._remind_ns is None:
            self._remind_ns = now_ns + REMIND_NS
        elif now_ns >= self._remind_ns and not self._closed:
            self._remind_ns = now_ns + REMIND_NS
            log.error("recording %s: ended (%s); lost: %d", self._path, self.error, self.dropped)

    def report(self) -> dict[str, Any]:
        """Return plain data for ``--json``: ``path``, ``written``, ``dropped``, ``error``."""
        return {
            "path": str(self._path),
            "written": self.written,
            "dropped": self.dropped,
            "error": self.error,
        }

    def _failed(self, error: OSError) -> None:
        self.error = error.strerror or str(error)
        self._drop()
        log.error("recording %s: writing failed: %s; it ends here", self._path, self.error)


def _begin(file: IO[bytes], info: RecordingInfo) -> tuple[Writer, dict[str, int]]:
    """Write header, metadata, schemas and channels; they come first, so a cut file has them."""
    writer = Writer(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
    writer.start(profile="", library=LIBRARY)
    writer.add_metadata(METADATA, info.to_metadata())
    channels = {}
    for topic, properties in SCHEMAS.items():
        name = f"hri_predict.{topic.removeprefix('/').capitalize()}"
        schema = {"title": name, "type": "object", "properties": properties}
        schema_id = writer.register_schema(name, "jsonschema", json.dumps(schema).encode())
        channels[topic] = writer.register_channel(topic, "json", schema_id)
    return writer, channels
