"""The log: rate-limited lines of text or JSON on standard error.

This module imports nothing slow, because every command starts with it.
"""

import contextlib
import io
import json
import logging
import os
import select
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, TextIO, cast

# -- non-blocking standard error: a slow reader never delays the node ------------------------------
#
# Its reader may stop: Ctrl-S on a terminal, a pager, a journal that hangs. A write then waits for
# ever, and the loop's thread writes to the log, too. So a thread of its own writes what others
# hand over; what does not fit is dropped and counted.

MOST_BYTES = 1 << 20
"""Maximum number of queued bytes."""
FAREWELL_S = 1.0
"""Maximum time to write the queue when the run ends."""
RETRY_S = 0.2


class Unhurried(io.TextIOBase):
    """Accepts text without waiting; a thread writes it in order to the file of ``stream``.

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
        """The stream's encoding."""
        return self._stream.encoding or "utf-8"

    def writable(self) -> bool:
        """Always true: the stream accepts text."""
        return True

    def isatty(self) -> bool:
        """Whether the stream is a terminal."""
        return self._stream.isatty()

    def fileno(self) -> int:
        """The stream's file."""
        return self._file

    def write(self, text: str) -> int:
        """Queue ``text``; never waits for the reader."""
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
        """Do nothing: the thread writes as soon as it can."""

    def end(self, timeout_s: float | None = None) -> bool:
        """Write the queue within ``timeout_s`` (default: ``FAREWELL_S``).

        Returns:
            Whether all of it was written.
        """
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
        """Write; return the part that the file did not accept."""
        while data:
            try:
                data = data[os.write(self._file, data) :]
            except BlockingIOError:  # another program made the file so
                select.select([], [self._file], [], RETRY_S)
            except OSError:  # the disk is full, or the reader has gone
                return data
        return b""


# --------------------------------------------------------------------------------------------------

LINES_A_MINUTE = 30
WINDOW_S = 60.0
MOST_MESSAGES = 256
"""Maximum number of different messages counted at a time; above it, the oldest is forgotten."""
_SYSLOG = ((logging.CRITICAL, 2), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6))

Key = tuple[str, int, str]


class Line(logging.Formatter):
    """``12:03:07.512Z warning: ...``: UTC, as in alerts, recordings and ``explain --at``.

    In the journal, which stores the time itself, a line starts with the severity.
    """

    def __init__(self, with_time: bool = True) -> None:
        super().__init__()
        self._with_time = with_time

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the line without a traceback."""
        line = f"{record.levelname.lower()}: {record.message}"
        if not self._with_time:
            return line
        at = time.strftime("%H:%M:%S", time.gmtime(record.created))
        return f"{at}.{min(int(record.msecs), 999):03d}Z {line}"


class JsonLine(logging.Formatter):
    """One JSON object: ``time`` (UTC), ``severity``, ``logger``, ``message``, optionally
    ``error``.
    """

    def format(self, record: logging.LogRecord) -> str:
        """Return the object as one line."""
        at = datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds")
        said = {
            "time": at.replace("+00:00", "Z"),
            "severity": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            said["error"] = self.formatException(record.exc_info)
        return json.dumps(said)


class RateLimit:
    """Limits the lines per message and minute; further lines are counted.

    Attributes:
        left_out: number of lines left out since the start.
    """

    def __init__(
        self, lines: int = LINES_A_MINUTE, monotonic_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.lines, self._monotonic_s = lines, monotonic_s
        self.left_out = 0
        self._windows: dict[Key, list[float]] = {}  # key -> its window's start, lines in it

    def takes(self, key: Key) -> bool:
        """Whether a line of this message may be written now; call ``over`` first."""
        window = self._windows.setdefault(key, [self._monotonic_s(), 0])
        window[1] += 1
        self.left_out += window[1] > self.lines
        return window[1] <= self.lines

    def over(self, everything: bool = False) -> list[tuple[Key, int]]:
        """Return the messages whose minute is over and that had lines left out, with their
        number.
        """
        now_s = self._monotonic_s()
        ended = [
            key
            for i, (key, (start_s, _)) in enumerate(self._windows.items())
            if everything
            or now_s - start_s >= WINDOW_S
            or i < len(self._windows) - MOST_MESSAGES + 1
        ]
        counts = [(key, int(self._windows.pop(key)[1]) - self.lines) for key in ended]
        return [(key, count) for key, count in counts if count > 0]


class Log(logging.StreamHandler[TextIO]):
    """Writes the log to a stream.

    In systemd's journal each line starts with its severity, such as ``<4>``.

    Attributes:
        failures: lines that could not be written, for example because the disk is full.
    """

    def __init__(
        self,
        stream: TextIO,
        *,
        in_journal: bool = False,
        monotonic_s: Callable[[], float] = time.monotonic,
    ) -> None:
        super().__init__(stream)
        self._in_journal = in_journal
        self.limit = RateLimit(monotonic_s=monotonic_s)
        self.failures = 0
        self.say_as("text")

    def say_as(self, form: str) -> None:
        """Set the format: ``text`` or ``json``."""
        self.setFormatter(JsonLine() if form == "json" else Line(not self._in_journal))

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record, preceded by reports of lines left out in past minutes."""
        self._tell_left_out(self.limit.over())
        if self.limit.takes((record.name, record.levelno, str(record.msg))):
            super().emit(record)

    def format(self, record: logging.LogRecord) -> str:
        """Return the record's lines in the stream's format."""
        text = super().format(record)
        if not self._in_journal:
            return text
        prefix = f"<{severity(record.levelno)}>"
        return "\n".join(prefix + line for line in text.splitlines())

    def handleError(self, record: logging.LogRecord) -> None:
        """Count a line that could not be written, because it cannot be reported."""
        self.failures += 1

    def close(self) -> None:
        """Report lines left out that were not reported yet."""
        self._tell_left_out(self.limit.over(everything=True))
        super().close()

    def _tell_left_out(self, counts: list[tuple[Key, int]]) -> None:
        for (name, level, message), count in counts:
            args = (count, message)
            told = logging.LogRecord(name, level, "", 0, "left out %d lines like: %s", args, None)
            super().emit(told)


