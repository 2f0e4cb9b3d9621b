"""Which of a folder's files are a cell's own, and which of them give way."""

import contextlib
import os
import re
import stat
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from hri_predict.recording.mcap.info import LIBRARY

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
    """The name of a file; ``number`` tells those of one second apart."""
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

    A wall clock that is wrong by years must not cost everything before it is noticed: what is
    old is so for the newest file, too.
    """
    if days is None or not files:
        return []
    now = min(now, files[-1].began)
    old = [kept for kept in files if (now - kept.began).total_seconds() > days * 86400]
    return old[:most]


def over_budget(files: Sequence[Kept], budget_bytes: float) -> list[Kept]:
    """The oldest, so that the rest fit."""
    total = sum(kept.size for kept in files)
    gone = []
    for kept in files:
        if total <= budget_bytes:
            break
        total -= kept.size
        gone.append(kept)
    return gone


def _is_ours(path: Path) -> bool:
    """Whether the file begins as this node's recordings do."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        head = os.read(descriptor, _HEAD_BYTES)
    finally:
        os.close(descriptor)
    return head.startswith(_MAGIC) and LIBRARY.encode() in head
