"""A folder for what can be made again: what is missing, damaged or not writable is made again.

The folder is the first of these that is set: ``HRI_PREDICT_CACHE`` (empty: nothing is kept),
``CACHE_DIRECTORY`` (as systemd names a service's), ``XDG_CACHE_HOME``/hri-predict, and
``~/.cache/hri-predict``.
"""

import contextlib
import hashlib
import logging
import os
import stat
from collections.abc import Callable
from pathlib import Path

from hri_predict.base.files import atomic_write

log = logging.getLogger(__name__)

MAX_BYTES = 2**30  # twice the largest weights
_DIGEST_BYTES = hashlib.sha256().digest_size


def cache_folder() -> Path | None:
    """The folder; it may be missing. ``None``: nothing is kept."""
    own = os.environ.get("HRI_PREDICT_CACHE")
    if own is not None:
        return Path(os.path.expanduser(own)) if own else None
    service = os.environ.get("CACHE_DIRECTORY", "").partition(":")[0]
    if service:
        return Path(service)
    base = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    return Path(base) / "hri-predict" if os.path.isabs(base) else None


def cached(name: str, make: Callable[[], bytes]) -> bytes:
    """Return the result of ``make``, kept under ``name``: with its digest, so that damage is found.

    Args:
        name: of the file. It says all that the content depends on, such as a hash of it.
        make: called if the file is missing or damaged.
    """
    folder = cache_folder()
    if folder is None:
        return make()
    path = folder / name
    with contextlib.suppress(OSError):
        content = _undamaged(path)
        if content is not None:
            return content
        log.warning("cache: %s is damaged; rebuilding it", path)
    content = make()
    try:
        atomic_write(path, hashlib.sha256(content).digest() + content)
    except OSError as error:
        log.debug("cache: %s is not kept: %s", path, error.strerror)
    return content


def _undamaged(path: Path) -> bytes | None:
    """Return a file's content; ``None`` if it is not what was written.

    Raises:
        OSError: the file does not exist, or it cannot be read.
    """
    status = path.stat()
    if not stat.S_ISREG(status.st_mode) or status.st_size > MAX_BYTES:
        return None  # reading a pipe would wait for ever
    stored = path.read_bytes()
    digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    return content if hashlib.sha256(content).digest() == digest else None


def forget(name: str) -> None:
    """Remove what is kept under ``name``, if anything is."""
    folder = cache_folder()
    if folder is not None:
        with contextlib.suppress(OSError):
            (folder / name).unlink()
