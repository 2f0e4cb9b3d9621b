"""The log of all events, in which every line holds the hash of the line before.

Whoever changes, removes or inserts a line, or changes a file that a line names, breaks the chain
from there on. Lines cut off at the end leave a chain that is whole but shorter: so note the newest
hash elsewhere, as the node does when it ends. The chain has no key: it shows damage and careless
editing, not a forger who writes all of it anew.
"""

import errno
import hashlib
import json
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, TypeGuard

from hri_predict.errors import RecordingError

LOG = "evidence.jsonl"
START = "0" * 64
"""What the first line has instead of the hash of a line before."""
MAX_LINE = 100_000
_CHUNK = 1 << 20


@dataclass(frozen=True, slots=True)
class Line:
    """A line of the log: its number from 1, its data, and what is wrong with it or its file."""

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
    """Add an entry after the one with hash ``previous``; return its own hash.

    Raises:
        OSError: the log cannot be written.
    """
    linked = {**entry, "previous": previous}
    linked["hash"] = hash_of(linked)
    data = (json.dumps(linked) + "\n").encode()
    with (folder / LOG).open("ab", buffering=0) as file:
        whole = file.tell()
        try:
            if file.write(data) != len(data):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            os.fsync(file.fileno())
        except OSError:
            file.truncate(whole)  # half a line would break the chain for all that follow
            raise
    return str(linked["hash"])


def sizes(folder: Path) -> dict[str, int]:
    """Name -> bytes of each file that the log names and that is there, the oldest first."""
    named = [line.data.get("file") for line in read(folder, files=False) if not line.wrong]
    paths = {name: folder / name for name in named if _is_plain(name)}
    return {n: p.stat().st_size for n, p in paths.items() if p.is_file() and not p.is_symlink()}


def newest(folder: Path) -> str:
    """The hash to continue with: that of the last line; ``START`` without a log.

    Raises:
        RecordingError: the log is broken; says where.
    """
    last = START
    for line in read(folder, files=False):
        if line.wrong:
            raise RecordingError(f"evidence {folder / LOG}, line {line.number}: {line.wrong}")
        last = line.data["hash"]
    return last


def set_aside(folder: Path, now: datetime) -> str:
    """Give a broken log another name, which is returned, so that a new one can begin.

    Raises:
        OSError: it cannot be renamed.
    """
    name = f"evidence-{now:%Y%m%dT%H%M%S}Z.broken.jsonl"
    (folder / LOG).rename(folder / name)
    return name


def read(folder: Path, *, files: bool = True) -> Iterator[Line]:
    """All lines, each compared with the one before and, if ``files``, with its file.

    A file that a later line says was removed to make room need not be there.

    Raises:
        RecordingError: the log cannot be read.
    """
    try:
        with (folder / LOG).open("rb") as file:
            raw = file.read().split(b"\n")
    except FileNotFoundError:
        return
    except OSError as error:
        raise RecordingError(f"evidence {folder / LOG}: {error.strerror}") from error
    if raw and not raw[-1]:
        raw.pop()
    entries = [_parsed(text) for text in raw]
    removed = {name for e in entries if e is not None for name in _removed(e)}
    expected = START
    for number, entry in enumerate(entries, 1):
        if entry is None:
            yield Line(number, {}, "is not an entry of this log")
            expected = ""
            continue
        wrong = _wrong(entry, expected)
        if files and not wrong:
            wrong = _wrong_file(folder, entry, removed)
        yield Line(number, entry, wrong)
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
        return "does not follow the line before"
    return ""


def _is_plain(name: object) -> TypeGuard[str]:
    return isinstance(name, str) and bool(re.fullmatch(r"[A-Za-z0-9._-]+\.mcap", name))


def _wrong_file(folder: Path, entry: dict[str, Any], removed: set[str]) -> str:
    name = entry.get("file")
    if name is None or (isinstance(name, str) and name in removed):
        return ""
    if not _is_plain(name):
        return f"names no file of this folder, {name!r}"
    path = folder / name
    try:
        if path.is_symlink() or (path.exists() and not path.is_file()):
            return f"its file {name} is no file"
        found = file_hash(path)
    except OSError as error:
        return f"its file {name} cannot be read: {error.strerror}"
    return "" if found == entry.get("sha256") else f"its file {name} was changed"
