"""Finished blocks as JSON lines, in a file named after everything that determines the results."""

import hashlib
import json
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write, refuse_named_pipe
from hri_predict.cli.common import writing

VERSION = 2


class Store:
    """The blocks of one plan; without a folder, they are kept only in memory."""

    def __init__(self, folder: Path | None, decided_by: dict[str, Any], resume: bool) -> None:
        """Read the finished blocks.

        Raises:
            ConfigError: the folder holds another simulation, holds any simulation while ``resume``
                is false, or cannot be written.
        """
        self.done: dict[str, dict[str, Any]] = {}
        self._path = None if folder is None else folder / "episodes.jsonl"
        text = json.dumps({"version": VERSION} | decided_by, sort_keys=True)
        self._header = {"version": VERSION, "hash": hashlib.sha256(text.encode()).hexdigest()[:16]}
        if self._path is None:
            return
        with writing(f"--out {folder}", "name another folder"):
            refuse_named_pipe(self._path)
            if self._path.exists():
                self._read(self._path, resume)
            else:
                self._path.parent.mkdir(parents=True, exist_ok=True)
                self._path.write_text(json.dumps(self._header) + "\n", encoding="utf-8")

    def add(self, key: str, rows: dict[str, Any]) -> None:
        """Keep a finished block.

        Raises:
            ConfigError: it cannot be written.
        """
        line = _line(key, rows)
        self.done[key] = json.loads(line)["rows"]  # as a resumed run has it
        if self._path is None:
            return
        remedy = "free some space, then continue with --resume"
        with (
            writing(f"--out {self._path.parent}", remedy),
            self._path.open("a", encoding="utf-8") as file,
        ):
            file.write(line + "\n")

    def _read(self, path: Path, resume: bool) -> None:
        lines = path.read_bytes().split(b"\n")
        header = _parsed(lines[0])
        if header is None or header.get("version") != VERSION or "hash" not in header:
            raise ConfigError(
                f"--out {path.parent}: {path.name} is from another version; remove it"
            )
        if not resume:
            raise ConfigError(
                f"--out {path.parent}: holds a simulation; add --resume to continue it, or name "
                f"another folder"
            )
        if header != self._header:
            raise ConfigError(
                f"--resume: {path.parent} holds a simulation of another configuration, seed, "
                f"code, recording or file that the configuration names; use the original ones, "
                f"or name another folder with --out"
            )
        for line in lines[1:]:
            block = _parsed(line) or {}
            key, rows = block.get("block"), block.get("rows")
            whole = block.get("sum") == _sum(
                key, rows
            )  # otherwise cut off or damaged: it is repeated
            if whole and isinstance(key, str) and isinstance(rows, dict):
                self.done[key] = rows
        kept = [json.dumps(self._header)] + [_line(key, rows) for key, rows in self.done.items()]
        atomic_write(path, ("\n".join(kept) + "\n").encode())


def _line(key: str, rows: dict[str, Any]) -> str:
    return json.dumps({"block": key, "rows": rows, "sum": _sum(key, rows)})


def _sum(key: Any, rows: Any) -> str:
    """Return the checksum of a block's line.

    Its numbers go into tables, and only the checksum proves that they are unchanged.
    """
    return hashlib.sha256(json.dumps([key, rows]).encode()).hexdigest()[:16]


def _parsed(line: bytes) -> dict[str, Any] | None:
    try:
        data = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else None
