"""``service``: the systemd unit for a cell."""

import os
import shlex
import sys
from collections.abc import Iterator
from pathlib import Path
from string import ascii_letters, digits
from typing import Annotated

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.base.files import atomic_write, data_path, read_text
from hri_predict.commissioning.identity import canonical, dependencies, flattened, texts_of
from hri_predict.run import config as configuration
from hri_predict.run.config import Config

_SETTINGS = "/etc/hri-predict"
UNIT = "hri-predict@.service"
_PROGRAM = "/opt/hri-predict/bin/hri-predict"  # as in the shipped unit
_PLAIN = frozenset(f"{ascii_letters}{digits}/:_.-")
_HIDDEN = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # by ProtectHome, PrivateTmp
_WRITABLE = ("/var/lib/hri-predict", "/var/log/hri-predict", "/var/cache/hri-predict")


def service(
    config: Annotated[Path, typer.Argument(help="The node's YAML configuration.")],
    folder: Annotated[
        Path | None,
        typer.Option(help="Folder to write the unit into, such as /etc/systemd/system."),
    ] = None,
) -> None:
    """Print the systemd unit that runs a cell, or write it into a folder.

    Example: hri-predict service cell.yaml
    """
    loaded = configuration.load(config)
    cell = instance(loaded.path.stem)
    program = Path(sys.argv[0])
    to_copy, missing = own_files(loaded)
    for line in [*unwritable(loaded, cell), *hidden(program), *missing]:
        print(f"warning: {line}", file=sys.stderr)
    text = unit_text(program, loaded)
    if folder is None:
        print(text, end="")
        return
    path = folder / UNIT
    try:
        atomic_write(path, text.encode())
    except OSError as error:
        raise ConfigError(
            f"--folder {folder}: {error.strerror}; name a folder that you may write to"
        ) from error
    print(f"{path}: written. Next, as root:")
    print("  useradd --system --user-group hri-predict")
    for words in (
        _install(loaded.path, f"{cell}.yaml"),
        *(_install(path, to, is_secret=_is_secret(key)) for key, path, to in to_copy),
        ["systemctl", "daemon-reload"],
        ["systemctl", "enable", "--now", f"hri-predict@{cell}"],
    ):  # fmt: skip
        print(f"  {shlex.join(words)}")


def _install(path: Path, to: str, *, is_secret: bool = False) -> list[str]:
    """Return the command that copies a file, so that the service may read it; a key by it alone."""
    access = ["-m", "0400", "-o"] if is_secret else ["-m", "0640", "-g"]
    return ["install", "-D", *access, "hri-predict", str(path), f"{_SETTINGS}/{to}"]


def unit_text(program: Path, config: Config) -> str:
    """Return the shipped unit with this program's path and the configured priority."""
    text = read_text(data_path("service", UNIT), "unit")
    if program.name == "hri-predict" and program.is_file():
        # no link is followed: a virtual environment's program is the one beside its Python
        text = text.replace(_PROGRAM, unit_command(str(program.absolute())))
    else:
        text = text.replace(_PROGRAM, f"{unit_command(sys.executable)} -m hri_predict")
    priority = config.node.realtime.priority
    if priority is not None:
        text = text.replace("LimitRTPRIO=50", f"LimitRTPRIO={priority}")
    return text


def unit_command(program: str) -> str:
    """Return a program's path for ``ExecStart`` (systemd.service(5), systemd.syntax(7)).

    ``%`` starts a specifier anywhere, and ``$`` a variable in all words but the first. systemd
    rejects quotes, backslashes and control characters in the first word; for such paths ``env`` is
    the first word.
    """
    if set(program) <= _PLAIN:
        return program
    word = "".join(
        c if c.isprintable() else "".join(f"\\x{byte:02x}" for byte in os.fsencode(c))
        for c in program.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
    )
    if word.count("\\") or "'" in program:
        return '/usr/bin/env "{}"'.format(word.replace("$", "$$"))
    return f'"{word}"'


def instance(cell: str) -> str:
    """Return the instance name of a cell: as ``systemd-escape`` writes it, except for ``-``."""
    return "".join(
        c if c in _PLAIN and c != "/" else "".join(f"\\x{byte:02x}" for byte in os.fsencode(c))
        for c in cell
    )


def unwritable(config: Config, cell: str) -> list[str]:
    """Return the paths that the unit makes read-only, one line each with the remedy."""
    node = config.node
    record = node.record
    wanted = {
        "alerts.file": (node.alerts.file, "log"),
        "state": (None if node.state is None else node.state.path, "lib"),
        "record": (None if record is None else record.folder or record.file, "lib"),
        "evidence": (None if node.evidence is None else node.evidence.folder, "lib"),
    }
    return [
        f"{key}: the service may not write {path}; name a place in /var/{kind}/hri-predict/{cell}"
        for key, (path, kind) in wanted.items()
        if path is not None
        and not any(Path(path).is_relative_to(f"{place}/{cell}") for place in _WRITABLE)
    ]


def hidden(program: Path) -> list[str]:
    """Return a line with the remedy if the unit hides the program itself from the service."""
    if not any(program.absolute().is_relative_to(place) for place in _HIDDEN):
        return []
    return [
        f"ExecStart: the unit hides {program.absolute()} (ProtectHome, PrivateTmp); install the "
        f"node where a service may read it, such as /opt/hri-predict"
    ]


def own_files(config: Config) -> tuple[list[tuple[str, Path, str]], list[str]]:
    """Return the files that the service needs in its configuration's folder, and those it misses.

    Returns:
        Key of the configuration, file, and its path in the folder of the service's configurations;
        and one line with the remedy for each file that cannot be copied there or is hidden.
    """
    to_copy: dict[str, tuple[str, Path, str]] = {}
    problems = []
    for key, text, path in _named_files(config):
        to = os.path.normpath(text)
        if Path(text).is_absolute():
            if any(Path(to).is_relative_to(place) for place in _HIDDEN):
                problems.append(f"{key}: the unit hides {path} (ProtectHome, PrivateTmp); move it")
        elif to.startswith(".."):
            problems.append(f"{key}: {text} is outside {config.base_dir}; put it there")
        elif not path.is_file():
            problems.append(f"{key}: {path}: no such file, so the service will not find it either")
        else:
            to_copy.setdefault(to, (key, path, to))
    report = config.node.commissioning
    if report is not None and not Path(report.report).is_absolute():
        problems.append(
            f"commissioning.report: copy {config.base_dir / report.report}, with the other files "
            f"of its folder, to {_SETTINGS}/{report.report}"
        )
    return list(to_copy.values()), problems


def _named_files(config: Config) -> Iterator[tuple[str, str, Path]]:
    """Return key, text and file of each file that the configuration names, and does not write."""
    flat = flattened(canonical(config))
    texts = dict(texts_of(flat))
    for key, path in dependencies(config, flat).items():
        text = texts.get(key)
        if text is not None and config.base_dir / text == path:  # otherwise it is shipped
            yield key, text, path
    for key, text in texts.items():  # keys and secrets, which the identity leaves out
        if key.endswith("_file") and text:
            yield key, text, config.base_dir / text


def _is_secret(key: str) -> bool:
    name = key.rpartition(".")[2]
    return name.endswith(("_file", "_key")) and name != "ca_file"
