"""The entry point of the command line: the ways a command can end, and their exit statuses."""

import errno
import os
import sys
from typing import NoReturn

from hri_predict.errors import ConfigMistakes, HriPredictError
from hri_predict.service import logs

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def main() -> None:
    """Run the command; report a user's mistakes, a line each on standard error, exit status 2.

    The exit status is 130 after Ctrl-C. Otherwise the command sets it (1: a person was touched).
    """
    _stand_in()
    logs.set_up()
    status: object = 0
    try:
        status = _run()
        sys.stdout.flush()  # buffered output may fail to be written, too
    except ConfigMistakes as error:
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
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            _fail(f"{error.filename}: {error.strerror}; choose a shorter one")
        if not (isinstance(error, OSError) and error.errno in _NO_ROOM and error.filename is None):
            raise
        sys.stdout = None
        _fail(f"the output cannot be written: {error.strerror}; write it to a disk with free space")
    sys.exit(status if isinstance(status, int) else 0)


def _stand_in() -> None:
    """Give a closed standard file a stand-in that takes everything.

    The next file that is opened, a serial port perhaps, would otherwise take its number, and get
    what libraries print.
    """
    for number in range(3):
        try:
            os.fstat(number)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # the lowest that is free
    if sys.stdout is None:
        sys.stdout = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")
    if sys.stderr is None:
        sys.stderr = os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8")


def _run() -> object:
    """Run the command that ``sys.argv`` names, and return its exit status.

    The commands are imported here because that takes most of a second, and Ctrl-C during the
    import must end the program quietly, too.
    """
    from hri_predict.cli.commands import app

    try:
        return app(standalone_mode=False, prog_name="hri-predict")
    except SystemExit as error:  # rich exits with status 1 when the reader of a table has gone
        if error.code == 1:
            raise BrokenPipeError from error
        raise


def _misused(error: Exception, message: str) -> NoReturn:
    """Report a wrong command line. Without arguments the help has already been printed."""
    context = getattr(error, "ctx", None)
    command = "hri-predict" if context is None else context.command_path
    message = " ".join(message.split()).rstrip(".")
    if not message:
        sys.exit(2)
    _fail(f"{message}; see {command} --help")


def _fail(*messages: str) -> NoReturn:
    """Print each error as one line, whatever characters a name or value in it contains."""
    journal = "<3>" if logs.in_journal(sys.stderr) else ""
    for message in messages:
        line = "".join(
            c if c.isprintable() else c.encode("unicode_escape").decode() for c in message
        )
        print(f"{journal}error: {line}", file=sys.stderr)
    sys.exit(2)
