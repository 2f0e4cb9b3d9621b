"""``discover``: list the nodes, sources and controllers on the network."""

import json
import math
from typing import Annotated

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table
from rich.text import Text

from hri_predict.base.errors import ConfigError
from hri_predict.base.settings import validated
from hri_predict.cli.common import JsonOption
from hri_predict.protocol.discovery.services import LOOPBACK, DiscoverySettings, Service

MAX_SECONDS = 3600.0
_SHOWN = {"node": ("node", "predictor", "rate", "links", "schema", "version")}


def discover(
    seconds: Annotated[float, typer.Option(help="Seconds to search.")] = 3.0,
    interface: Annotated[
        list[str] | None,
        typer.Option(help="Address of an interface to search on; default 127.0.0.1. Repeatable."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the nodes, sources and controllers announced on the network.

    This is only a hint: an announcement does not prove that a device is alive; only its data do.

    Example: hri-predict discover --seconds 3
    """
    if not 0 < seconds <= MAX_SECONDS or math.isnan(seconds):
        raise ConfigError(f"--seconds {seconds}: give a number above 0, up to {MAX_SECONDS:g}")
    settings = validated(DiscoverySettings, {"interfaces": interface or LOOPBACK}, "--interface")
    from hri_predict.protocol.discovery import browser  # loads zeroconf

    services = browser.discover(seconds, settings.interfaces)
    if as_json:
        print(json.dumps([service.as_dict() for service in services]))
        return
    console = Console()
    if not services:
        where = ", ".join(settings.interfaces)
        console.print(f"no announcement received on {where}; see docs/guides/discover.md")
        return
    console.print(_table(services))
    console.print(
        "This is only a hint: an announcement does not prove that a device is alive, its data do.",
        highlight=False,
    )


def _table(services: list[Service]) -> Table:
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for name in ("kind", "name", "at", "liveness", "says"):
        table.add_column(name, overflow="fold")
    names = [s.properties.get("node") for s in services if s.kind == "node"]
    for s in services:
        at = ", ".join(s.addresses) + (f" port {s.port}" if s.port else "")
        says = {k: v for k, v in s.properties.items() if k in _SHOWN.get(s.kind, (k,))}
        text = Text("  ".join(f"{k}={v}" for k, v in says.items()))
        if s.kind == "node" and names.count(s.properties.get("node")) > 1:
            text.append("  (another node has the same name)", style="bold yellow")
        style = "green" if s.liveness == "answers" else "bold red"
        table.add_row(s.kind, Text(s.name), Text(at), Text(s.liveness, style=style), text)
    return table
