"""The files that a configuration depends on: what is in them counts as much as its own keys."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from hri_predict.base.files import data_path
from hri_predict.contracts.joint_map import map_names
from hri_predict.robots.file import robot_path
from hri_predict.robots.trajectory import trajectory_path
from hri_predict.run.config import Config
from hri_predict.zones.calibration import shipped_calibration

WRITTEN = ("record", "state.path", "evidence.folder")
"""Keys of files that the node writes: what is in them changes all the time."""
SECRET = "key_file"
"""The hash of a short secret could be tried out, so a key's content is not in any report."""
ALERTS = "alerts."
"""Receivers do not change any advice; and these files are written, or are secrets."""


def escaped(name: str) -> str:
    """A name as a part of a dotted key."""
    return name.replace("\\", "\\\\").replace(".", "\\.")


def dependencies(config: Config, flat: Mapping[str, Any]) -> dict[str, Path]:
    """Key of the configuration -> the file that it names or implies; the file may be missing.

    Args:
        config: the configuration.
        flat: the same by dotted keys; see ``identity.flattened``.
    """
    found = dict(_known(config))
    for key, value in flat.items():
        if key in found or key in WRITTEN or key.startswith(ALERTS):
            continue
        if key.rpartition(".")[2] == SECRET:
            continue
        path = _named(value, config.base_dir)
        if path is not None:
            found[key] = path
    return found


def _known(config: Config) -> Iterator[tuple[str, Path]]:
    """Files that are found by other rules than as a path relative to the configuration."""
    base_dir = config.base_dir
    for robot in config.node.robots:
        yield f"robots.{escaped(robot.name)}.model", robot_path(robot.model, base_dir)
        for key in ("plan", "file"):
            name = getattr(robot.motion, key, None)
            if name is not None:
                yield f"robots.{escaped(robot.name)}.motion.{key}", trajectory_path(name, base_dir)
    for link in config.links:
        name = (link.simulate or {}).get("trajectory")
        if isinstance(name, str):
            yield f"links.{escaped(link.name)}.simulate.trajectory", trajectory_path(name, base_dir)
    for i, path in enumerate(config.predictor.resolved(base_dir).files()):
        yield f"predictor.weights{f'.{i}' if i else ''}", path
    if config.node.risk.uses_forecasts:
        own = config.node.risk.coverage.calibration
        shipped = shipped_calibration(config.predictor.name)
        if own is not None:
            yield "risk.coverage.calibration", base_dir / own
        elif shipped.is_file():
            yield "risk.coverage.calibration", shipped
    joint_map = getattr(config.source, "joint_map", None)
    if isinstance(joint_map, str) and joint_map in map_names():
        yield "source.joint_map", data_path("skeletons", f"{joint_map}.yaml")


def _named(value: Any, base_dir: Path) -> Path | None:
    """Return the file that a text names, relative to the configuration or to the current folder."""
    if not isinstance(value, str) or not value or "\0" in value:
        return None
    for path in (base_dir / value, Path(value)):
        if os.path.isfile(path):  # does not raise if the name is too long
            return path
    return None
