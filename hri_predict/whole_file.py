"""Files that are written whole or not at all."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path


def write_whole(path: Path, data: bytes) -> None:
    """Write ``data`` in place of ``path``: a reader finds the old file or the new one, no part.

    Makes the folder where there is none.

    Raises:
        OSError: it cannot be written; a file that was there is as it was.
    """
    with whole_file(path) as partial:
        partial.write_bytes(data)


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a file to write, which takes the place of ``path`` unless something is raised.

    Raises:
        OSError: it cannot be written, or is a device or pipe, which must not make way for a file; a
            file that was there is as it was.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "is no file", str(path))
    partial = path.with_name(path.name + ".partial")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield partial
        os.replace(partial, path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise
