"""Files: input is not trusted, and output is written completely or not at all.

A named pipe is refused before it is opened, because opening it may block forever. Pipes from a
shell (``/dev/stdin``, ``<(...)``) have no name and already have a writer, so they are accepted.

YAML errors are not hidden. PyYAML's safe loader silently keeps the last of two equal keys, expands
aliases to any size, and passes on exceptions of Python's conversions; this loader does not. YAML
1.1 reads 010 as 8, 1:00 as 60 and 1_0 as 10; this loader refuses such numbers.
"""

import contextlib
import errno
import os
import re
import stat
from collections.abc import Iterator, Sequence
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import yaml

from hri_predict.base.errors import ConfigError, nearest

YAML_ENDINGS = (".yaml", ".yml")
MAX_CHARACTERS = 1_000_000  # of a file; the longest shipped file has 8000
MAX_VALUES = 100_000  # with all aliases expanded
MAX_SCALAR = 2000  # characters of one value; half of the longest path

_PACKAGE = Path(__file__).resolve().parents[1]
_ZERO_FIRST = re.compile(r"[-+]?0[0-9_]+(\.[0-9_]*)?([eE][-+]?[0-9]+)?")
_NUMBERS = ("tag:yaml.org,2002:int", "tag:yaml.org,2002:float")


def data_path(*parts: str) -> Path:
    """Path of a file shipped under ``configs/``: the package's copy, otherwise the checkout's."""
    here = _PACKAGE
    packaged = here.joinpath("configs", *parts)
    # os.path: returns False for a name that is too long, where Path.exists would raise
    return packaged if os.path.exists(packaged) else here.parent.joinpath("configs", *parts)


def shipped_path(what: str, folder: str, name: str, base_dir: Path | None) -> Path:
    """Return the path of a shipped file, or a path ending in .yaml, which need not exist.

    Args:
        what: kind of the file, for the message.
        folder: under ``configs/``.
        name: shipped name, or a path.
        base_dir: base of relative paths; ``None``: the current folder.

    Raises:
        ConfigError: no file of this name is shipped.
    """
    if Path(name).suffix in YAML_ENDINGS:
        return (base_dir or Path()) / name
    path = data_path(folder, f"{name}.yaml")
    if not os.path.isfile(path):  # does not raise if the name is too long
        shipped = sorted(p.stem for p in data_path(folder).glob("*.yaml"))
        raise ConfigError(
            f"unknown {what} '{name}'{nearest(name, shipped)}; "
            f"available: {', '.join(shipped)}; or give the path of a .yaml file"
        )
    return path


def package_path(*parts: str) -> Path:
    """Path of a file inside the package ``hri_predict``, such as trained weights."""
    return _PACKAGE.joinpath(*parts)


def atomic_write(path: Path, data: bytes) -> None:
    """Replace the content of ``path`` with ``data``: a reader sees the old or the new file, never a
    part.

    Creates a missing folder.

    Raises:
        OSError: it cannot be written; an existing file stays as it was.
    """
    with atomic_file(path) as partial:
        partial.write_bytes(data)


@contextlib.contextmanager
def atomic_file(path: Path) -> Iterator[Path]:
    """Yield a file to write; it replaces ``path`` unless an exception is raised.

    Raises:
        OSError: it cannot be written, or ``path`` is a device or pipe, which must not be replaced,
            or the temporary file (``.partial``) is a link, device or pipe; an existing file is
            unchanged.
    """
    if path.exists() and not path.is_file():
        raise OSError(errno.EINVAL, "not a file", str(path))
    partial = path.with_name(path.name + ".partial")
    if partial.is_symlink() or (partial.exists() and not partial.is_file()):
        raise OSError(errno.EINVAL, "not a file", str(partial))
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        yield partial
        os.replace(partial, path)
    except BaseException:
        with contextlib.suppress(OSError):
            partial.unlink()
        raise


def refuse_named_pipe(path: Path) -> None:
    """Check ``path`` before it is opened; a missing file passes.

    Raises:
        OSError: it is a named pipe; ``strerror`` has the reason.
        ValueError: it contains a NUL.
    """
    try:
        mode = os.stat(path).st_mode
    except OSError:
        return
    if stat.S_ISFIFO(mode) and os.path.exists(os.path.realpath(path)):
        raise OSError(errno.EINVAL, "is a pipe, not a file", str(path))


def demand_kind(path: Path, *, folder: bool = False) -> None:
    """Check that ``path`` is a regular file, or a ``folder``, or could become one.

    Raises:
        OSError: it is something else, or its parent is not a folder; ``strerror`` has the reason.
    """
    for at in (path, *path.parents):
        try:
            mode = os.stat(at).st_mode
        except OSError:
            continue
        meant = "folder" if folder or at is not path else "file"
        if not (stat.S_ISDIR(mode) if meant == "folder" else stat.S_ISREG(mode)):
            name = "" if at is path else f"{at} "
            raise OSError(errno.EINVAL, f"{name}is {_kind(mode)}, not a {meant}", str(path))
        return


def _kind(mode: int) -> str:
    if stat.S_ISDIR(mode):
        return "a folder"
    if stat.S_ISREG(mode):
        return "a file"
    return "a pipe" if stat.S_ISFIFO(mode) else "a device"


def read_yaml(path: Path, what: str) -> dict[str, Any]:
    """Read a YAML mapping.

    Raises:
        ConfigError: the file is missing, unreadable, too long, not YAML (see ``load_yaml``), or not
            a mapping.
    """
    return mapping_of(read_text(path, what), path, what)


def mapping_of(text: str, path: Path, what: str) -> dict[str, Any]:
    """Return the YAML mapping in the text of a file.

    Raises:
        ConfigError: it is not YAML (see ``load_yaml``), or not a mapping.
    """
    try:
        data = load_yaml(text)
    except (yaml.YAMLError, RecursionError) as error:
        mark = getattr(error, "problem_mark", None)
        where = f" at line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        raise ConfigError(
            f"{what} {path}: not valid YAML{where}{yaml_problem(error)}; correct it there"
        ) from error
    if not isinstance(data, dict):
        found = "nothing" if data is None else type(data).__name__
        raise ConfigError(f"{what} {path}: expected keys and values, found {found}")
    return data


def yaml_problem(error: Exception) -> str:
    """Return the loader's message about a text, in brackets; empty if there is none."""
    problem = getattr(error, "problem", None)
    return f" ({problem})" if isinstance(problem, str) and problem else ""


def read_text(path: Path, what: str) -> str:
    """Read a user's text file.

    Raises:
        ConfigError: the file is missing, unreadable, too long, or not UTF-8.
    """
    try:
        refuse_named_pipe(path)
        with path.open(encoding="utf-8") as file:
            text = file.read(MAX_CHARACTERS + 1)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the path, or not UTF-8
        reason = (error.strerror if isinstance(error, OSError) else None) or "it is not UTF-8 text"
        hint = _nearest_shipped(path, what) if isinstance(error, FileNotFoundError) else ""
        raise ConfigError(
            f"{what} {path}: cannot be read: {reason}{hint}; check the path"
        ) from error
    if len(text) > MAX_CHARACTERS:
        raise ConfigError(f"{what} {path}: longer than {MAX_CHARACTERS} characters; check the path")
    return text


_SHIPPED = {"robot file": "robots", "trajectory file": "trajectories", "joint map": "skeletons"}
"""Folders under ``configs/`` of the kinds of file that are also known by a shipped name."""


def _nearest_shipped(path: Path, what: str) -> str:
    """Return ``"; did you mean 'ur5e'?"`` for a file named like a shipped one, or ``""``."""
    if what not in _SHIPPED:
        return ""
    shipped = sorted(p.stem for p in data_path(_SHIPPED[what]).glob("*.yaml"))
    return nearest(path.stem, shipped, cutoff=0.75)


def load_yaml(text: str) -> Any:
    """Read one YAML document of plain values.

    Raises:
        yaml.YAMLError: not YAML; a key twice in one mapping; an alias inside itself; too many
            values after expanding aliases; or a scalar that is too long, contains a control
            character, does not match its form or tag, or is a number that YAML 1.1 reads
            differently from common usage (010, 1:00, 1_0).
        RecursionError: nested too deeply.
    """
    return deepcopy(_parsed(text))


