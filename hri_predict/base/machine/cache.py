"""Cache folder: missing, damaged or unwritable content is created again.

The folder is the first of these that is set: ``HRI_PREDICT_CACHE`` (empty: no cache),
``CACHE_DIRECTORY`` (set by systemd for a service), ``XDG_CACHE_HOME``/hri-predict, and
``~/.cache/hri-predict``.
"""

import contextlib
import hashlib
import logging
import os
import re
import stat
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from hri_predict.base.files import atomic_write

log = logging.getLogger(__name__)

MAX_BYTES = 2**30  # twice the largest weights
KEPT = 8
"""Maximum number of files kept whose names differ only in their hash."""
KEPT_S = 90 * 86_400.0
"""Time after which unused files are removed."""
_HASHED = re.compile(r"(.+-)[0-9a-f]{32}(\..+)")
_DIGEST_BYTES = hashlib.sha256().digest_size


def cache_folder() -> Path | None:
    """Return the folder, which may be missing; ``None`` without a cache."""
    own = os.environ.get("HRI_PREDICT_CACHE")
    if own is not None:
        return Path(os.path.expanduser(own)) if own else None
    service = os.environ.get("CACHE_DIRECTORY", "").partition(":")[0]
    if service:
        return Path(service)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "hri-predict" if os.path.isabs(base) else None


def cached(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the result of ``make``, cached under ``name``.

    A digest of name and content is stored with it, so that damaged or renamed files are detected. A
    file of another user is not read, because that user could change its content.

    Args:
        name: file name, which identifies everything that the content depends on, for example by a
            hash.
        make: called if the file is missing, damaged or another user's.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    path = folder / name
    with contextlib.suppress(OSError):
        content, problem = _kept(path)
        if not problem:
            with contextlib.suppress(OSError):
                os.utime(path)  # its last use
            return content
        log.warning("cache: %s %s; rebuilding it", path, problem)
    content = make()
    try:
        atomic_write(path, _digest(name, content) + content)
    except OSError as error:
        log.warning(
            "cache: %s was not saved (%s), so the next start makes it again; free space there, or "
            "set HRI_PREDICT_CACHE to another folder",
            path,
            error.strerror,
        )
    _remove_unused(folder)
    return content


def _remove_unused(folder: Path) -> None:
    """Remove this user's files beyond ``KEPT`` and ``KEPT_S``, by the time of their last use.

    Names without a hash belong to other programs. Another node may remove or read files at the same
    time.
    """
    found: list[tuple[float, Path, tuple[str, ...]]] = []
    user = getattr(os, "geteuid", int)()
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if named := _HASHED.fullmatch(path.name):
                with contextlib.suppress(OSError):  # another node was faster
                    status = path.lstat()
                    if stat.S_ISREG(status.st_mode) and status.st_uid == user:
                        found.append((status.st_mtime, path, named.groups()))
    kept, removed = Counter[tuple[str, ...]](), 0
    for used_s, path, of in sorted(found, reverse=True):
        kept[of] += 1
        if kept[of] > KEPT or used_s < time.time() - KEPT_S:
            with contextlib.suppress(OSError):
                path.unlink()
                removed += 1
    if removed:
        log.debug("cache: removed unused files: %d", removed)


def _kept(path: Path) -> tuple[bytes, str]:
    """Return a file's content, and "" or the reason why it is not used.

    Raises:
        OSError: the file does not exist, or it cannot be read.
    """
    with open(path, "rb", opener=_without_waiting) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_BYTES:
            return b"", "is damaged"
        if hasattr(os, "geteuid") and status.st_uid not in (0, os.geteuid()):
            return b"", "belongs to another user"
        stored = file.read(MAX_BYTES)
    digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    if _digest(path.name, content) != digest:
        return b"", "is damaged"
    return content, ""


def _without_waiting(path: str, flags: int) -> int:
    """Open a file without blocking on a pipe that no process writes."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _digest(name: str, content: bytes) -> bytes:
    digest = hashlib.sha256(name.encode() + b"\0")
    digest.update(content)
    return digest.digest()


def forget(name: str) -> None:
    """Remove the file cached under ``name``, if any."""
    folder = cache_folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            (folder / name).unlink()
