"""Non-blocking standard error: a slow reader never delays the node.

Its reader may stop: Ctrl-S on a terminal, a pager, a journal that hangs. A write then waits
for ever, and the loop's thread writes to the log, too. So a thread of its own writes what others
hand over; what does not fit is dropped and counted.
"""

import io
import os
import select
import threading
from collections import deque
from typing import TextIO

MOST_BYTES = 1 << 20
"""Maximum number of bytes that wait."""
FAREWELL_S = 1.0
"""Time to write what waits when the run ends."""
RETRY_S = 0.2


class Unhurried(io.TextIOBase):
    """Takes text at once; a thread writes it to ``stream``'s file, in order.

    Attributes:
        lost: lines that were dropped, or could not be written.
    """

    def __init__(self, stream: TextIO) -> None:
        super().__init__()
        stream.flush()
        self._stream, self._file = stream, stream.fileno()
        self.lost = 0
        self._untold = 0
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._ended = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._work, name="standard error", daemon=True)
        self._thread.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """That of the stream."""
        return self._stream.encoding or "utf-8"

    def writable(self) -> bool:
        """It takes text."""
        return True

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """The stream's file."""
        return self._file

    def write(self, text: str) -> int:
        """Take ``text``; never waits for its reader."""
        data = text.encode(self.encoding, "backslashreplace")
        with self._changed:
            if self._bytes + len(data) > MOST_BYTES:
                self._lose(data)
            elif data:
                self._waiting.append(data)
                self._bytes += len(data)
                self._changed.notify()
        return len(text)

    def flush(self) -> None:
        """Nothing: the thread writes as soon as it can."""

    def end(self, timeout_s: float | None = None) -> bool:
        """Write what waits, no longer than this (``FAREWELL_S``); return whether all is out."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self._thread.join(FAREWELL_S if timeout_s is None else timeout_s)
        return not self._thread.is_alive()

    def _lose(self, data: bytes) -> None:
        lines = data.count(b"\n")
        self.lost += lines
        self._untold += lines

    def _work(self) -> None:
        while True:
            with self._changed:
                while not self._waiting and not self._ended:
                    self._changed.wait()
                if not self._waiting:
                    return
                data = b"".join(self._waiting)
                self._waiting.clear()
            rest = self._written(data)
            with self._changed:
                self._bytes -= len(data)
                if rest:
                    self._lose(rest)
                elif self._untold:
                    notice = f"warning: lines were lost, unread: {self._untold}\n"
                    self._waiting.appendleft(notice.encode())
                    self._bytes += len(notice)
                    self._untold = 0

    def _written(self, data: bytes) -> bytes:
        """Write; return what the file refuses."""
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:  # another program made the file so
                select.select([], [self._file], [], RETRY_S)
            except OSError:  # the disk is full, or the reader has gone
                return data
        return b""
