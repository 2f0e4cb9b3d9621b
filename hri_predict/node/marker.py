"""A mark next to the state file, which proves that the file is this cell's newest state.

The mark is stored in the lock file, which has a fixed length and so can be written even if the disk
is full. It counts the writes, and is written before and after the state file. So a state file that
was deleted, restored, copied from another cell or not written does not match the mark. If file and
mark are restored together, the file system's time of the last change does not match.
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
        writes: number of writes of the state file, including a started one.
        changed_ns: the file's change time (ctime) after that write; ``None``: the write is not
            finished.
    """

    name: str
    writes: int = 0
    changed_ns: int | None = None

    @classmethod
    def new(cls) -> "Mark":
        """Return the mark of a new pair of files."""
        return cls(secrets.token_hex(8))

    @classmethod
    def read(cls, file: int) -> "Mark | None":
        """Return the mark in an open lock file; ``None`` if there is none."""
        try:
            data = json.loads(os.pread(file, _BYTES, 0))
            changed_ns = None if data["changed_ns"] is None else int(data["changed_ns"])
            return cls(str(data["name"]), int(data["writes"]), changed_ns)
        except (KeyError, TypeError, ValueError, OverflowError, OSError):
            return None

    def begin(self, file: int) -> "Mark":
        """Mark that the state file is about to be written.

        Raises:
            OSError: the mark cannot be written.
        """
        return replace(self, writes=self.writes + 1, changed_ns=None)._write(file)

    def end(self, file: int, path: Path) -> "Mark":
        """Mark that the state file at ``path`` was written.

        Raises:
            OSError: the mark cannot be written.
        """
        return replace(self, changed_ns=path.stat().st_ctime_ns)._write(file)

    def contradiction(self, name: str, writes: int, path: Path) -> str:
        """Return why a state file is not the last one written; "" if it is.

        Args:
            name, writes: values in the state file.
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
