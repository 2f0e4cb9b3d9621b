"""A live view for the terminal: a plan of the room, the advice, and any problems.

A separate thread draws the newest tick; the node's loop only stores the tick here. The page fits
terminals of at least 80 x 24 characters.
"""

import threading
import time
from collections import deque
from collections.abc import Callable
from types import TracebackType

import numpy as np
from rich.console import Console, ConsoleOptions, Group, RenderableType, RenderResult
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.looks import LOOKS
from hri_predict.contracts.source import SourceCounters, live_part
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Advice, Level
from hri_predict.run.assemble import Assembly
from hri_predict.run.session import View

# -- a plan of the room in characters: people, their zones and the robots, seen from above ---------

LEAST_M = 2.0
"""Minimum distance shown around every robot's base."""
FARTHEST_M = 30.0
"""Maximum distance shown from the first robot, so that absurd positions cannot shrink the plan."""
_MARGIN_M = 0.3
_STEPS_M = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.75, 1.0, 1.5, 2.0)
_DOT_M = 0.06  # radius of a joint
_NEAREST = 1.12  # columns from any point to the middle of the nearest character, at most


class Extent:
    """The part of the room that the plan shows. It only grows, which keeps the picture steady.

    Args:
        bases: (R, 2) positions of the robots, metres in the room's frame; the origin if there are
            none.
    """

    def __init__(self, bases: Floats) -> None:
        self._middle = bases[0] if len(bases) else np.zeros(2)
        bases = bases if len(bases) else np.zeros((1, 2))
        self.low: Floats = bases.min(0) - LEAST_M
        self.high: Floats = bases.max(0) + LEAST_M

    def include(self, points: Floats) -> None:
        """Grow to include (N, 2) or (N, 3) points; distant points and NaN are ignored."""
        xy = points.reshape(-1, points.shape[-1])[:, :2]
        xy = xy[np.isfinite(xy).all(1)]
        xy = xy[(np.abs(xy - self._middle) <= FARTHEST_M).all(1)]
        if len(xy):
            self.low = np.minimum(self.low, xy.min(0) - _MARGIN_M)
            self.high = np.maximum(self.high, xy.max(0) + _MARGIN_M)


class CharacterPlan:
    """Grid of characters for an extent: x to the right, y up.

    A character is about twice as high as it is wide, so a row is twice as long as a column.

    Args:
        extent: the region to show.
        columns: width in characters.
        rows: height in characters.
    """

    def __init__(self, extent: Extent, columns: int, rows: int) -> None:
        size = extent.high - extent.low
        least = max(size[0] / columns, size[1] / (2 * rows))
        self.column_m = next((step for step in _STEPS_M if step >= least), least)
        middle = (extent.low + extent.high) / 2
        xs = middle[0] + (np.arange(columns) - (columns - 1) / 2) * self.column_m
        ys = middle[1] + ((rows - 1) / 2 - np.arange(rows)) * 2 * self.column_m
        self._points = np.stack(np.meshgrid(xs, ys), axis=-1)[..., None, :]  # (rows, columns, 1, 2)
        self._cells = [[(" ", "")] * columns for _ in range(rows)]

    def capsules(self, capsules: Capsules, mark: str, style: str) -> None:
        """Mark every character with its centre under one of C capsules."""
        if not len(capsules.radius):
            return
        a, b = capsules.a[:, :2], capsules.b[:, :2]
        along = b - a
        length2 = np.maximum((along**2).sum(-1), 1e-12)
        t = np.clip(((self._points - a) * along).sum(-1) / length2, 0.0, 1.0)
        distance = np.linalg.norm(self._points - (a + t[..., None] * along), axis=-1)
        self._mark(
            (distance <= np.maximum(capsules.radius, _NEAREST * self.column_m)).any(-1), mark, style
        )

    def dots(self, points: Floats, mark: str, style: str) -> None:
        """Mark (N, 3) points; points that are not finite are skipped."""
        ends = points[np.isfinite(points).all(axis=-1)]
        self.capsules(Capsules(ends, ends, np.full(len(ends), _DOT_M)), mark, style)

    def text(self) -> Text:
        """Return the plan, one line per row."""
        lines = (
            Text.assemble(*[(mark, style) for mark, style in row], no_wrap=True)
            for row in self._cells
        )
        return Text("\n").join(lines)

    def _mark(self, inside: Bools, mark: str, style: str) -> None:
        for row, column in np.argwhere(inside):
            self._cells[row][column] = (mark, style)


# --------------------------------------------------------------------------------------------------

REDRAW_HZ = 8.0
SIDE, LEAST_SIDE = 58, 36  # columns beside the plan
MOST_ROWS = 40
_CHANGES = 8  # that are remembered; the page shows as many as fit
_TROUBLE = {
    "unknown_joints": "joints with unknown names",
    "malformed": "not understood",
    "unauthenticated": "not authenticated",
    "crc_errors": "CRC errors",
    "lost": "lost",
    "overrun": "too many",
}


class TerminalView(View):
    """Shows the newest tick until it is closed; use it as a context manager.

    Args:
        console: default: standard error.
        utc_s: returns the wall-clock time, seconds since 1970.
        footer: returns the bottom line; "": none.
    """

    def __init__(
        self,
        console: Console | None = None,
        utc_s: Callable[[], float] = time.time,
        footer: Callable[[], str] = str,
    ) -> None:
        self._wall = utc_s
        self._footer = footer
        self._console = console or Console(stderr=True)
        self._live = Live(console=self._console, auto_refresh=False, transient=True)
        self._assembly: Assembly | None = None
        self._extent = Extent(np.zeros((0, 2)))
        self._tick: Tick | None = None
        self._utc_s = 0.0
        self._changes: deque[Text] = deque(maxlen=_CHANGES)
        self._levels: dict[int, Level] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._draw_often, name="view", daemon=True)

    def bind(self, assembly: Assembly) -> None:
        """Store the assembly with the robots and links to show."""
        self._assembly = assembly
        bases = [robot.base[:2] for robot in assembly.robots if robot.base is not None]
        self._extent = Extent(np.array(bases).reshape(-1, 2))

    def on_tick(self, tick: Tick) -> None:
        """Store the newest tick for the drawing thread."""
        for advice in tick.advices:
            if self._levels.get(advice.robot) is not advice.level:
                self._levels[advice.robot] = advice.level
                self._changes.append(_change(advice, self._wall()))
        self._tick, self._utc_s = tick, self._wall()

    def __enter__(self) -> "TerminalView":
        self._live.start()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(timeout=2.0)
        self._live.stop()

    def _draw_often(self) -> None:
        while not self._stop.wait(1.0 / REDRAW_HZ):
            page = self.page()
            if page is not None:
                self._live.update(page, refresh=True)

    def page(self) -> RenderableType | None:
        """Return the page for the console's current size; ``None`` before the first tick."""
        tick, assembly = self._tick, self._assembly
        if tick is None or assembly is None:
            return None
        footer = self._footer()
        columns, rows = self._console.size.width, min(self._console.size.height - 1, MOST_ROWS)
        rows -= bool(footer)
        side = min(SIDE, max(LEAST_SIDE, columns - 64))
        layout = Layout()
        layout.split_row(
            self._plan(tick, assembly, columns - side - 4, rows - 2),
            Layout(_Cropped(self._side(tick, assembly), rows), size=side),
        )
        page = _High(layout, rows)
        if not footer:
            return page
        return Group(page, Text(footer, style="bold", no_wrap=True, overflow="ellipsis"))

    def _side(self, tick: Tick, assembly: Assembly) -> list[RenderableType]:
        """Return the parts next to the plan, most important first; the rest is cut off."""
        changes = Group(*reversed(self._changes))  # the newest first
        return [
            *(self._advice_panel(tick, advice, assembly) for advice in tick.advices),
            Panel(_links(assembly), title="source and links"),
            Panel(changes, title="changes, newest first"),
        ]

    def _advice_panel(self, tick: Tick, advice: Advice, assembly: Assembly) -> Panel:
        table = Table.grid(padding=(0, 1))
        robot = assembly.trackers[advice.robot].at(tick.now_ns)
        limit = advice.speed_limit_m_s
        level = Text(
            f" {advice.level.name} ", style=f"bold reverse {LOOKS[advice.level.name].terminal}"
        )
        table.add_row("advice", level)
        table.add_row("reason", advice.reason.text)
        table.add_row("nearest", _metres(advice.separation_m))
        speed = f"{robot.speed_m_s:.2f}" if robot.q is not None else "-"
        table.add_row("speed", f"{speed} of {'-' if limit is None else f'{limit:.2f}'} m/s allowed")
        table.add_row("node", f"{tick.status.node_state.name.lower()}, people {tick.status.people}")
        name = assembly.config.node.robots[advice.robot].name
        return Panel(table, title=f"{name}  {_clock(self._utc_s)}")

    def _plan(self, tick: Tick, assembly: Assembly, columns: int, rows: int) -> Panel:
        robots = [
            model.capsules(q)
            for tracker, model in zip(assembly.trackers, assembly.robots, strict=True)
            if (q := tracker.at(tick.now_ns).q) is not None
        ]
        people = [] if tick.snapshot is None else list(tick.snapshot.last_positions)
        for points in (*people, *(capsules.a for capsules in robots)):
            self._extent.include(points)
        plan = CharacterPlan(self._extent, max(columns, 1), max(rows, 1))
        if tick.assessment is not None and len(tick.assessment.zones.ids):
            zones = tick.assessment.zones
            middle, every = len(zones.times_s) // 2, zones.capsules
            for p in range(len(zones.ids)):
                zone = Capsules(every.a[p, middle], every.b[p, middle], every.radius[p, middle])
                plan.capsules(zone, "·", "bright_black")
        for capsules in robots:
            plan.capsules(capsules, "█", "blue")
        for person in people:
            plan.dots(person, "o", "bold yellow")
        legend = f"{1 / plan.column_m:.3g} columns/m: o person █ robot · zone"
        return Panel(plan.text(), title=legend)


