"""``fleet``: show all cells live, over zenoh."""

import json
import math
import sys
import threading
import time
from bisect import bisect_right
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Annotated, Any

import typer
from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from hri_predict.base.errors import ConfigError, HriPredictError, LinkError, failure, first_line
from hri_predict.base.looks import LOOKS
from hri_predict.base.settings import validated
from hri_predict.cli.common import wrapped_widths
from hri_predict.cli.screens.options import Host, Operator, OperatorUrl, published
from hri_predict.contracts import registry
from hri_predict.contracts.link import ObservesFleet, Transport
from hri_predict.operation.monitoring.fleet import SILENT, SILENT_S, UNKNOWN, CellRow, Fleet
from hri_predict.operation.monitoring.fleet_changes import FleetChanges
from hri_predict.operation.monitoring.fleet_levels import tile
from hri_predict.protocol.keyed import ROOT, Keyed, split_key
from hri_predict.viewing.fleet_feed import FLEET, FleetFeed
from hri_predict.viewing.screen import LOOPBACK, ScreenSettings

MAX_S, MAX_SILENT_S = 1e9, 3600.0
READ_S = 0.1
RETRY_S = 0.5
REDRAW_HZ = 4
FRAME_LINES = 7  # lines of a page around its rows
HEAD_LINES = 4  # those of them that belong to the table
_COLUMNS = {  # least widths: with the spaces between them, less than 80
    "cell": 11, "node": 8, "robots": 9, "people": 6, "age": 7, "heard": 6, "lost": 4, "because": 16
}  # fmt: skip
_BAD = ("fault", SILENT, UNKNOWN, "stop", "starting", "stopping", "degraded", "slow", "warn")
_STATES = {"running": "green", "degraded": "yellow", "fault": "white on red", SILENT: "bold red"}


def fleet(
    *,
    site: Annotated[str | None, typer.Option(help="Show only this site.")] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(help="A router or peer; default: tcp/127.0.0.1:7447. Repeatable."),
    ] = None,
    listen: Annotated[
        list[str] | None,
        typer.Option(help="Act as the router for the cells, at this endpoint. Repeatable."),
    ] = None,
    zenoh_config: Annotated[
        str | None, typer.Option(help="A zenoh configuration file, for TLS or access control.")
    ] = None,
    silent: Annotated[
        float, typer.Option(help="Show a cell as silent after this many seconds without a message.")
    ] = SILENT_S,
    seconds: Annotated[float | None, typer.Option(help="Stop after this many seconds.")] = None,
    operator: Operator = None,
    operator_url: OperatorUrl = None,
    viewer_host: Host = LOOPBACK,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print a JSON line each second and one at the end.")
    ] = False,
) -> None:
    """Show all cells live: node, level of each robot, people, age. Needs the extra 'fleet'.

    With --operator, a browser page also shows them, with the alerts of all cells.

    Example: hri-predict fleet --connect tcp/127.0.0.1:7447
    """
    for flag, value, most in (("--seconds", seconds, MAX_S), ("--silent", silent, MAX_SILENT_S)):
        if value is not None and not 0 < value <= most:
            raise ConfigError(f"{flag} {value}: give a number above 0, up to {most:.0f}")
    watch = _Watch(_observer(site, connect, listen, zenoh_config), Fleet(silent), silent)
    with watch.page(operator, viewer_host, published(operator, operator_url)):
        watch.start()
        try:
            if as_json:
                watch.print_lines(seconds)
            else:
                watch.show(seconds)
        finally:
            watch.stop()
    if not watch.ever_connected:
        raise LinkError(f"fleet: {watch.trouble}")


def _observer(
    site: str | None,
    connect: list[str] | None,
    listen: list[str] | None,
    zenoh_config: str | None,
) -> Transport[Keyed]:
    cls = registry.load("links", "zenoh")
    several = connect is not None and len(connect) > 1
    mode = "router" if listen else "peer" if several else None
    data = {"mode": mode, "connect": connect, "listen": listen, "zenoh_config": zenoh_config}
    data |= {"name": "fleet", "cell": "none"} | ({"site": site} if site is not None else {})
    assert isinstance(cls, ObservesFleet)
    return cls.observer(validated(cls.settings_model, data, "fleet"), site)


