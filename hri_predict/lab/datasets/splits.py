"""Uses of the recordings in the data pack: ``configs/training/splits.yaml``."""

from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, nearest
from hri_predict.base.files import data_path, read_yaml

USES = ("fit", "validation", "calibration", "test", "test_motion")
"""The lists that commands read; ``benchmark`` has two lists of its own."""
VERSION = 2
_CMU = "cmu_mocap/"


def split(use: str, file: str = "splits.yaml") -> list[str]:
    """Names of the recordings for one use, below the pack's root: "cmu_mocap/train/walking_1".

    Args:
        use: one of ``USES``.
        file: a file in ``configs/training``, or the user's own.

    Raises:
        ConfigError: the file has no such list, or is of another version.
    """
    path = _path(file)
    return _names(path, _read(path), use, use)


def benchmark_split(use: str, file: str = "splits.yaml") -> list[str]:
    """Names of the papers' benchmark for "fit" or "validation": "train/walking_1".

    Raises:
        ConfigError: the file has no such list, or is of another version.
    """
    path = _path(file)
    lists = _read(path).get("benchmark")
    found = _names(path, lists if isinstance(lists, dict) else {}, use, f"benchmark.{use}")
    return [name.removeprefix(_CMU) for name in found]


def in_pack(root: Path, name: str) -> Path:
    """Return the file of a name from ``split``; ``root`` is the pack, or only its ``cmu_mocap``.

    Raises:
        ConfigError: the file does not exist.
    """
    for below in (name, name.removeprefix(_CMU)):
        path = root / f"{below}.npz"
        if path.exists():
            return path
    raise ConfigError(
        f"data.root: {root} has no {name}.npz; give the data pack's folder (--data DIR), or name "
        f"your own recordings under data.fit and data.validation"
    )


def is_pack(entry: Path) -> bool:
    """Whether a folder is the data pack, or its ``cmu_mocap``."""
    return any((entry / below / "test").is_dir() for below in ("", _CMU))


def _path(file: str) -> Path:
    shipped = data_path("training", file)
    return shipped if shipped.exists() else Path(file)


def _read(path: Path) -> dict[str, Any]:
    data = read_yaml(path, "splits")
    if data.get("version") != VERSION:
        raise ConfigError(
            f"splits {path}: version is {data.get('version', 'missing')}; write 'version: "
            f"{VERSION}' and names below the pack's root, such as cmu_mocap/train/walking_1"
        )
    return data


def _names(path: Path, lists: dict[str, Any], use: str, key: str) -> list[str]:
    names = lists.get(use)
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        close = nearest(use, lists) if use not in lists else ""
        raise ConfigError(f"splits {path}: '{key}' must be a list of recordings{close}")
    return names