class _High:
    """A part of a fixed height in lines, regardless of the terminal's height."""

    def __init__(self, part: RenderableType, rows: int) -> None:
        self._part, self._rows = part, rows

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        yield from console.render(self._part, options.update_height(self._rows))


class _Cropped:
    """Parts stacked vertically, cut off at a number of lines."""

    def __init__(self, parts: list[RenderableType], rows: int) -> None:
        self._parts, self._rows = parts, rows

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        lines = console.render_lines(Group(*self._parts), options.update(height=None))
        for line in lines[: self._rows]:
            yield from line
            yield Segment.line()


def _clock(utc_s: float) -> str:
    """Return the time of day, UTC, in the format of alerts and ``explain --at``."""
    return time.strftime("%H:%M:%SZ", time.gmtime(utc_s))


def _change(advice: Advice, utc_s: float) -> Text:
    text = Text(f"{_clock(utc_s)} ", no_wrap=True, overflow="ellipsis")
    text.append(f"{advice.level.name:8}", style=LOOKS[advice.level.name].terminal)
    return text.append(advice.reason.text)


def _links(assembly: Assembly) -> Table:
    table = Table.grid(padding=(0, 1))
    live = live_part(assembly.source)
    if live is not None:
        heard = Text(f"{live.counters.scenes} scenes", no_wrap=True)
        table.add_row(Text("source", style="green" if live.connected else "red"), heard)
        for line in trouble(live.counters):
            table.add_row("", Text(line, style="red"))
    for link in assembly.links:
        counters = link.counters
        table.add_row(
            Text(link.name, style="green" if link.connected else "red"),
            f"{counters.messages_sent} sent, {counters.messages_received} received",
        )
    return table


def trouble(counters: SourceCounters) -> list[str]:
    """Return the problems of a live source, one line each, with its newest error last."""
    counts = ((getattr(counters, name), words) for name, words in _TROUBLE.items())
    lines = [f"{count} {words}" for count, words in counts if count]
    return [*lines, counters.last_error] if counters.last_error else lines


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"