class _Watch:
    """Receives messages in its own thread; the display may read the rows at any time."""

    def __init__(
        self, observer: Transport[Keyed], fleet: Fleet, silent_s: float = SILENT_S
    ) -> None:
        self.ever_connected = False
        self.trouble = ""
        self._observer = observer
        self._fleet = fleet
        self._silent_s = silent_s
        self._changes = FleetChanges(fleet)
        self._page_feed: FleetFeed | None = None
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._hear, name="fleet", daemon=True)

    def page(
        self, port: int | None, host: str, urls: tuple[str, ...] = ()
    ) -> AbstractContextManager[FleetFeed | None]:
        """Return the feed of a page in the browser; nothing without a port."""
        if port is None:
            return nullcontext()
        settings = ScreenSettings("operator", FLEET, port, host, urls)
        self._page_feed = FleetFeed(settings, self._facts)
        return self._page_feed

    def _facts(self, after: int) -> dict[str, Any]:
        """Return the content of the page: all cells, and the changes after the given one."""
        return {
            "cells": [tile(row) for row in self._changes.look()],
            "changes": self._changes.after(after),
            "trouble": self.trouble,
            "left_out": self._fleet.left_out,
            "silent_s": self._silent_s,
        }

    def start(self) -> None:
        """Connect, so that a wrong setting fails the command; then start to receive.

        Raises:
            ConfigError: a zenoh file or setting is wrong.
        """
        self._connect()
        self._thread.start()

    def stop(self) -> None:
        """Stop the thread and close the session."""
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._observer.close()

    def _connect(self) -> None:
        try:
            self._observer.open()
        except ConfigError:
            raise
        except HriPredictError as error:
            self.trouble = str(error)
        else:
            self.ever_connected, self.trouble = True, ""

    def _hear(self) -> None:
        while not self._stop.is_set():
            try:
                if self.trouble:
                    self._stop.wait(RETRY_S)
                    self._connect()
                    continue
                for unit in self._observer.read(READ_S):
                    self._take(replace(unit, key=f"{ROOT}/{unit.key}"))
            except BaseException as error:  # the cells turn silent by themselves
                self.trouble = first_line(failure(error))

    def _take(self, unit: Keyed) -> None:
        # in a flood it may have waited: it is as old as it is
        now_ns = time.monotonic_ns() if unit.heard_ns is None else unit.heard_ns
        is_news, feed = self._fleet.take(unit, now_ns), self._page_feed
        key = split_key(unit.key)
        if is_news and feed is not None and key is not None:
            self._changes.look_at(key.site, key.cell)
            feed.wake()

    def rows(self) -> list[CellRow]:
        """Return the rows of all cells as they are now."""
        return self._fleet.rows(time.monotonic_ns())

    def print_lines(self, seconds: float | None) -> None:
        """Print a JSON object every second, and a last one at the end."""
        began = time.monotonic()
        while True:
            passed = time.monotonic() - began
            left = math.inf if seconds is None else seconds - passed
            time.sleep(max(0.0, min(1.0, left)))
            line = {
                "time_s": round(time.monotonic() - began, 3),
                "connected": not self.trouble,
                "trouble": self.trouble or None,
                "left_out": self._fleet.left_out,
                "cells": [row.as_dict() for row in self.rows()],
            }
            print(json.dumps(line), flush=True)
            if left <= 1.0:
                return

    def show(self, seconds: float | None) -> None:
        """Show the table: redraw it in a terminal, otherwise print it once at the end."""
        console = Console()
        end = math.inf if seconds is None else time.monotonic() + seconds
        if not sys.stdout.isatty():
            while time.monotonic() < end:
                time.sleep(min(1.0, max(0.0, end - time.monotonic())))
            console.print(self._page(console, math.inf))
            return
        with Live(
            get_renderable=lambda: self._page(console, console.height),
            console=console,
            refresh_per_second=REDRAW_HZ,
        ):
            while time.monotonic() < end:
                time.sleep(min(1.0, max(0.0, end - time.monotonic())))

    def _page(self, console: Console, lines: float) -> RenderableType:
        rows, room = self.rows(), max(1, lines - FRAME_LINES)
        shown = rows
        if len(rows) > room or _height(rows, console) > room:
            rows.sort(key=_how_bad)  # the worst cells must be among those that fit
            shown = _fitting(rows, room, console)
        parts: list[RenderableType] = [_table(shown, console)]
        if not rows:
            parts.append(Text("no message from any cell yet"))
        elif len(shown) < len(rows):
            parts.append(Text(f"and {len(rows) - len(shown)} more cells, none of them worse"))
        if self.trouble:
            parts.append(Text(f"not connected: {self.trouble}", style="bold red"))
        if self._fleet.left_out:
            parts.append(
                Text(f"{self._fleet.left_out} messages ignored: unknown keys or too many cells")
            )
        return Group(*parts)


