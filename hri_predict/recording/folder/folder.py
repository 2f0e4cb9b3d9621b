"""A folder for years of recordings."""

import contextlib
import errno
import fcntl
import logging
import os
import re
import shutil
import stat
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from hri_predict.base.errors import ConfigError, OsErrorAs
from hri_predict.recording.folder.settings import RecordSettings
from hri_predict.recording.mcap.clocks import Reading
from hri_predict.recording.mcap.file import McapFile
from hri_predict.recording.mcap.info import LIBRARY

# -- which of a folder's files are a cell's own, and which of them give way ------------------------

_MAGIC = b"\x89MCAP0\r\n\x01"  # and the opcode of the header, which names the library
_HEAD_BYTES = 128


@dataclass(frozen=True, slots=True, kw_only=True)
class Kept:
    """A recording in the folder: ``began`` as its name says, ``size`` in bytes."""

    path: Path
    began: datetime
    number: int
    size: int


def name_of(cell: str, began: datetime, number: int = 1) -> str:
    """Return the name of a file; ``number`` distinguishes files of the same second."""
    more = f"-{number}" if number > 1 else ""
    return f"{cell}-{began:%Y%m%dT%H%M%SZ}{more}.mcap"


def own_files(folder: Path, cell: str) -> list[Kept]:
    """The cell's recordings, oldest first: by name, and plain files that this node has begun.

    A file that was renamed does not count, and stays.

    Raises:
        OSError: the folder cannot be read.
    """
    pattern = re.compile(rf"{re.escape(cell)}-(\d{{8}}T\d{{6}})Z(?:-(\d+))?\.mcap", re.ASCII)
    found = []
    for name in os.listdir(folder):
        matched = pattern.fullmatch(name)
        if matched is None:
            continue
        path = folder / name
        with contextlib.suppress(OSError, ValueError):  # it may vanish, or name no date
            began = datetime.strptime(matched[1], "%Y%m%dT%H%M%S").replace(tzinfo=UTC)
            about = os.lstat(path)
            if stat.S_ISREG(about.st_mode) and _is_ours(path):
                number = int(matched[2] or 1)
                found.append(Kept(path=path, began=began, number=number, size=about.st_size))
    return sorted(found, key=lambda kept: (kept.began, kept.number))


def too_old(files: Sequence[Kept], now: datetime, days: float | None, most: int) -> list[Kept]:
    """Those of ``files``, oldest first, that began more than ``days`` ago, ``most`` at most.

    A wall clock that is wrong by years must not delete everything: age is measured also against the
    newest file.
    """
    if days is None or not files:
        return []
    now = min(now, files[-1].began)
    old = [kept for kept in files if (now - kept.began).total_seconds() > days * 86400]
    return old[:most]


def over_budget(files: Sequence[Kept], budget_bytes: float) -> list[Kept]:
    """Return the oldest files to remove, so that the rest fit."""
    total = sum(kept.size for kept in files)
    gone = []
    for kept in files:
        if total <= budget_bytes:
            break
        total -= kept.size
        gone.append(kept)
    return gone


def _is_ours(path: Path) -> bool:
    """Whether the file starts like this node's recordings."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        head = os.read(descriptor, _HEAD_BYTES)
    finally:
        os.close(descriptor)
    return head.startswith(_MAGIC) and LIBRARY.encode() in head


# --------------------------------------------------------------------------------------------------

log = logging.getLogger(__name__)

MOST_OLD = 2
"""Maximum number of files removed at a time for their age: see ``too_old``."""


def free_bytes(folder: Path) -> int:
    """Return the space on the folder's disk available to users other than root."""
    return shutil.disk_usage(folder).free


class Folder:
    """Gives a recorder files by cell and UTC, and removes the cell's oldest.

    See ``hri_predict.recording.mcap.places.RecordingFiles``.

    Args:
        folder: its path; it is created.
        cell: its name; one node at a time records a cell into a folder.
        settings: see ``RecordSettings``.
        free: room on the disk, bytes.

    Attributes:
        removed: files removed to make room.

    Raises:
        ConfigError: the folder cannot be used, or another node records this cell there.
    """

    has_many = True

    def __init__(
        self,
        folder: Path,
        cell: str,
        settings: RecordSettings,
        *,
        free: Callable[[Path], int] = free_bytes,
    ) -> None:
        self._folder, self._cell, self._settings, self._free = folder, cell, settings, free
        self.removed = 0
        with OsErrorAs(ConfigError, f"record.folder {folder}", "name another folder"):
            folder.mkdir(parents=True, exist_ok=True)
            self._lock = self._locked()

    @property
    def name(self) -> Path:
        """The folder."""
        return self._folder

    def open(self, at: Reading) -> tuple[Path, int]:
        """Return a new file, after making room for its maximum size.

        Raises:
            OSError: it cannot be created, or there is no room.
        """
        settings = self._settings
        self._folder.mkdir(parents=True, exist_ok=True)
        began = datetime.fromtimestamp(at.utc_ns // 1_000_000_000, UTC)
        files = own_files(self._folder, self._cell)
        old = too_old(files, began, settings.keep_days, MOST_OLD)
        left = [kept for kept in files if kept not in old]
        room = settings.budget_gb * 1e9 - settings.max_mb * 1e6
        self._remove([*old, *over_budget(left, room)])
        number = 1
        while True:
            path = self._folder / name_of(self._cell, began, number)
            try:
                flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
                return path, os.open(path, flags, 0o644)
            except FileExistsError:  # two in a second, or the wall clock was set back
                number += 1

    def discard(self, path: Path) -> None:
        """Remove a file into which nothing could be written: each try would leave one."""
        path.unlink(missing_ok=True)

    def limit(self, settings: RecordSettings) -> None:
        """Apply the limits of ``settings`` from now on; may be called from any thread."""
        self._settings = settings

    def wants_next(self, file: McapFile, now: Reading, stepped: bool) -> bool:
        """Whether the file has reached its limit or was removed, or the wall clock was set."""
        lasted_s = (now.node_ns - file.began.node_ns) * 1e-9
        return (
            stepped
            or lasted_s >= self._settings.max_minutes * 60
            or file.size >= self._settings.max_mb * 1e6
            or not os.path.lexists(file.path)
        )

    def why_not(self, writing: Path | None) -> str:
        """Return why recording must pause (low disk space), after removing old files."""
        wanted = self._settings.min_free_gb * 1e9
        try:
            missing = wanted - self._free(self._folder)
            if missing <= 0:
                return ""
            files = [kept for kept in own_files(self._folder, self._cell) if kept.path != writing]
            total = sum(kept.size for kept in files)
            self._remove(over_budget(files, total - missing))
            if self._free(self._folder) >= wanted:
                return ""
        except OSError as error:
            return f"{self._folder}: {error.strerror}"
        return f"less than {self._settings.min_free_gb:g} GB free (min_free_gb)"

    def close(self) -> None:
        """Release the folder for another node."""
        os.close(self._lock)

    def _remove(self, files: Sequence[Kept]) -> None:
        for kept in files:
            try:
                kept.path.unlink()
            except OSError as error:
                log.warning("recording %s: cannot be removed: %s", kept.path, error.strerror)
                continue
            self.removed += 1
            log.info("recording %s: removed to make room", kept.path)

    def _locked(self) -> int:
        """The lock of this cell in the folder.

        Raises:
            OSError: another node has it, or the folder cannot be written.
        """
        path = self._folder / f".{self._cell}.lock"
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(descriptor)
            why = f"another node records '{self._cell}' there"
            raise OSError(errno.EBUSY, why) from error
        return descriptor
