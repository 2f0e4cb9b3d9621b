"""Entry point of the command line: how errors are reported, and with which exit status."""

import errno
import io
import os
import sys
from typing import NoReturn

from hri_predict import __version__
from hri_predict.base.errors import ConfigMistakes, HriPredictError, LinkErrors
from hri_predict.operation.service import logs

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def main() -> None:
    """Run the command; print each user error as one line on standard error and exit with status 2.

    The exit status is 130 after Ctrl-C. Otherwise it is the command's (1: a person was touched).
    """
    _stand_in()
    logs.set_up()
    status: object = 0
    try:
        status = _run()
        sys.stdout.flush()  # buffered output may fail to be written, too
    except (ConfigMistakes, LinkErrors) as error:
        _fail(*error.lines)
    except HriPredictError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output has closed the pipe
        sys.stdout = None  # nothing more can be flushed to it
    except Exception as error:
        explain = getattr(error, "format_message", None)  # only the parser's own errors have it
        if explain is not None:
            _misused(error, explain())
        if type(error).__name__ == "Abort":  # typer turns Ctrl-C into this
            sys.exit(130)
        reason = _reason(error)
        if reason is None:
            raise
        _fail(reason)
    sys.exit(status if isinstance(status, int) else 0)


def _reason(error: Exception) -> str | None:
    """Return one line for an error of the system or its disk; ``None`` for a bug."""
    if isinstance(error, UnicodeEncodeError):
        text = str(error.object)[max(0, error.start - 20) : error.end + 20]
        return (
            f"'{text}': has characters that cannot be written as {error.encoding}; rename the file "
            f"or folder with letters that UTF-8 has"
        )
    if not isinstance(error, OSError):
        return None
    if error.errno == errno.ENAMETOOLONG:
        return f"{error.filename}: {error.strerror}; choose a shorter one"
    if "usable temporary directory" in str(error.strerror):
        return (
            "no temporary folder: nothing can be written to those of TMPDIR, /tmp and /var/tmp; "
            "free some room there, or set TMPDIR to a folder of your own"
        )
    if error.errno in _NO_ROOM and error.filename is None:
        sys.stdout = None  # nothing more can be flushed to it
        return f"the output cannot be written: {error.strerror}; write it to a disk with free space"
    return None


def _stand_in() -> None:
    """Replace closed standard streams, and make every character printable.

    Otherwise the next file opened, such as a serial port, would get the closed stream's descriptor
    and receive what libraries print. A character that the encoding lacks (``LC_ALL=C``, a file name
    that is not UTF-8) is printed as an escape such as ``\\u2265``.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest that is free
    if sys.stdin is None:
        sys.stdin = open(os.devnull, encoding="utf-8")  # noqa: SIM115
    if sys.stdout is None:
        sys.stdout = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _run() -> object:
    """Run the command named in ``sys.argv``, and return its exit status.

    The commands are imported here because the import takes most of a second, and Ctrl-C during that
    time must also exit quietly. ``--version`` alone, which scripts ask for, needs no parser.
    """
    if sys.argv[1:] == ["--version"]:
        print(f"hri-predict {__version__}")
        return 0
    from hri_predict.base import installed

    installed.tolerate_damage()
    from hri_predict.cli.commands import app

    try:
        return app(standalone_mode=False, prog_name="hri-predict")
    except SystemExit as error:  # rich exits with status 1 when the reader of a table has gone
        if error.code == 1:
            raise BrokenPipeError from error
        raise


def _misused(error: Exception, message: str) -> NoReturn:
    """Report an invalid command line. Without arguments, the help has already been printed."""
    from hri_predict.cli.commands import ORDER

    context = getattr(error, "ctx", None)  # the parser leaves it out where an option lacks a value
    name = next((f" {word}" for word in sys.argv[1:2] if word in ORDER), "")
    command = f"hri-predict{name}" if context is None else context.command_path
    message = " ".join(message.split()).rstrip(".")
    if not message:
        sys.exit(2)
    cells = [word for word in sys.argv[2:] if word.lower().endswith((".yaml", ".yml"))]
    options = [] if context is None else [o for p in context.command.params for o in p.opts]
    if "unexpected extra argument" in message and "--config" in options and cells:
        message += f"; give the configuration as --config {cells[0]}"
    _fail(f"{message}; see {command} --help")


def _fail(*messages: str) -> NoReturn:
    """Print each error as one line, even if names or values in it contain line breaks."""
    from hri_predict.base.installed import for_this_installation

    journal = "<3>" if logs.in_journal(sys.stderr) else ""
    for message in messages:
        line = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode()
            for c in for_this_installation(message)
        )
        print(f"{journal}error: {line}", file=sys.stderr)
    sys.exit(2)
