"""The recordings to explain: one file, or all files of one cell, in order."""

import os
from bisect import bisect_right
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hri_predict.base.errors import RecordingError, nearest_file
from hri_predict.recording import RecordingInfo, Told, read_messages, recording_info

TWICE_NS = 1_000_000_000
"""Maximum overlap of a file with the previous one that clock drift can explain."""


@dataclass(frozen=True, slots=True)
class RecordedFile:
    """One file: ``start_ns`` is its first message's time, as ``Told.utc_ns``."""

    path: Path
    info: RecordingInfo
    start_ns: int


class Recordings:
    """All files of one cell, read one after the other; at most one chunk is in memory.

    Args:
        named: files, and folders of ``.mcap`` files.

    Attributes:
        files: sorted by start time.
        notes: unreadable parts found so far, one line each.
        twice: pairs of files, found so far, that overlap in time.

    Raises:
        RecordingError: there is no recording of this node, or the recordings belong to several
            cells.
        OSError: a file cannot be read.
    """

    def __init__(self, named: Sequence[Path]) -> None:
        self.notes: list[str] = []
        self.twice: list[tuple[Path, Path]] = []
        found = [file for path in _paths(named) if (file := self._opened(path, named)) is not None]
        if not found:
            raise RecordingError(
                f"recording {named[0]}: holds nothing that was recorded by hri-predict; name "
                f"another file or folder"
            )
        self.files = sorted(found, key=lambda file: (file.start_ns, file.path.name))
        cells = sorted({file.info.cell for file in found})
        if len(cells) > 1:
            raise RecordingError(
                f"recording {named[0]}: the files belong to several cells ({', '.join(cells)}); "
                f"name one file, or a folder with the files of one cell"
            )
        if len({file.info.has_utc for file in found}) > 1:
            raise RecordingError(
                f"recording {named[0]}: some files have UTC and others do not; name one file, or a "
                f"folder with files of one kind"
            )

    def _opened(self, path: Path, named: Sequence[Path]) -> RecordedFile | None:
        try:
            info = recording_info(path)
            first = next(read_messages(path), None)
        except (RecordingError, OSError) as error:
            if path in named:
                raise
            self._note(f"{_unread(path, error)}; left out")
            return None
        if first is None:
            if path in named:
                raise RecordingError(f"recording {path}: empty or cut before its first message")
            self._note(f"recording {path}: empty or cut before its first message; left out")
            return None
        return RecordedFile(path, info, first.utc_ns)

    @property
    def info(self) -> RecordingInfo:
        """Properties of the first file."""
        return self.files[0].info

    @property
    def start_ns(self) -> int:
        """The first message's time."""
        return self.files[0].start_ns

    def info_at(self, utc_ns: int) -> RecordingInfo:
        """Return the properties of the file that was being written at that time."""
        begun = bisect_right(self.files, utc_ns, key=lambda file: file.start_ns)
        return self.files[max(begun - 1, 0)].info

    def end_ns(self) -> int:
        """Time of the last message; reads the last file."""
        file = self.files[-1]
        told = self._read(file, ["/clock", "/status"], None, None)
        return max((message.utc_ns for message in told), default=file.start_ns)

    def read(
        self,
        topics: Collection[str] | None = None,
        *,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Told]:
        """Yield every message from ``start_ns`` to before ``end_ns``, file by file.

        From a truncated or damaged file, the readable beginning is used, which is recorded in
        ``notes``.
        """
        before, newest_ns = self.files[0], 0
        for k, file in enumerate(self.files):
            late = end_ns is not None and file.start_ns >= end_ns
            later = self.files[k + 1].start_ns if k + 1 < len(self.files) else None
            early = start_ns is not None and later is not None and later < start_ns
            if late or early:
                continue
            for told in self._read(file, topics, start_ns, end_ns):
                if newest_ns > told.utc_ns + TWICE_NS and before is not file:
                    self._note_twice(before, file)
                before, newest_ns = file, max(told.utc_ns, newest_ns if before is file else 0)
                yield told

    def _read(
        self,
        file: RecordedFile,
        topics: Collection[str] | None,
        start_ns: int | None,
        end_ns: int | None,
    ) -> Iterator[Told]:
        def cut() -> None:
            self._note(
                f"recording {file.path.name}: has no end: the file was cut, is damaged, or is "
                f"still being written; later messages are not known"
            )

        try:
            yield from read_messages(
                file.path, topics, start_utc_ns=start_ns, end_utc_ns=end_ns, on_cut=cut
            )
        except (RecordingError, OSError) as error:
            # one message, and the rest of this file cannot be trusted; or a file that retention
            # deleted meanwhile
            self._note(f"{_unread(file.path, error)}; the rest of this file is left out")

    def _note_twice(self, first: RecordedFile, second: RecordedFile) -> None:
        self.twice.append((first.path, second.path))
        self._note(
            f"{first.path.name} and {second.path.name} cover the same time: the wall clock was "
            f"set back, or one file is a copy; name only the file that is meant"
        )

    def _note(self, line: str) -> None:
        if line not in self.notes:
            self.notes.append(line)


def _unread(path: Path, error: RecordingError | OSError) -> str:
    """Return why the rest of a file cannot be read, including its name."""
    if isinstance(error, RecordingError):
        return str(error)
    return f"recording {path}: cannot be read: {error.strerror or type(error).__name__}"


def _paths(named: Sequence[Path]) -> list[Path]:
    """Return the selected files, each once.

    Raises:
        RecordingError: the file does not exist, or the folder has none.
    """
    found: list[Path] = []
    for path in named:
        if path.is_dir():
            inside = sorted(p for p in path.glob("*.mcap") if p.is_file())
            if not inside:
                raise RecordingError(f"recording {path}: the folder has no .mcap; name another")
            found += inside
        elif os.path.exists(path):  # takes names that are too long
            found.append(path)
        else:
            raise RecordingError(
                f"recording {path}: no such file or folder{nearest_file(path)}; check the path"
            )
    return list({path.resolve(): path for path in found}.values())
