"""A finished bench as JSON, and its comparison with an earlier one: by ratios alone."""

import errno
import json
import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write
from hri_sim.bench.rows import Row

FORMAT = "hri-predict bench 1"
_REMEDY = "make one with hri-predict bench --save FILE"
Sections = Mapping[str, Sequence[Row]]


@dataclass(frozen=True, kw_only=True)
class Change:
    """A figure next to that of an earlier run.

    Attributes:
        section, part: their names.
        p50, p99: new over old; ``None`` where one of them is missing.
        verdict: ``worse``, ``better``, ``as before``, ``new``, or ``gone``.
    """

    section: str
    part: str
    p50: float | None
    p99: float | None
    verdict: str


def as_json(machine: Mapping[str, Any], sections: Sections) -> dict[str, Any]:
    """All figures, as plain data."""
    rows = {name: [asdict(row) for row in found] for name, found in sections.items()}
    return {"format": FORMAT, "machine": dict(machine), "sections": rows}


def check(flag: str, path: Path) -> None:
    """Refuse a file that cannot be written before anything is measured, not after.

    Raises:
        ConfigError: it is a folder, or its folder cannot be written.
    """
    try:
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise _unwritable(flag, path, error) from error


def write(flag: str, path: Path, data: bytes) -> None:
    """Write a file that a flag names.

    Raises:
        ConfigError: it cannot be written.
    """
    try:
        atomic_write(path, data)
    except OSError as error:
        raise _unwritable(flag, path, error) from error


def save(path: Path, told: Mapping[str, Any]) -> None:
    """Write a bench.

    Raises:
        ConfigError: it cannot be written.
    """
    write("--save", path, (json.dumps(told, indent=1) + "\n").encode())


def _unwritable(flag: str, path: Path, error: OSError) -> ConfigError:
    return ConfigError(f"{flag} {path}: cannot be written: {error.strerror}; name another file")


def read(path: Path) -> tuple[dict[str, Any], dict[str, list[Row]]]:
    """Read an earlier bench: its machine, and its rows by section.

    Raises:
        ConfigError: there is no such file, or it is not one of ours.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        if told["format"] != FORMAT:
            raise ValueError(told["format"])
        sections = {
            str(name): [_row(row) for row in rows] for name, rows in told["sections"].items()
        }
        machine = dict(told["machine"])
    except OSError as error:
        raise ConfigError(f"--baseline {path}: {error.strerror}; {_REMEDY}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ConfigError(
            f"--baseline {path}: not a bench of this version ({FORMAT}); {_REMEDY}"
        ) from error
    return machine, sections


def _row(data: Any) -> Row:
    row = Row(**data)
    for name in ("p50", "p99"):
        value = getattr(row, name)
        if value is not None and not isinstance(value, int | float):
            raise ValueError(name)
    return row


def compare(before: Sections, now: Sections, factor: float) -> list[Change]:
    """Compare what was measured now with the same parts of an earlier run.

    Args:
        before, now: rows by section. Sections that were not measured now are left out.
        factor: ratio of p50 or p99 from which it counts as worse (or better).
    """
    changes = []
    for section, rows in now.items():
        old = {row.part: row for row in before.get(section, ())}
        changes += [_change(section, old.pop(row.part, None), row, factor) for row in rows]
        changes += [_gone(section, row.part) for row in old.values()]
    return changes


def _gone(section: str, part: str) -> Change:
    return Change(section=section, part=part, p50=None, p99=None, verdict="gone")


def _change(section: str, old: Row | None, row: Row, factor: float) -> Change:
    if old is None:
        return Change(section=section, part=row.part, p50=None, p99=None, verdict="new")
    p50, p99 = _ratio(old.p50, row.p50), _ratio(old.p99, row.p99)
    worse = [1.0 / r if row.more_is_better else r for r in (p50, p99) if r is not None]
    if row.p50 is None and old.p50 is not None:
        verdict = "gone"
    elif any(r > factor for r in worse):
        verdict = "worse"
    elif any(r < 1.0 / factor for r in worse):
        verdict = "better"
    else:
        verdict = "as before"
    return Change(section=section, part=row.part, p50=p50, p99=p99, verdict=verdict)


def _ratio(old: float | None, new: float | None) -> float | None:
    """New over old; ``None`` where that says nothing."""
    return new / old if old and new and old > 0 and new > 0 else None


def other_machine(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """One line for each way in which the two runs' machines differ."""
    for key in ("processor", "cores", "governor"):
        if before.get(key) != now.get(key):
            yield f"the earlier run had another {key}: {before.get(key)}, now {now.get(key)}"
    old = before.get("yardstick_us")
    if isinstance(old, int | float) and old > 0:
        ratio = now["yardstick_us"] / old
        yield f"the machine itself: a fixed work takes {ratio:.2f} times as long as in that run"


def changes_json(changes: Sequence[Change]) -> dict[str, Any]:
    """A comparison as plain data; nothing where there was none."""
    return {"changes": [asdict(change) for change in changes]} if changes else {}
