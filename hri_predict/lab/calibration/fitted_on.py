"""Recordings that a predictor's weights were fitted on, as far as their files say.

Errors on them are smaller than on others, and so would be zones that are calibrated on them.
"""

import hashlib
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from hri_predict.base.errors import ConfigError, HriPredictError
from hri_predict.lab.datasets.splits import in_pack, split
from hri_predict.predictors.neural.weights import read_header


def fitted_on(weights: Iterable[Path], recordings: Sequence[Path]) -> list[Path]:
    """Return the recordings that any of these weights files were fitted on.

    Where the files of the training still exist, recordings are compared by content, otherwise by
    the names in the weights file. Weights that they were fine-tuned from do not count.
    """
    there: list[Path] = []
    gone: list[str] = []
    for path in weights:
        for name, file in _fitted(path):
            if file is None:
                gone.append(name)
            else:
                there.append(file)
    return [path for path in recordings if _is_one(path, there) or _has_name(path, gone)]


def _fitted(weights: Path) -> list[tuple[str, Path | None]]:
    """Return each recording of a training: its name, and its file if that still exists."""
    try:
        config = read_header(weights).card.get("config")
    except HriPredictError:
        return []  # the predictor that loads it reports the problem
    data = config.get("data") if isinstance(config, dict) else None
    if not isinstance(config, dict) or not isinstance(data, dict):
        return []
    real = config.get("judgement") == "real"
    found: list[tuple[str, Path | None]] = []
    for use in ("fit", "validation") if data.get("refit") else ("fit",):
        own = data.get(use)
        if isinstance(own, list):
            found += [each for name in own for each in _of_pattern(data, str(name))]
        elif real:
            found += _of_pack(data, use)
    return found


def _root(data: dict[str, Any]) -> Path:
    return Path(str(data.get("root", "../shared/data")))  # the default of the data set


def _of_pattern(data: dict[str, Any], pattern: str) -> list[tuple[str, Path | None]]:
    """Return the files of a name or pattern; nothing is known of a pattern without files."""
    try:
        own = Path(pattern)
        files = [own] if own.is_absolute() else list(_root(data).glob(pattern))
        there = [file for file in files if file.is_file()]
    except (ValueError, IndexError, OSError):
        return []
    if there or not Path(pattern).name or any(sign in pattern for sign in "*?["):
        return [(pattern, file) for file in there]
    return [(pattern, None)]


def _of_pack(data: dict[str, Any], use: str) -> list[tuple[str, Path | None]]:
    """Return the recordings of a split of the data pack."""
    try:
        names = split(use, str(data.get("splits", "splits.yaml")))
    except ConfigError:
        return []
    found: list[tuple[str, Path | None]] = []
    for name in names:
        try:
            found.append((name, in_pack(_root(data), name)))
        except ConfigError:
            found.append((f"{name}.npz", None))
    return found


def _is_one(path: Path, files: Sequence[Path]) -> bool:
    """Whether a recording has the content of one of these files."""
    if not path.is_file():
        return False
    size = path.stat().st_size
    same = [file for file in files if file.stat().st_size == size]
    return any(file.samefile(path) for file in same) or (
        bool(same) and _digest(path) in {_digest(file) for file in same}
    )


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _has_name(path: Path, names: Sequence[str]) -> bool:
    """Whether the end of a recording's path is one of these names."""
    return any(path.absolute().match(name) for name in names)
