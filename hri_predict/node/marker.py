"""A mark beside the state file, by which the file can prove that it is this cell's last word.

The mark lies in the lock file, which always has the same length: it can be written even when the
disk is full. It counts the writes, and is written before the state file and again afterwards. So a
state file that was deleted, restored from a copy, brought from elsewhere or could not be written
does not match it. If file and mark are restored together, the time of the file's last change, which
the file system keeps, does not match.
"""

import json
import os
import secrets
from dataclasses import asdict, dataclass, replace
from pathlib import Path

_BYTES = 256


@dataclass(frozen=True, slots=True)
class Mark:
    """Facts about the state file, kept in the lock file next to it.

    Attributes:
        name: random name of this pair of files.
        writes: number of times that the state file was, or was to be, written.
        changed_ns: when the file system changed the file last, at that write; ``None``: the write
            has not ended.
    """

    name: str
    writes: int = 0
    changed_ns: int | None = None

    @classmethod
    def new(cls) -> "Mark":
        """A mark of a pair of files that did not exist before."""
        return cls(secrets.token_hex(8))

    @classmethod
    def read(cls, file: int) -> "Mark | None":
        """The mark in an open lock file; ``None`` if there is none."""
        try:
            data = json.loads(os.pread(file, _BYTES, 0))
            changed_ns = None if data["changed_ns"] is None else int(data["changed_ns"])
            return cls(str(data["name"]), int(data["writes"]), changed_ns)
        except (KeyError, TypeError, ValueError, OverflowError, OSError):
            return None

    def begin(self, file: int) -> "Mark":
        """Note that the state file is about to be written.

        Raises:
            OSError: that cannot be noted.
        """
        return replace(self, writes=self.writes + 1, changed_ns=None)._write(file)

    def end(self, file: int, path: Path) -> "Mark":
        """Note that the state file at ``path`` was written.

        Raises:
            OSError: that cannot be noted.
        """
        return replace(self, changed_ns=path.stat().st_ctime_ns)._write(file)

    def contradiction(self, name: str, writes: int, path: Path) -> str:
        """Why a state file is not what was written last; "" if it is.

        Args:
            name, writes: as the state file has them.
            path: the state file.
        """
        if name != self.name:
            return "belongs to another cell"
        if writes < self.writes:
            return f"is older than the last one: write {writes} of {self.writes}"
        if writes > self.writes:
            return "is newer than its lock file"
        if self.changed_ns not in (None, path.stat().st_ctime_ns):
            return "was put there, or its owner or mode was changed, after the node had written it"
        return ""

    def _write(self, file: int) -> "Mark":
        os.pwrite(file, json.dumps(asdict(self)).encode().ljust(_BYTES), 0)
        os.fsync(file)
        return self
