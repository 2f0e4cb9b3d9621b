"""Removes the oldest files of an evidence folder, so that the chain is true whenever a node dies.

A file is renamed, then a line of the log names it as removed, then it is deleted. If the node is
killed before the line, the next start restores the name. If it is killed after the line, the file
may still be there, which the chain permits; the next start counts it again. A file that cannot be
renamed could not be deleted either, so it stays, no line names it, and a newer one is removed.
"""

import logging
import re
from collections.abc import Sequence
from pathlib import Path

log = logging.getLogger(__name__)

_ASIDE = ".removing"
_STAMP = r"[0-9]{8}T[0-9]{6}\.[0-9]{3}Z"


class Room:
    """The files that a node keeps in a folder, up to a total size.

    Args:
        folder: the folder; names that a killed node left changed are restored.
        robots: the robots' names as used in file names.
        max_bytes: total size above which the oldest files are removed.

    Raises:
        OSError: the folder cannot be read, or a name cannot be restored.
    """

    def __init__(self, folder: Path, robots: Sequence[str], max_bytes: float) -> None:
        self._folder, self._max_bytes = folder, max_bytes
        for path in _kept(folder, robots, _ASIDE):
            path.rename(path.with_suffix(""))
        self.sizes = sizes(folder, robots)

    def add(self, path: Path) -> None:
        """Count a new file.

        Raises:
            OSError: it cannot be read.
        """
        self.sizes[path.name] = path.stat().st_size

    def put_aside(self) -> list[str]:
        """Rename the oldest files while the total size exceeds the limit; return their names.

        The newest file always stays.
        """
        names: list[str] = []
        for name in [*self.sizes][:-1]:
            if sum(self.sizes.values()) <= self._max_bytes:
                break
            try:
                (self._folder / name).rename(self._folder / f"{name}{_ASIDE}")
            except FileNotFoundError:  # another program deleted it, so no line may excuse that
                del self.sizes[name]
            except OSError as error:
                log.error("evidence %s: cannot be removed: %s", name, error.strerror)
            else:
                del self.sizes[name]
                names.append(name)
        return names

    def delete(self, names: Sequence[str]) -> None:
        """Delete files that were put aside, once a line of the log names them."""
        for name in names:
            try:
                (self._folder / f"{name}{_ASIDE}").unlink(missing_ok=True)
            except OSError as error:
                log.error("evidence %s: cannot be removed: %s", name, error.strerror)

    def restore(self, names: Sequence[str]) -> None:
        """Restore the names of files that no line could name as removed."""
        restored = {}
        for name in names:
            path = self._folder / name
            try:
                restored[name] = path.with_name(f"{name}{_ASIDE}").rename(path).stat().st_size
            except OSError as error:
                log.error("evidence %s: cannot be restored: %s", name, error.strerror)
        self.sizes = restored | self.sizes


def sizes(folder: Path, robots: Sequence[str]) -> dict[str, int]:
    """Name -> bytes of each file that a node kept there for these robots, oldest first."""
    return {path.name: path.stat().st_size for path in _kept(folder, robots)}


def _kept(folder: Path, robots: Sequence[str], suffix: str = "") -> list[Path]:
    """Return the files that a node kept there for these robots, oldest first."""
    named = "|".join(map(re.escape, robots))
    name = rf"{_STAMP}-({named})-(stop|near_miss|fault)(-[0-9]+)?\.mcap{re.escape(suffix)}"
    pattern = re.compile(name)
    paths = sorted(path for path in folder.iterdir() if pattern.fullmatch(path.name))
    return [path for path in paths if path.is_file() and not path.is_symlink()]
