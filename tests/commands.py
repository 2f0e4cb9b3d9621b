"""The command line: as a tree, for tests that go through all of it, and called."""

import sys
from collections.abc import Mapping
from functools import cache
from typing import Any

import pytest
import typer

from hri_predict.cli import main
from hri_predict.cli.commands import Commands, app


@cache
def root() -> Any:
    """The command ``hri-predict`` itself."""
    return typer.main.get_command(app)


@cache
def children(command: Any) -> Mapping[str, Any]:
    """Name -> command, of the commands that a group has; empty for a command without any."""
    if not isinstance(command, Commands):
        return getattr(command, "commands", {})
    context = typer.Context(command)
    names = command.list_commands(context)
    return {name: command.resolve_command(context, [name])[1] for name in names}


def status_of(*arguments: object) -> int:
    """Run ``hri-predict`` with these arguments in this process; gives its exit status."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["hri-predict", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
    assert isinstance(ended.value.code, int | None)
    return ended.value.code or 0
