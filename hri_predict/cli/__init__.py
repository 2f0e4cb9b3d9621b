"""The command line's entry point: every way in which a command can end, and its exit status."""

import errno
import logging
import sys
from typing import NoReturn

from hri_predict.errors import HriPredictError

_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)


def main() -> None:
    """Entry point: a user's mistake is one line on standard error and exit status 2.

    Exit status 130 after Ctrl-C; what a command says itself otherwise (1: somebody was touched).
    """
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s", stream=sys.stderr)
    status: object = 0
    try:
        status = _run()
        sys.stdout.flush()  # what is still to be written may fail, too
    except HriPredictError as error:
        _fail(str(error))
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output went away
        sys.stdout = None  # nothing more can be flushed to it
    except Exception as error:
        explain = getattr(error, "format_message", None)  # the parser's own errors have it
        if explain is not None:
            _misused(error, explain())
        if type(error).__name__ == "Abort":  # what typer makes of Ctrl-C
            sys.exit(130)
        if not (isinstance(error, OSError) and error.errno in _NO_ROOM and error.filename is None):
            raise
        sys.stdout = None
        _fail(f"the output cannot be written: {error.strerror}; send it where there is room")
    sys.exit(status if isinstance(status, int) else 0)


def _run() -> object:
    """Run the command that ``sys.argv`` names; returns its exit status.

    Imported here: that takes most of a second, in which Ctrl-C must end quietly, too.
    """
    from hri_predict.cli.commands import app

    try:
        return app(standalone_mode=False, prog_name="hri-predict")
    except SystemExit as error:  # rich ends so, with status 1, when the reader of a table is gone
        if error.code == 1:
            raise BrokenPipeError from error
        raise


def _misused(error: Exception, message: str) -> NoReturn:
    """The command line itself is wrong; without any arguments its help was printed already."""
    context = getattr(error, "ctx", None)
    command = "hri-predict" if context is None else context.command_path
    message = " ".join(message.split()).rstrip(".")
    if not message:
        sys.exit(2)
    _fail(f"{message}; see {command} --help")


def _fail(message: str) -> NoReturn:
    """One line, whatever a name or value in it holds."""
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message)
    print(f"error: {line}", file=sys.stderr)
    sys.exit(2)
