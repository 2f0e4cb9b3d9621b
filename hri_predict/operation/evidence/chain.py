"""Log of all events, in which every line holds the hash of the previous line.

Changing, removing or inserting a line, or changing a file named in a line, breaks the chain from
there on. If lines at the end are removed, the remaining chain is still valid; so note the newest
hash elsewhere, as the node does when it stops. The chain has no key: it reveals damage and careless
editing, but not a forger who rewrites all of it.

A full log gets a number, and the chain continues in a new log whose first line names the full one.
So a node starts as fast after years as on its first day.
"""

import errno
import hashlib
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any, TypeGuard

from hri_predict.base.errors import RecordingError

LOG = "evidence.jsonl"
START = "0" * 64
"""Value in the first line instead of a previous line's hash."""
MAX_LINE = 100_000
FULL_BYTES = 10_000_000
"""Size in bytes from which on a log is full and takes no more lines."""
_CHUNK = 1 << 20
_NUMBERED = re.compile(r"evidence-([0-9]{6,9})\.jsonl")


@dataclass(frozen=True, slots=True)
class Line:
    """A line: its log, its line number from 1, its data, and the fault of the line or its file, if
    any.
    """

    log: str
    number: int
    data: dict[str, Any]
    wrong: str = ""


def hash_of(entry: dict[str, Any]) -> str:
    """SHA-256 of an entry without its own ``hash``, as JSON with sorted keys."""
    data = {key: value for key, value in entry.items() if key != "hash"}
    text = json.dumps(data, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()


def file_hash(path: Path) -> str:
    """SHA-256 of a file.

    Raises:
        OSError: it cannot be read.
    """
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            digest.update(chunk)
    return digest.hexdigest()


def append(folder: Path, entry: dict[str, Any], previous: str) -> str:
    """Append an entry after the entry with hash ``previous``; return the new entry's hash.

    A last line that lost only its end, as after a power failure, is ended first.

    Raises:
        OSError: the log cannot be written.
    """
    linked = {**entry, **_continued(folder), "previous": previous}
    linked["hash"] = hash_of(linked)
    data = (json.dumps(linked) + "\n").encode()
    with (folder / LOG).open("a+b", buffering=0) as file:
        whole = file.seek(0, os.SEEK_END)
        if whole:
            file.seek(-1, os.SEEK_END)
            data = data if file.read(1) == b"\n" else b"\n" + data
        try:
            if file.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(file.fileno())
        except OSError:
            file.truncate(whole)  # half a line would break the chain for all that follow
            raise
    return str(linked["hash"])


def exists(folder: Path) -> bool:
    """Whether the folder contains a log."""
    return (folder / LOG).exists() or bool(_older(folder))


def _continued(folder: Path) -> dict[str, str]:
    """Give a full log its number; return the fields about it for the first line of the new log."""
    path, older = folder / LOG, _older(folder)
    if _bytes_of(path) >= FULL_BYTES:
        number = 1 + (_number(older[-1]) if older else 0)
        older.append(path.rename(folder / f"evidence-{number:06d}.jsonl"))
    return {} if _bytes_of(path) or not older else {"continues": older[-1].name}


def _bytes_of(path: Path) -> int:
    """Return the size; 0 without a file. An empty log counts as missing: the node was killed, or
    the disk was full.
    """
    return path.stat().st_size if path.exists() else 0


def _older(folder: Path) -> list[Path]:
    """Return the full logs, oldest first."""
    found = (p for p in folder.glob("evidence-*.jsonl") if _NUMBERED.fullmatch(p.name))
    return sorted((p for p in found if p.is_file() and not p.is_symlink()), key=_number)


def _number(log: Path) -> int:
    return int(log.stem.rpartition("-")[2])


def newest(folder: Path) -> str:
    """Return the hash to continue with, which is the last line's; ``START`` without a log.

    Only the newest log is read.

    Raises:
        RecordingError: the log is broken; the message says where.
    """
    logs = [path for path in (*_older(folder), folder / LOG) if _bytes_of(path)]
    last = START
    for line in _lines(logs[-1]) if logs else ():
        if line.wrong:
            raise RecordingError(f"evidence {logs[-1]}, line {line.number}: {line.wrong}")
        last = line.data["hash"]
    return last


def set_aside(folder: Path, now: datetime) -> str:
    """Rename a broken log so that a new one can start; return its new name.

    A full log keeps its name: the new log's first line then visibly does not follow it.

    Raises:
        OSError: it cannot be renamed.
    """
    if not (folder / LOG).exists():
        return _older(folder)[-1].name
    name = f"evidence-{now:%Y%m%dT%H%M%S}Z.broken.jsonl"
    (folder / LOG).rename(folder / name)
    return name


def read(folder: Path) -> Iterator[Line]:
    """Yield all lines of all logs, each checked against the previous line and its file.

    A file may be missing if a later line records that it was removed to make room.

    Raises:
        RecordingError: a log cannot be read.
    """
    lines, last, before = [], START, ""
    for path in (*_older(folder), folder / LOG):
        for line in _lines(path, last, before):
            lines.append(line)
            last = str(line.data.get("hash"))
        before = path.name
    removed = {name: at for at, line in enumerate(lines) for name in _removed(line.data)}
    for at, line in enumerate(lines):
        if line.wrong or removed.get(str(line.data.get("file")), 0) > at:
            yield line
        else:
            yield replace(line, wrong=_wrong_file(folder, line.data))


def _lines(path: Path, expected: str | None = None, before: str | None = None) -> Iterator[Line]:
    """Yield the lines of one log.

    Args:
        path: the log.
        expected: hash of the previous line; ``None`` accepts the first line's value.
        before: name of the previous log, "" if there is none; ``None`` accepts the first line's
            value.
    """
    try:
        raw = path.read_bytes().split(b"\n")
    except FileNotFoundError:
        return
    except OSError as error:
        raise RecordingError(f"evidence {path}: {error.strerror}") from error
    if raw and not raw[-1]:
        raw.pop()
    for number, text in enumerate(raw, 1):
        entry = _parsed(text)
        if entry is None:
            yield Line(path.name, number, {}, "is not an entry of this log")
            expected = ""  # what no line says
            continue
        continues = str(entry.get("continues", ""))
        if expected is None:
            expected = str(entry.get("previous")) if continues else START
        wrong = _wrong(entry, expected)
        if number == 1 and before is not None and continues != before:
            wrong = (
                f"continues {continues or 'no log'}, where {before or 'no log'} is the previous log"
            )
        yield Line(path.name, number, entry, wrong)
        expected = str(entry.get("hash"))


def _parsed(text: bytes) -> dict[str, Any] | None:
    if len(text) > MAX_LINE:
        return None
    try:
        entry = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None


def _removed(entry: dict[str, Any]) -> list[str]:
    names = entry.get("removed")
    return [str(name) for name in names] if isinstance(names, list) else []


def _wrong(entry: dict[str, Any], expected: str) -> str:
    try:
        changed = entry.get("hash") != hash_of(entry)
    except (ValueError, RecursionError):
        changed = True
    if changed:
        return "was changed"
    if entry.get("previous") != expected:
        return "does not follow the previous line"
    return ""


def _is_plain(name: object) -> TypeGuard[str]:
    return isinstance(name, str) and bool(re.fullmatch(r"[A-Za-z0-9._-]+\.mcap", name))


def _wrong_file(folder: Path, entry: dict[str, Any]) -> str:
    name = entry.get("file")
    if name is None:
        return ""
    if not _is_plain(name):
        return f"does not name a file of this folder, {name!r}"
    path = folder / name
    try:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            return f"its file {name} is not a file"
        found = file_hash(path)
    except OSError as error:
        return f"its file {name} cannot be read: {error.strerror}"
    return "" if found == entry.get("sha256") else f"its file {name} was changed"
