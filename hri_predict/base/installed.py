"""Entry points of the installed packages, although those of one package may be damaged.

Python reads the entry points of all packages together, so one damaged file, of any package, raises
an error in every library that looks for its plug-ins: pydantic, torch, numba and python-can do so
when they are imported or first used. In this project's own processes such a file counts as empty.
"""

import json
import logging
import os
import re
import shlex
import sys
from importlib import metadata
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit
from urllib.request import url2pathname

from hri_predict.base.errors import first_line

OWN_PROCESS = "HRI_PREDICT_OWN_PROCESS"
"""Environment variable of the command line and of all processes that it starts."""

_COMMAND = re.compile(r"pip install 'hri-predict(\[[a-z0-9_,]+\])'")
_log = logging.getLogger(__name__)
_read: Any = metadata.Distribution.entry_points
_reported: set[str] = set()


def entry_points() -> list[metadata.EntryPoint]:
    """Return the entry points of all packages; a later package of the same name is ignored.

    A package whose entry points cannot be read is left out, with a warning.
    """
    seen: set[str] = set()
    found: list[metadata.EntryPoint] = []
    for package in metadata.distributions():
        name = getattr(package, "_normalized_name", None) or name_of(package)
        if name not in seen:
            seen.add(name)
            found += _readable(package)
    return found


def name_of(package: metadata.Distribution) -> str:
    """Return the name of a package; its folder if its metadata cannot be read either."""
    try:
        return package.metadata["Name"] or _folder_of(package)
    except Exception:
        return _folder_of(package)


def for_this_installation(message: str) -> str:
    """Return ``message`` with commands that work here in place of ``pip install 'hri-predict[x]'``.

    In a clone (an editable installation) the extra comes from the clone's folder, with the versions
    in its ``constraints.txt``; pip would look for the name alone in a package index.
    """
    if _COMMAND.search(message) is None or (folder := _clone()) is None:
        return message
    python = shlex.quote(sys.executable)

    def here(found: re.Match[str]) -> str:
        constraints = shlex.quote(str(Path(folder, "constraints.txt")))
        return f"{python} -m pip install -c {constraints} -e {shlex.quote(folder + found[1])}"

    return _COMMAND.sub(here, message)


def _clone() -> str | None:
    """Return the folder of an editable installation of this project; ``None`` for any other."""
    try:
        text = metadata.distribution("hri-predict").read_text("direct_url.json")
        about = json.loads(text or "{}")
        editable = about.get("dir_info", {}).get("editable", False)
        return url2pathname(urlsplit(about["url"]).path) if editable else None
    except (metadata.PackageNotFoundError, OSError, ValueError, KeyError, AttributeError):
        return None


def tolerate_damage() -> None:
    """Let every library of this process, and of those that it starts, ignore damaged entry points.

    For the command line only: this changes ``importlib.metadata``, which a user's own program
    shares with us.
    """
    os.environ[OWN_PROCESS] = "1"
    _log.setLevel(logging.NOTSET)
    metadata.Distribution.entry_points = property(_readable)  # type: ignore[assignment, method-assign]


def continue_tolerating() -> None:
    """``tolerate_damage`` in a process of the command line, which has already warned."""
    tolerate_damage()
    _log.setLevel(logging.ERROR)


def _readable(package: metadata.Distribution) -> metadata.EntryPoints:
    try:
        return _read.fget(package)
    except Exception as error:  # the parser raises whatever it stumbles over
        folder = _folder_of(package)
        if folder not in _reported:
            _reported.add(folder)
            _log.warning(
                "package '%s': the file entry_points.txt in %s is damaged (%s), so the package's "
                "plug-ins are ignored; reinstall the package, or delete that folder",
                name_of(package), folder, _said(error),
            )  # fmt: skip
        return metadata.EntryPoints()


def _said(error: Exception) -> str:
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8"
    if isinstance(error, TypeError):  # of the parser's pair of name and value
        return "a line is not 'name = value'"
    return f"{type(error).__name__}: {first_line(error)}"


def _folder_of(package: metadata.Distribution) -> str:
    return str(getattr(package, "_path", package))
