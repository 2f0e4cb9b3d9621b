"""Writes a pose into ``source.room_from_source`` of a configuration and changes nothing else."""

from collections.abc import Sequence
from pathlib import Path

import yaml

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write, data_path, load_yaml
from hri_predict.run import config as configuration

PoseLists = tuple[list[float], list[float]]
"""``xyz`` and ``quaternion_xyzw``."""


def lines_to_paste(pose: PoseLists) -> str:
    """Return the pose as a line under ``source:``."""
    xyz, quaternion = pose
    return f"room_from_source: {{xyz: {_listed(xyz)}, quaternion_xyzw: {_listed(quaternion)}}}"


def with_pose(text: str, pose: PoseLists) -> str | None:
    """Return a configuration's text with another pose; ``None`` if its form is unusual.

    Only the pose's own numbers are replaced, so comments stay. The result is verified by reading it
    back.
    """
    before = load_yaml(text)
    node = _value(_value(yaml.compose(text, Loader=yaml.SafeLoader), "source"), "room_from_source")
    if not isinstance(node, yaml.MappingNode) or not isinstance(before, dict):
        return None
    changes: list[tuple[int, int, str]] = []
    missing = []
    for key, numbers in zip(("xyz", "quaternion_xyzw"), pose, strict=True):
        value = _value(node, key)
        if value is None:
            missing.append(f"{key}: {_listed(numbers)}")
        elif isinstance(value, yaml.SequenceNode) and value.flow_style:
            changes.append((value.start_mark.index, value.end_mark.index, _listed(numbers)))
        else:
            return None
    if missing:
        if not node.flow_style or not node.value:
            return None
        end = node.value[-1][1].end_mark.index
        changes.append((end, end, ", " + ", ".join(missing)))
    for start, end, new in sorted(changes, reverse=True):
        text = text[:start] + new + text[end:]
    after = load_yaml(text)
    rounded = [[float(_number(v)) for v in numbers] for numbers in pose]
    before["source"]["room_from_source"] = dict(
        zip(("xyz", "quaternion_xyzw"), rounded, strict=True)
    )
    return text if after == before else None


def write_pose(path: Path, pose: PoseLists) -> Path:
    """Write the pose into a configuration; return the path of the backup.

    Raises:
        ConfigError: the file is shipped with the package, cannot be written, or has an unusual
            form; the message contains the line to paste.
    """
    paste = f"write under 'source:' yourself: {lines_to_paste(pose)}"
    if path.resolve().is_relative_to(data_path().resolve()):
        raise ConfigError(f"{path}: belongs to the package; copy it first, or {paste}")
    try:
        text = path.read_bytes().decode()  # with the file's own line ends
        new = with_pose(text, pose)
    except (OSError, ValueError, yaml.YAMLError) as error:
        raise ConfigError(f"{path}: can no longer be read; {paste}") from error
    if new is None:
        raise ConfigError(f"{path}: 'room_from_source' has an unusual form; {paste}")
    backup = _free_name(path)
    try:
        atomic_write(backup, text.encode())
        atomic_write(path, new.encode())
    except OSError as error:
        raise ConfigError(f"{path}: cannot be written: {error.strerror}; {paste}") from error
    configuration.load(path)
    return backup


def _listed(numbers: Sequence[float]) -> str:
    return f"[{', '.join(_number(v) for v in numbers)}]"


def _number(value: float) -> str:
    """Return a number without an exponent, because YAML reads 5e-06 as a word."""
    text = f"{value:.6f}".rstrip("0")
    text = text + "0" if text.endswith(".") else text
    return "0.0" if float(text) == 0 else text


def _value(node: yaml.Node | None, key: str) -> yaml.Node | None:
    """Return the value of a mapping's key; ``None`` for other nodes, or without the key."""
    if not isinstance(node, yaml.MappingNode):
        return None
    return next((value for name, value in node.value if name.value == key), None)


def _free_name(path: Path) -> Path:
    """Return an unused name in the folder of ``path``: an older backup is never overwritten."""
    number = 1
    while (backup := path.with_name(f"{path.name}.before-register-{number}")).exists():
        number += 1
    return backup
