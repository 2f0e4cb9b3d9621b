"""The options of commands that run the node: a 3D view and an operator page."""

from contextlib import AbstractContextManager, nullcontext
from typing import Annotated

import typer

from hri_predict.viewing import feed
from hri_predict.viewing.feed import Feed
from hri_predict.viewing.screen import ScreenSettings

Viewer = Annotated[
    int | None,
    typer.Option(
        "--viewer", metavar="PORT", help="Show the cell in 3D in a browser; 0: any free port."
    ),
]
Operator = Annotated[
    int | None,
    typer.Option("--operator", metavar="PORT", help="Serve the operator's page; 0: any free port."),
]
Host = Annotated[
    str,
    typer.Option(
        "--viewer-host",
        help="Address that the 3D view and the operator's page listen on. Whoever reaches it sees "
        "where people are.",
    ),
]


def screens(
    viewer: int | None, operator: int | None, host: str
) -> AbstractContextManager[Feed | None]:
    """What feeds the screens that were asked for; nothing if none was.

    Raises:
        ConfigError: the 3D view's library is missing.
    """
    asked = []
    if viewer is not None:
        feed.check_viser()
        asked.append(ScreenSettings("viewer", feed.VIEWER, viewer, host))
    if operator is not None:
        asked.append(ScreenSettings("operator", feed.OPERATOR, operator, host))
    return Feed(asked) if asked else nullcontext()