def severity(level: int) -> int:
    """Return a level's number in syslog and the journal (RFC 5424, table 2)."""
    return next((number for least, number in _SYSLOG if level >= least), 7)


def in_journal(stream: TextIO, environ: Mapping[str, str] = os.environ) -> bool:
    """Whether systemd connected this stream to its journal."""
    try:
        there = os.fstat(stream.fileno())
    except (OSError, ValueError, AttributeError):
        return False
    return environ.get("JOURNAL_STREAM") == f"{there.st_dev}:{there.st_ino}"


_current: list[Log] = []
_waiting_for_nobody: list[Unhurried] = []


def set_up(stream: TextIO | None = None) -> Log:
    """Write the log to ``stream`` (default: standard error) as text, starting at severity
    warning.
    """
    stream = stream or sys.stderr
    log = Log(stream, in_journal=in_journal(stream))
    logging.basicConfig(level=logging.WARNING, handlers=[log])
    _current[:] = [log]
    return log


def use(settings: Any) -> None:
    """Apply ``LogSettings`` to the log; without ``set_up`` (in a library), apply only the level."""
    usual = settings.level == "warning"  # the level of all loggers, other packages' too
    for name in ("hri_predict", "hri_drivers", "hri_sim"):
        level = logging.NOTSET if usual else logging.getLevelName(settings.level.upper())
        logging.getLogger(name).setLevel(level)
    for log in _current:
        log.say_as(settings.format)
        log.limit.lines = settings.rate


@contextlib.contextmanager
def unhurried() -> Iterator[None]:
    """In this context, writing to the log and to ``sys.stderr`` never waits for the reader.

    If the reader is still stuck at the end, writing remains non-blocking so that the program can
    exit.
    """
    before = sys.stderr
    try:
        taken = Unhurried(before)
    except (AttributeError, OSError, ValueError):  # no file: a test's, or none at all
        yield
        return
    _waiting_for_nobody[:] = [taken]
    _write_to(cast(TextIO, taken), instead_of=before)
    try:
        yield
    finally:
        if taken.end():
            _write_to(before, instead_of=cast(TextIO, taken))


def _write_to(stream: TextIO, instead_of: TextIO) -> None:
    if sys.stderr is instead_of:
        sys.stderr = stream
    for log in _current:
        if log.stream is instead_of:
            log.setStream(stream)


def counters() -> dict[str, int]:
    """Return the numbers of lines that were left out and that could not be written."""
    lost = sum(log.failures for log in _current) + sum(each.lost for each in _waiting_for_nobody)
    left_out = sum(log.limit.left_out for log in _current)
    return {"log_lines_left_out": left_out, "log_lines_lost": lost}