def _fitting(rows: list[CellRow], room: float, console: Console) -> list[CellRow]:
    """Return as many of the first rows as fit into ``room`` lines, but at least one."""
    counts = range(1, min(len(rows), math.floor(room)) + 1)
    fitting = bisect_right(counts, room, key=lambda count: _height(rows[:count], console))
    return rows[: max(1, fitting)]


def _height(rows: list[CellRow], console: Console) -> int:
    """Return the number of lines of the rows without the heading, including wrapped lines."""
    return len(console.render_lines(_table(rows, console))) - HEAD_LINES


def _table(rows: list[CellRow], console: Console) -> Table:
    cells = [_cells(row) for row in rows]
    plain = [[cell.plain for cell in line] for line in cells]
    steady = [
        "x" * width for width in _COLUMNS.values()
    ]  # so that changing numbers do not shift columns
    widths = wrapped_widths([list(_COLUMNS), steady, *plain], console.width - len(_COLUMNS) - 1)
    table = Table(box=SIMPLE_HEAD, padding=0)
    for name, width in zip(_COLUMNS, widths, strict=True):
        table.add_column(name, width=width, overflow="fold")
    for line in cells:
        table.add_row(*line)
    return table


def _cells(row: CellRow) -> list[Text]:
    robots = Text(" ").join(
        Text.assemble(f"{r.robot}:", (r.level.upper(), _colour(r.level))) for r in row.robots
    )
    age = "-" if row.age_s is None else f"{row.age_s * 1e3:.0f} ms" if row.age_s < 10 else "old"
    return [
        Text(f"{row.site}/{row.cell}"),
        Text(row.state, style=_STATES.get(row.state, "magenta")),
        robots,
        Text("-" if row.people is None else str(row.people)),
        Text(age),
        Text("-" if row.heard_s is None else _seconds(row.heard_s)),
        Text(f"{row.lost + row.refused}"),
        Text(row.why or _because(row)),
    ]


def _seconds(since: float) -> str:
    return f"{since:.1f} s" if since < 100 else f"{since:.0f} s"


def _how_bad(row: CellRow) -> int:
    """Rank a cell by the worst of node state and robot levels; smaller is worse."""
    said = {row.state, *(robot.level for robot in row.robots)}
    return next((i for i, bad in enumerate(_BAD) if bad in said), len(_BAD))


def _because(row: CellRow) -> str:
    """Return the reasons of the robots that may not move freely."""
    return "; ".join(dict.fromkeys(r.reason for r in row.robots if r.level != "clear"))


def _colour(level: str) -> str:
    if level == SILENT:
        return "bold red"
    return LOOKS["UNKNOWN" if level == UNKNOWN else level.upper()].terminal
