"""An MCAP file being written, which stays readable even if its writer dies.

The library writes into memory. Finished data are written to disk at least each second, which limits
the loss of a killed writer. Data that the disk rejects stay in memory, so the file continues
without a gap when there is space again.
"""

import json
import os
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from hri_predict.recording.mcap.clocks import Reading, iso
from hri_predict.recording.mcap.format import to_json
from hri_predict.recording.mcap.info import LIBRARY, METADATA, RecordingInfo
from hri_predict.recording.mcap.items import Item
from hri_predict.recording.mcap.schemas import schemas

CHUNK_BYTES = 1024 * 1024
"""A chunk is compressed as a whole when it is full, or when it is time to write."""


class _Stream:
    """Output of the library: memory, from which ``push`` writes to the disk."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pending = bytearray()
        self._on_disk = 0

    def write(self, data: bytes) -> int:
        """Take it."""
        self._pending += data
        return len(data)

    def tell(self) -> int:
        """Return the position in the file, including data still in memory."""
        return self._on_disk + len(self._pending)

    def flush(self) -> None:
        """Do nothing: ``push`` writes."""

    def push(self) -> None:
        """Write all to the disk.

        Raises:
            OSError: the disk did not take all; the rest is kept.
        """
        while self._pending:
            count = os.write(self._descriptor, self._pending)
            del self._pending[:count]
            self._on_disk += count


class McapFile:
    """A recording's file.

    Attributes:
        path: its path.
        began: the clocks at its start.
        unsafe: messages that are not on the disk yet.

    Args:
        path: as above.
        descriptor: open for writing; closed by ``close``.
        info: facts that a replay needs.
        began: as above.
        clocks: name of the clocks, see ``Clocks``.
        sync: force each write to the disk, past the system's cache: a power failure also loses at
            most a second.

    Raises:
        OSError: it cannot be written.
    """

    def __init__(
        self,
        path: Path,
        descriptor: int,
        info: RecordingInfo,
        *,
        began: Reading,
        clocks: str,
        sync: bool = False,
    ) -> None:
        self.path, self.began, self.unsafe = path, began, 0
        self._descriptor, self._sync = descriptor, sync
        self._stream = _Stream(descriptor)
        out: Any = self._stream  # the library uses write, tell and flush
        self._writer = Writer(out, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._channels = self._begin(info, clocks)
        self._sequence = dict.fromkeys(self._channels, 0)
        self._stream.push()

    def _begin(self, info: RecordingInfo, clocks: str) -> dict[str, int]:
        """Write header, metadata, schemas and channels first, so a truncated file has them."""
        writer = self._writer
        writer.start(profile="", library=LIBRARY)
        began = {
            "clocks": clocks,
            "began_utc": iso(self.began.utc_ns),
            "began_utc_ns": str(self.began.utc_ns),
            "began_node_ns": str(self.began.node_ns),
            "began_boot_ns": str(self.began.boot_ns),
        }
        writer.add_metadata(METADATA, {**info.to_metadata(), **began})
        channels = {}
        for topic, schema in schemas([name for name, _ in info.robots]).items():
            data = json.dumps(schema).encode()
            schema_id = writer.register_schema(schema["title"], "jsonschema", data)
            channels[topic] = writer.register_channel(topic, "json", schema_id)
        return channels

    @property
    def size(self) -> int:
        """Bytes so far, without the chunk that is being filled."""
        return self._stream.tell()

    def add(self, item: Item, utc_ns: int) -> None:
        """Add a message; ``utc_ns`` is its time.

        Raises:
            Exception: it cannot be encoded; the file is as before.
        """
        args = (*item.args, utc_ns) if item.wants_utc else item.args
        self.write(item.topic, item.log_ns, utc_ns, item.encode(*args))

    def write(self, topic: str, node_ns: int, utc_ns: int, data: dict[str, Any] | bytes) -> None:
        """Add a message by its content, or by its JSON; see ``add``."""
        encoded = data if isinstance(data, bytes) else to_json(data)
        channel = self._channels[topic]
        self._sequence[topic] += 1
        self._writer.add_message(
            channel,
            log_time=max(0, utc_ns),
            data=encoded,
            publish_time=max(0, node_ns),
            sequence=self._sequence[topic],
        )
        self.unsafe += 1

    def push(self) -> None:
        """Write full chunks to the disk.

        Raises:
            OSError: as ``flush``.
        """
        self._stream.push()

    def flush(self) -> None:
        """Flush everything to the disk.

        Raises:
            OSError: the disk did not take it; it is kept, and the next flush tries again.
        """
        self._writer.flush()
        self._push()

    def finish(self) -> None:
        """Write the summary; nothing may be added after it.

        Raises:
            OSError: the disk did not take it; the file can be read all the same.
        """
        self._writer.finish()
        self._push()

    def close(self) -> None:
        """Close the file as it is."""
        os.close(self._descriptor)

    def _push(self) -> None:
        self.push()
        if self._sync:
            os.fdatasync(self._descriptor)
        self.unsafe = 0