def line_of(text: str, keys: Sequence[str | int]) -> int:
    """Return the line, from 1, of the value at ``keys`` in a YAML text; if a key is missing, the
    line of the last value found.
    """
    node = _composed(text)
    line = 1 if node is None else node.start_mark.line + 1
    for key in keys:
        if isinstance(node, yaml.MappingNode):
            pair = next((pair for pair in node.value if pair[0].value == str(key)), None)
            if pair is None:
                break
            node, line = pair[1], pair[0].start_mark.line + 1
        elif isinstance(node, yaml.SequenceNode) and isinstance(key, int) and key < len(node.value):
            node = node.value[key]
            line = node.start_mark.line + 1
        else:
            break
    return line


@lru_cache(maxsize=4)
def _composed(text: str) -> yaml.Node | None:
    node: yaml.Node | None = yaml.compose(text, Loader=_Loader)
    return node


@lru_cache(maxsize=32)
def _parsed(text: str) -> Any:
    """Cached, because a cell names the same robot file several times and parsing takes 10 to 20
    ms.
    """
    return yaml.load(text, Loader=_Loader)  # derived from the safe loader


class _Loader(yaml.SafeLoader):
    def get_single_node(self) -> Any:
        node = super().get_single_node()
        if node is not None:
            _check(node, {})
        return node

    def construct_object(self, node: yaml.Node, deep: bool = False) -> Any:
        try:
            return super().construct_object(node, deep)
        except (ValueError, KeyError, AttributeError, TypeError, OverflowError) as error:
            kind = node.tag.rsplit(":", 1)[-1]
            raise _error(f"{_short(node)} is not a valid {kind}", node) from error


def _check(node: yaml.Node, sizes: dict[int, int]) -> int:
    """Return the number of values in ``node`` with aliases expanded; ``sizes`` has those of checked
    nodes (0: in progress).
    """
    if isinstance(node, yaml.ScalarNode):
        _check_scalar(node)
        return 1
    if id(node) in sizes:
        if sizes[id(node)] == 0:
            raise _error("an alias refers to a value that contains it", node)
        return sizes[id(node)]
    sizes[id(node)] = 0
    if isinstance(node, yaml.MappingNode):
        _check_keys(node)
        children = [child for pair in node.value for child in pair]
    else:
        children = node.value
    size = 1 + sum(_check(child, sizes) for child in children)
    if size > MAX_VALUES:
        raise _error(f"more than {MAX_VALUES} values, with aliases expanded", node)
    sizes[id(node)] = size
    return size


def _check_scalar(node: yaml.ScalarNode) -> None:
    if len(node.value) > MAX_SCALAR:
        raise _error(f"a value of more than {MAX_SCALAR} characters", node)
    if any((ord(c) < 32 and c not in "\n\t") or ord(c) == 127 for c in node.value):
        raise _error(f"{_short(node)} contains a control character", node)
    if problem := _number_problem(node):
        raise _error(f"{_short(node)} {problem}", node)


def _number_problem(node: yaml.ScalarNode) -> str | None:
    """Return why YAML misreads a number; ``None`` for other numbers and quoted text."""
    number = node.tag in _NUMBERS
    if (number or node.style is None) and _ZERO_FIRST.fullmatch(node.value):
        return (
            "starts with a zero, so YAML reads it as octal: write it without the zero, with 0x if "
            "it is hexadecimal, or in quotes if it is text"
        )
    if number and ":" in node.value:
        return (
            "has a colon, so YAML reads it in base 60: write a plain number, or quote it if it is "
            "text"
        )
    if number and re.search("[0-9A-Fa-f]_", node.value):
        return "has an underscore, which YAML ignores; remove it, or quote it if it is text"
    return None


def _check_keys(node: yaml.MappingNode) -> None:
    first: dict[str, int] = {}
    for key, _ in node.value:
        if not isinstance(key, yaml.ScalarNode):
            continue
        line = key.start_mark.line + 1
        if key.value in first:
            raise _error(f"key {_short(key)} is already in line {first[key.value]}", key)
        first[key.value] = line


def _short(node: yaml.Node) -> str:
    text = repr(node.value) if isinstance(node, yaml.ScalarNode) else node.tag
    return text if len(text) < 60 else text[:57] + "..."


def _error(problem: str, node: yaml.Node) -> yaml.YAMLError:
    return yaml.constructor.ConstructorError(None, None, problem, node.start_mark)
