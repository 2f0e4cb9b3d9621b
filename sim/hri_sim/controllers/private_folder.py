"""A private folder, gone with its process: the next start removes what a killed one left."""

import contextlib
import fcntl
import os
import shutil
import tempfile
from pathlib import Path

PREFIX = "hri-cell-"
_LOCK = "owner.lock"


class PrivateFolder:
    """A folder in the system's temporary folder, with a lock that the kernel frees at our death.

    Attributes:
        path: the folder.
    """

    def __init__(self) -> None:
        """Create it, and remove the folders of processes that were killed."""
        remove_orphans(Path(tempfile.gettempdir()))
        self.path = Path(tempfile.mkdtemp(prefix=PREFIX))
        self._lock = _locked(self.path / _LOCK, os.O_RDWR | os.O_CREAT)

    def remove(self) -> None:
        """Remove it with all it holds. Safe to call twice."""
        shutil.rmtree(self.path, ignore_errors=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def remove_orphans(where: Path) -> None:
    """Remove the folders in ``where`` that are ours, and whose lock is not held.

    A folder without a lock is left alone: its owner may just be making it.
    """
    for folder in where.glob(f"{PREFIX}*"):
        with contextlib.suppress(OSError):
            if folder.is_symlink() or folder.stat().st_uid != os.getuid():
                continue
            lock = _locked(folder / _LOCK, os.O_RDWR | os.O_NOFOLLOW)
            if lock is not None:
                shutil.rmtree(folder, ignore_errors=True)
                os.close(lock)


def _locked(path: Path, flags: int) -> int | None:
    """Open a file and lock it; ``None`` if another holds the lock.

    Raises:
        OSError: there is no such file, or it cannot be opened.
    """
    file = os.open(path, flags, 0o600)
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(file)
        return None
    return file
