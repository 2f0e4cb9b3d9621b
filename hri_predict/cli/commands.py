"""The commands, each found by its name in the entry-point group ``hri_predict.commands``.

A command's module is imported only when the command is called, so ``--help`` and ``--version`` load
no libraries that they do not need. The text that ``--help`` shows for a command is read from its
source file: the first paragraph of its function's docstring, or of its module's for a group.
"""

import inspect
import re
import sys
from functools import lru_cache
from importlib import metadata, util
from pathlib import Path
from types import FunctionType
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from hri_predict import __version__
from hri_predict.base import installed

ORDER = (
    "demo", "try", "camera", "cameras", "camera-calibration", "run", "init", "check", "alerts",
    "register", "commission", "replay", "explain", "report", "view", "listen", "fleet",
    "evidence", "service", "discover", "predictors", "conformance", "train", "ablate", "evaluate",
    "card", "calibrate", "simulate", "convert", "topics", "urdf", "bench", "config", "protocol",
)  # fmt: skip
"""Order of the commands in ``--help``; those of other packages follow by name."""


class Commands(TyperGroup):
    """The registered commands."""

    def list_commands(self, ctx: Any) -> list[str]:
        """Return all names, in the order of ``--help``."""
        points = _points()
        return [*(n for n in ORDER if n in points), *sorted(set(points) - set(ORDER))]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command for the list: its name and text, without code to run."""
        point = _points().get(cmd_name)
        return None if point is None else TyperCommand(cmd_name, help=_summary(point))

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Import the command named by the first argument."""
        name, _, rest = super().resolve_command(ctx, args)
        if name is None:
            return None, None, rest
        from hri_predict.base.errors import ConfigError
        from hri_predict.contracts import registry

        part = registry.load("commands", name)
        if not isinstance(part, typer.Typer):
            function, part = part, typer.Typer(add_completion=False)
            if not isinstance(function, FunctionType):
                raise ConfigError(
                    f"command '{name}' is not a function; fix the package that provides it"
                )
            part.command()(function)
        command = typer.main.get_command(part)
        command.name = name
        return name, command, rest


def _points() -> dict[str, metadata.EntryPoint]:
    return _scanned(tuple(sys.path))


@lru_cache(maxsize=1)
def _scanned(_path: tuple[str, ...]) -> dict[str, metadata.EntryPoint]:
    """Return the commands of all packages on the path; the scan reads all entry-point files."""
    points = installed.entry_points()
    return {point.name: point for point in points if point.group == "hri_predict.commands"}


def _summary(point: metadata.EntryPoint) -> str:
    """Return the first paragraph of a command's docstring, read from its source text.

    Importing all commands takes seconds, and parsing their files longer than the rest of the list.
    """
    try:
        package, *inside = point.module.split(".")
        found = util.find_spec(package)
        path = Path(found.origin if found is not None and found.origin is not None else "")
        if inside:
            path = path.parent.joinpath(*inside)
            path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        text = path.read_text(encoding="utf-8")
    except (AttributeError, OSError, ValueError):
        return ""  # a package that is damaged, or no file: calling the command says why
    function = re.search(rf"^def {point.attr}\(.*?(?=^[^\s)]|\Z)", text, re.M | re.S)
    docstring = re.search(
        r'^ *"""(.*?)(?:\n\n|""")', function[0] if function else text, re.M | re.S
    )
    return "" if docstring is None else inspect.cleandoc(docstring[1])


app = typer.Typer(
    cls=Commands,
    help="Predict where people near a robot will be, and advise the robot's controller in time.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"hri-predict {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, help="Print the version and exit.")
    ] = False,
) -> None:
    """Accept the options before a command's name; the app holds the help text."""
