"""The command line: ``hri-predict demo | run | check | replay | listen | predictors | bench``."""

import logging
import sys
from typing import NoReturn

import typer
from typer import Abort

from hri_predict.cli import bench, check, listen, run
from hri_predict.errors import HriPredictError

app = typer.Typer(
    help="Predicts where people near a robot will be, and advises the robot's controller in time.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(run.demo)
app.command()(run.run)
app.command()(check.check)
app.command()(run.replay)
app.command()(listen.listen)
app.command()(check.predictors)
app.add_typer(bench.app, name="bench")


def main() -> None:
    """Entry point: a user's mistake is one line on standard error and exit status 2."""
    logging.basicConfig(level=logging.WARNING, format="%(name)s: %(message)s", stream=sys.stderr)
    try:
        status = app(standalone_mode=False, prog_name="hri-predict")
    except HriPredictError as error:
        _fail(str(error))
    except (KeyboardInterrupt, Abort):
        sys.exit(130)
    except BrokenPipeError:  # the reader of our output went away
        sys.stdout = None  # nothing more can be flushed to it
        sys.exit(0)
    except Exception as error:
        explain = getattr(error, "format_message", None)  # the parser's own errors have it
        if explain is None:
            raise
        _misused(error, explain())
    sys.exit(status if isinstance(status, int) else 0)


def _misused(error: Exception, message: str) -> NoReturn:
    """The command line itself is wrong; without any arguments its help was printed already."""
    context = getattr(error, "ctx", None)
    command = "hri-predict" if context is None else context.command_path
    message = " ".join(message.split()).rstrip(".")
    if not message:
        sys.exit(2)
    _fail(f"{message}; see {command} --help")


def _fail(message: str) -> NoReturn:
    print(f"error: {message}", file=sys.stderr)
    sys.exit(2)
