"""A finished bench as JSON, with its machine; comparison with an earlier bench by ratios."""

import errno
import json
import math
import os
import platform
import tempfile
import time
import timeit
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from hri_predict import __version__
from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write, read_text
from hri_predict.cli.common import writing
from hri_sim.bench.rows import Row

FORMAT = "hri-predict bench 1"
_REMEDY = "create one with hri-predict bench --save FILE"
Sections = Mapping[str, Sequence[Row]]


@dataclass(frozen=True, kw_only=True)
class Change:
    """A figure compared with an earlier run.

    Attributes:
        section, part: names of the section and of the part.
        p50, p99: ratio of new to old; ``None`` where one of them is missing.
        verdict: ``worse`` if p50 or p99 is; ``better`` if one is and the other is not larger;
            ``as before``; ``new``, ``gone`` or ``not compared``.
        why: the reason why it was not compared.
    """

    section: str
    part: str
    verdict: str
    p50: float | None = None
    p99: float | None = None
    why: str = ""

    @property
    def compares(self) -> bool:
        """Whether both runs have a figure, and their ratio means something."""
        return self.verdict in ("worse", "better", "as before")


def as_json(machine: Mapping[str, Any], sections: Sections) -> dict[str, Any]:
    """Return all figures as plain data."""
    rows = {name: [asdict(row) for row in found] for name, found in sections.items()}
    return {"format": FORMAT, "machine": dict(machine), "sections": rows}


def check(flag: str, path: Path) -> None:
    """Check that the file can be written, before anything is measured.

    Raises:
        ConfigError: the path is not a file, or its folder cannot be written.
    """
    with writing(f"{flag} {path}", "name another file"):
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "not a file")
        path.parent.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=path.parent).close()


def save(path: Path, told: Mapping[str, Any]) -> None:
    """Write a bench.

    Raises:
        ConfigError: it cannot be written.
    """
    with writing(f"--save {path}", "name another file"):
        atomic_write(path, (json.dumps(told, indent=1) + "\n").encode())


def read(path: Path) -> tuple[dict[str, Any], dict[str, list[Row]]]:
    """Read an earlier bench: its machine, and its rows by section.

    Raises:
        ConfigError: the file cannot be read, or no bench wrote it.
    """
    try:
        told = json.loads(read_text(path, "--baseline"))
        if told["format"] != FORMAT:
            raise ValueError(told["format"])
        sections = TypeAdapter(dict[str, list[Row]]).validate_python(told["sections"])
        machine = dict(told["machine"])
        yardstick = machine.get("yardstick_us")
        if yardstick is not None and not 0 < float(yardstick) < float("inf"):
            raise ValueError(f"yardstick_us {yardstick}")
    except (
        OverflowError,
        ValueError,
        KeyError,
        TypeError,
        AttributeError,
        RecursionError,
    ) as error:
        raise ConfigError(
            f"--baseline {path}: not a bench of this version ({FORMAT}); {_REMEDY}"
        ) from error
    return machine, sections


def compare(before: Sections, now: Sections, factor: float) -> list[Change]:
    """Compare the new measurements with the same parts of an earlier run.

    Args:
        before, now: rows by section. Sections missing from ``now`` are left out.
        factor: ratio of p50 or p99 from which a figure counts as worse (or better).
    """
    changes = []
    for section, rows in now.items():
        old = {row.part: row for row in before.get(section, ())}
        changes += [_change(section, old.pop(row.part, None), row, factor) for row in rows]
        changes += [Change(section=section, part=part, verdict="gone") for part in old]
    return changes


def _change(section: str, old: Row | None, row: Row, factor: float) -> Change:
    if old is None:
        return Change(section=section, part=row.part, verdict="new")
    p50, p99 = _ratio(old.p50, row.p50), _ratio(old.p99, row.p99)
    worse = [1.0 / r if row.more_is_better else r for r in (p50, p99) if r is not None]
    if row.p50 is None and old.p50 is not None:
        return Change(section=section, part=row.part, verdict="gone", why=row.note)
    if why := _incomparable(old, row):
        return Change(section=section, part=row.part, verdict="not compared", why=why)
    if any(r > factor for r in worse):
        verdict = "worse"
    elif any(r < 1.0 / factor for r in worse) and all(r <= 1.0 for r in worse):
        verdict = "better"
    else:
        verdict = "as before"
    return Change(section=section, part=row.part, p50=p50, p99=p99, verdict=verdict)


