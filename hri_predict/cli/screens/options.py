"""Options for a 3D view and an operator page, for commands that run the node."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from typing import Annotated
from urllib.parse import urlsplit

import typer

from hri_predict.base.errors import ConfigError
from hri_predict.base.installed import for_this_installation
from hri_predict.cli.common import without_effect
from hri_predict.viewing import feed
from hri_predict.viewing.feed import Feed
from hri_predict.viewing.screen import LOOPBACK, ScreenSettings

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
        help="Address that the 3D view and the operator's page listen on. Everyone who can reach "
        "it can see where people are.",
    ),
]
OperatorUrl = Annotated[
    list[str] | None,
    typer.Option(
        "--operator-url",
        metavar="URL",
        help="Address under which a proxy serves the operator's page, such as "
        "https://plant.example/cells/7. Repeatable.",
    ),
]


def published(operator: int | None, urls: list[str] | None) -> tuple[str, ...]:
    """Return the addresses of ``--operator-url``.

    Raises:
        ConfigError: an address is not valid, or ``--operator`` was not given.
    """
    if operator is None:
        without_effect({"--operator-url": urls}, "without --operator")
    for url in urls or ():
        try:
            parts = urlsplit(url)
            good = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
            good = good and not (parts.query or parts.fragment or "@" in parts.netloc)
        except ValueError:
            good = False
        if not good:
            raise ConfigError(
                f"--operator-url {url}: write it as https://HOST or https://HOST/PATH"
            )
    return tuple(urls or ())


def screens(
    viewer: int | None,
    operator: int | None,
    host: str,
    urls: list[str] | None = None,
    *,
    opened: Callable[[str], None] | None = None,
) -> AbstractContextManager[Feed | None]:
    """Return the feed of the requested screens; nothing if none was requested.

    ``opened`` is called with the address of each screen once it is listening.

    Raises:
        ConfigError: the 3D view's library is missing, an address of a proxy is wrong, or no screen
            listens on ``host``.
    """
    behind = published(operator, urls)
    if viewer is None and operator is None and host != LOOPBACK:
        without_effect({"--viewer-host": host}, "without --viewer or --operator")
    asked = []
    if viewer is not None:
        feed.check_viser()
        asked.append(ScreenSettings("viewer", feed.VIEWER, viewer, host))
    if operator is not None:
        asked.append(ScreenSettings("operator", feed.OPERATOR, operator, host, behind))
    return Feed(asked, opened) if asked else nullcontext()


def addresses(shown: Feed | None) -> str:
    """Return the line with the screens' addresses for the bottom of the terminal's view."""
    places = [] if shown is None else [f"{k}: {v}" for k, v in shown.addresses.items()]
    return "  ".join([*places, "Ctrl-C ends it"] if places else [])


def how_to_see() -> str:
    """Return one line that suggests the next step after the demo."""
    text = "in 3D without a time limit, or with yourself in front of a camera: hri-predict try"
    if feed.has_viser():
        return text
    needs = "; it needs packages; install them with: pip install 'hri-predict[viewer,camera]'"
    return for_this_installation(text + needs)
