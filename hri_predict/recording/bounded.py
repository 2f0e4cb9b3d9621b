"""Reads files of unknown origin into memory, up to a limit, and reports progress."""

import codecs
import zipfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TypeVar

from hri_predict.base.errors import RecordingError

MAX_BYTES = 2**30  # of a file, and of the joint positions read from it
T = TypeVar("T")
READING, WRITING = "reading", "writing"
_HEAD = 4096
_EACH = 500
"""Number of items between two reports."""
_watcher: ContextVar[Callable[[str, int, int], None] | None] = ContextVar("watcher", default=None)
_MARKS = (
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF32_LE, "utf-32-le"),  # before UTF-16, whose mark begins alike
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)


def names_in_zip(path: Path) -> list[str] | None:
    """Return the names of a zip archive's entries; ``None`` for other or unreadable files."""
    try:
        with zipfile.ZipFile(path) as archive:
            return archive.namelist()
    except (OSError, ValueError, NotImplementedError, zipfile.BadZipFile):
        return None


def read_bounded(path: Path) -> bytes:
    """The whole file.

    Raises:
        RecordingError: it is larger than ``MAX_BYTES``.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        data = file.read(MAX_BYTES + 1)
    if len(data) > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: larger than {MAX_BYTES / 2**30:g} GiB; cut it into parts"
        )
    return data


def read_text(path: Path, what: str) -> str:
    """Return the whole file as text, with line feeds as line ends.

    UTF-8 and UTF-16 with or without a byte order mark, or else one byte per character, as old
    programs write.

    Raises:
        RecordingError: too large, or not text.
        OSError: it cannot be read.
    """
    text = decoded(read_bounded(path))
    if "\0" in text[:_HEAD]:
        raise RecordingError(f"recording {path}: not {what} (not text)")
    return text.replace("\r\n", "\n").replace("\r", "\n")


def decoded(data: bytes) -> str:
    """Decode text of unknown encoding; any bytes give some text, possibly with NUL characters."""
    for mark, encoding in _MARKS:
        if data.startswith(mark):
            return data[len(mark) :].decode(encoding, "replace")
    head = data[:_HEAD]
    if b"\0" in head:  # UTF-16 without a mark: of ASCII, every second byte is zero
        for first, encoding in ((1, "utf-16-le"), (0, "utf-16-be")):
            if not any(head[first::2]) and all(head[1 - first :: 2]):
                return data.decode(encoding, "replace")
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def watched(items: Iterable[T], what: str, total: int) -> Iterator[T]:
    """Yield all items, and regularly report the number done to ``watching``, if it is on.

    Args:
        items: rows or scenes.
        what: the activity: ``READING`` or ``WRITING``.
        total: their approximate number.
    """
    watcher = _watcher.get()
    for done, item in enumerate(items):
        if watcher is not None and done % _EACH == 0:
            watcher(what, done, total)
        yield item


@contextmanager
def watching(watcher: Callable[[str, int, int], None]) -> Iterator[None]:
    """Report the progress of long loops to ``watcher`` (activity, number done, total)."""
    before = _watcher.set(watcher)
    try:
        yield
    finally:
        _watcher.reset(before)


def check_joints(path: Path, frames: int, people: int, joints: int) -> None:
    """Reject recordings that would fill the memory.

    Raises:
        RecordingError: more than ``MAX_BYTES`` of joint positions.
    """
    if frames * people * joints * 24 > MAX_BYTES:
        raise RecordingError(
            f"recording {path}: {frames} frames of {people} people with {joints} joints are too "
            f"many to hold; cut it into parts"
        )