def _incomparable(old: Row, row: Row) -> str:
    """Return why two rows cannot be compared; "" if they can."""
    if old.unit != row.unit:
        return f"the baseline is in {old.unit or 'no unit'}, not in {row.unit or 'no unit'}"
    if old.more_is_better != row.more_is_better:
        return "the baseline has the other direction as the better one"
    if old.p50 is None and row.p50 is None and old.p99 is None and row.p99 is None:
        return "without a figure"
    for name in ("p50", "p99"):
        before, now = getattr(old, name), getattr(row, name)
        if (before is None) != (now is None):
            return f"the {'baseline' if before is None else 'new run'} has no {name}"
        if before is not None and _ratio(before, now) is None:
            return f"{name} {before:g}, now {now:g}: their ratio means nothing"
    return ""


def _ratio(old: float | None, new: float | None) -> float | None:
    """Return the ratio of new to old; ``None`` where it is meaningless."""
    if old is None or new is None or not (math.isfinite(old) and math.isfinite(new)):
        return None
    if old == new == 0:
        return 1.0
    ratio = new / old if old > 0 and new > 0 else 0.0
    return ratio if 0 < ratio < math.inf else None


def demand_comparable(path: Path, before: Sections, chosen: Sequence[str]) -> None:
    """Check that a baseline has a figure of a chosen section, before anything is measured.

    Raises:
        ConfigError: it has none.
    """
    rows = [row for name in chosen for row in before.get(name, ())]
    if not any(_ratio(row.p50, row.p50) is not None for row in rows):
        had = ", ".join(name for name, found in before.items() if found) or "none"
        raise ConfigError(
            f"--baseline {path}: has no figure to compare with {', '.join(chosen)} (its sections: "
            f"{had}); choose one of them with --only, or {_REMEDY}"
        )


def other_machine(before: Mapping[str, Any], now: Mapping[str, Any]) -> Iterator[str]:
    """Yield one line for each difference between the machines of the two runs."""
    for key in ("processor", "cores", "governor"):
        if before.get(key) != now.get(key):
            yield f"the earlier run had another {key}: {before.get(key)}, now {now.get(key)}"
    old = before.get("yardstick_us")
    if old is not None:  # ``read`` has checked it
        ratio = now["yardstick_us"] / float(old)
        yield (
            f"the machine itself: a fixed workload takes {ratio:.2f} times as long as in the "
            "earlier run"
        )


def changes_json(changes: Sequence[Change]) -> dict[str, Any]:
    """Return a comparison as plain data, empty if there was no comparison."""
    return {"changes": [asdict(change) for change in changes]} if changes else {}


# -- the machine that was measured on, and how busy it was -----------------------------------------

BUSY = 0.5  # load average from which figures are not to be trusted
_GOVERNOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")
_LIBRARIES = ("numpy", "torch", "onnxruntime", "numba", "openvino")


def machine() -> dict[str, Any]:
    """Return cores, processor, load average, governor, versions, and a yardstick."""
    return {
        "processor": _processor(),
        "cores": len(os.sched_getaffinity(0)),
        "kernel": platform.release(),
        "governor": _read(_GOVERNOR) or "unknown",
        "load_average": round(os.getloadavg()[0], 2),
        "yardstick_us": round(yardstick_us(), 1),
        "python": platform.python_version(),
        "hri_predict": __version__,
        "libraries": {name: version for name in _LIBRARIES if (version := _version(name))},
        "began": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
    }


def yardstick_us() -> float:
    """Return the duration of a fixed workload in Python and numpy, in us, to compare machines."""
    values = np.linspace(0.0, 1.0, 1000)

    def work() -> None:
        for _ in range(20):
            np.sqrt(values * values + 1.0).argmin()
        sum(k * k for k in range(2000))

    return 1e6 * min(timeit.repeat(work, number=10, repeat=20)) / 10


def busy(load_average: float) -> str:
    """Return one line if the machine is too busy for measurements, otherwise ""."""
    if load_average <= BUSY:
        return ""
    return (
        f"this machine is busy (load average {load_average:.1f}, over {BUSY:g}): figures are too "
        "large, and only ratios within one run are useful; stop other programs, or wait a minute"
    )


def described(facts: dict[str, Any]) -> str:
    """Describe the machine in one line."""
    return (
        f"{facts['cores']} cores, {facts['processor']}, governor {facts['governor']}, load average "
        f"{facts['load_average']:g} at start"
    )


def _processor() -> str:
    lines = _read(Path("/proc/cpuinfo")).splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.machine())


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return ""
