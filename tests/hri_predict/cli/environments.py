"""Runs command lines, each in a process forked from this one, in an environment of its own.

Reads a JSON list of ``[environment, command line]``; prints a JSON list of ``[status, output,
errors]``. Only the import of the commands, and of the packages named after the folder, is shared: a
fork has the standard files, encodings and limits that a shell would give it.
"""

import contextlib
import importlib
import io
import json
import os
import resource
import signal
import sys
import tempfile
from pathlib import Path
from typing import Any

from tests.commands import children, root

ENCODINGS = {"ascii": "ascii", "latin-1": "latin-1"}
LIMIT_S = 120
CLOSED = {"no stdin": (0,), "no stdout": (1,), "no stderr": (2,), "nothing open": (0, 1, 2)}
ENVIRONMENTS = (*ENCODINGS, *CLOSED, "full disk", "no temporary folder", "no home")
CRASHED = 99


def main() -> None:
    """See the module."""
    folder, *packages = sys.argv[1:]
    _import_all(root())
    for name in packages:
        with contextlib.suppress(ImportError):
            importlib.import_module(name)
    runs = json.loads(sys.stdin.read())
    print(json.dumps([_forked(line, environment, Path(folder)) for environment, line in runs]))


def _import_all(command: Any) -> None:
    for below in children(command).values():
        _import_all(below)


def _forked(arguments: list[str], environment: str, folder: Path) -> tuple[int, str, str]:
    said = [folder / "out", folder / "err"]
    child = os.fork()
    if not child:
        try:
            _prepare(environment, said)
            os._exit(_run(arguments, folder / "err"))
        finally:
            os._exit(CRASHED)
    _, status = os.waitpid(child, 0)
    texts = [path.read_text(errors="replace") for path in said]
    return os.waitstatus_to_exitcode(status), texts[0], texts[1]


def _prepare(environment: str, said: list[Path]) -> None:
    """Make the standard files and the surroundings of a new process."""
    signal.alarm(LIMIT_S)
    encoding = ENCODINGS.get(environment, "utf-8")
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC
    numbers = [os.open(os.devnull, os.O_RDONLY), *(os.open(path, flags) for path in said)]
    if environment == "full disk":
        numbers[1] = os.open("/dev/full", os.O_WRONLY)
    for k, number in enumerate(numbers):
        os.dup2(number, k)
    sys.stdin = io.TextIOWrapper(os.fdopen(0, "rb", closefd=False), encoding=encoding)
    for name, k in (("stdout", 1), ("stderr", 2)):
        raw: Any = os.fdopen(k, "wb", closefd=False)
        setattr(sys, name, io.TextIOWrapper(raw, encoding=encoding, errors="strict"))
    for k in CLOSED.get(environment, ()):
        os.close(k)
        setattr(sys, ("stdin", "stdout", "stderr")[k], None)
    if environment == "no home":
        os.environ.pop("HOME", None)
    if environment == "no temporary folder":  # a disk without room for it, as ulimit -f 0 makes
        tempfile.tempdir = None
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        os.environ["TMPDIR"] = "/nonexistent"
        resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
        for k in (1, 2):  # a pipe's reader has no such limit
            os.dup2(os.open(os.devnull, os.O_WRONLY), k)


def _run(arguments: list[str], errors: Path) -> int:
    from hri_predict import cli

    sys.argv = ["hri-predict", *arguments]
    try:
        cli.main()
    except SystemExit as ended:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
        return ended.code if isinstance(ended.code, int) else 0
    except BaseException as error:
        errors.write_text(f"Traceback of {error!r}")
    return CRASHED


if __name__ == "__main__":
    main()
