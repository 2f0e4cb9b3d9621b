"""Paths of a recording's files, and the start of the next one: one file of a given name."""

import fcntl
import logging
import os
import stat
from pathlib import Path
from typing import Protocol

from hri_predict.base.errors import RecordingError
from hri_predict.base.files import refuse_named_pipe
from hri_predict.recording.mcap.clocks import Reading
from hri_predict.recording.mcap.file import McapFile

log = logging.getLogger(__name__)


class RecordingFiles(Protocol):
    """Provides files for a recorder; after the start, only the recorder's thread calls it."""

    @property
    def name(self) -> Path:
        """The file or folder, as the user knows it."""

    def open(self, at: Reading) -> tuple[Path, int]:
        """A new file and its descriptor.

        Raises:
            OSError: there is none to be had now.
        """

    def discard(self, path: Path) -> None:
        """Remove a file from ``open`` into which nothing could be written; keep what is not new."""

    @property
    def has_many(self) -> bool:
        """Whether it provides another file after one is finished or broken."""

    def wants_next(self, file: McapFile, now: Reading, stepped: bool) -> bool:
        """Whether the file is finished; ``stepped``: the wall clock was set, or stood still."""

    def why_not(self, writing: Path | None) -> str:
        """Return why nothing may be recorded now, after making room; "" if it may."""

    def close(self) -> None:
        """Release resources: no more files are needed."""


class OneFile:
    """A file named by the user, which is written only once.

    Args:
        path: the file.
        overwrite: replace a file that is there.
    """

    def __init__(self, path: Path, overwrite: bool = False) -> None:
        self._path, self._overwrite = path, overwrite
        self._is_new = False

    @property
    def name(self) -> Path:
        """The file."""
        return self._path

    def open(self, at: Reading) -> tuple[Path, int]:
        """Create it, with a lock that its descriptor holds.

        Raises:
            RecordingError: it is there already, or another node records there.
            OSError: it cannot be created.
        """
        refuse_named_pipe(self._path)
        is_device = _is_device(self._path)
        exclusive = 0 if self._overwrite or is_device else os.O_EXCL
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC | exclusive
            descriptor = os.open(self._path, flags, 0o644)
        except FileExistsError as error:
            raise RecordingError(
                f"recording {self._path}: already exists, and is kept; name another file or a "
                f"folder, or add --overwrite"
            ) from error
        self._is_new = bool(exclusive)
        if not is_device:
            self._empty(descriptor)
        return self._path, descriptor

    def _empty(self, descriptor: int) -> None:
        """Lock the file before its old content goes, which another node may be writing."""
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            os.close(descriptor)
            raise RecordingError(
                f"recording {self._path}: another node records there; name another file, or stop "
                f"that node"
            ) from error
        except OSError as error:  # a file system without locks
            log.debug("recording %s: cannot be locked: %s", self._path, error)
        os.truncate(descriptor, 0)

    def discard(self, path: Path) -> None:
        """Remove the file if ``open`` created it, never a device or a file to overwrite."""
        if self._is_new:
            path.unlink(missing_ok=True)

    has_many = False

    def wants_next(self, file: McapFile, now: Reading, stepped: bool) -> bool:
        """Never."""
        return False

    def why_not(self, writing: Path | None) -> str:
        """Return "": recording is always possible."""
        return ""

    def close(self) -> None:
        """Do nothing."""


def beside(path: Path) -> Path:
    """``day.mcap``, or ``day-2.mcap`` where that exists: for a node that starts again."""
    found, number = path, 1
    while os.path.lexists(found) and not _is_device(found):
        number += 1
        found = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return found


def _is_device(path: Path) -> bool:
    try:
        return not stat.S_ISREG(os.stat(path).st_mode)
    except OSError:
        return False
