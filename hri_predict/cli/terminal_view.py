"""A live plan view for the terminal: people, their zones, the robots and the advice.

A thread of its own draws the newest tick; the node's loop only stores the tick here.
"""

import threading
from collections import deque
from types import TracebackType

import numpy as np
from rich.console import Console, Group
from rich.layout import Layout
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from hri_predict.geometry import Capsules
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Advice, Level
from hri_predict.run.assemble import Assembly
from hri_predict.run.session import View
from hri_predict.source import live_part

COLOURS = {
    Level.UNKNOWN: "magenta",
    Level.CLEAR: "green",
    Level.WARN: "yellow",
    Level.SLOW: "dark_orange",
    Level.STOP: "red",
    Level.FAULT: "white on red",
}
REDRAW_HZ = 8.0
METRES_PER_COLUMN = 0.1
METRES_PER_ROW = 0.2  # a character is about twice as high as it is wide
COLUMNS, ROWS = 66, 26
ORIGIN_COLUMN, ORIGIN_ROW = 20, 13
LEGEND = "plan, 10 columns per metre: o person  █ robot  · zone"


class TerminalView(View):
    """Shows the newest tick until it is closed; use it as a context manager."""

    def __init__(self, console: Console | None = None) -> None:
        self._live = Live(
            console=console or Console(stderr=True), auto_refresh=False, transient=True
        )
        self._assembly: Assembly | None = None
        self._tick: Tick | None = None
        self._start_ns: int | None = None
        self._changes: deque[Text] = deque(maxlen=5)
        self._levels: dict[int, Level] = {}
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._draw_often, name="view", daemon=True)

    def bind(self, assembly: Assembly) -> None:
        """Take the assembly whose robots and links are shown."""
        self._assembly = assembly

    def on_tick(self, tick: Tick) -> None:
        """Store the newest tick for the drawing thread."""
        if self._start_ns is None:
            self._start_ns = tick.now_ns
        for advice in tick.advices:
            if self._levels.get(advice.robot) is not advice.level:
                self._levels[advice.robot] = advice.level
                self._changes.append(self._change(tick, advice))
        self._tick = tick

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
            if self._tick is not None and self._assembly is not None:
                self._live.update(self._page(self._tick, self._assembly), refresh=True)

    def _seconds(self, now_ns: int) -> float:
        return (now_ns - (self._start_ns or now_ns)) * 1e-9

    def _change(self, tick: Tick, advice: Advice) -> Text:
        text = Text(f"{self._seconds(tick.now_ns):6.2f} s  ")
        text.append(f"{advice.level.name:8}", style=COLOURS[advice.level])
        return text.append(advice.reason.text)

    def _page(self, tick: Tick, assembly: Assembly) -> Layout:
        layout = Layout(size=ROWS + 2)
        layout.split_row(
            Layout(
                Panel(
                    self._plan(tick, assembly),
                    title=LEGEND,
                ),
                size=COLUMNS + 4,
            ),
            Layout(self._side(tick, assembly)),
        )
        return layout

    def _side(self, tick: Tick, assembly: Assembly) -> Group:
        parts = [self._advice_panel(tick, advice, assembly) for advice in tick.advices]
        links = Table.grid(padding=(0, 2))
        live = live_part(assembly.source)
        if live is not None:
            links.add_row(
                Text("source", style="green" if live.connected else "red"),
                f"{live.counters.scenes} scenes",
                f"{live.counters.lost} lost",
            )
        for link in assembly.links:
            links.add_row(
                Text(link.name, style="green" if link.connected else "red"),
                f"{link.counters.messages_sent} sent",
                f"{link.counters.messages_received} received",
            )
        parts.append(Panel(links, title="links"))
        changes = Text("\n").join(self._changes)
        changes.no_wrap, changes.overflow = True, "ellipsis"
        parts.append(Panel(changes, title="changes"))
        return Group(*parts)

    def _advice_panel(self, tick: Tick, advice: Advice, assembly: Assembly) -> Panel:
        table = Table.grid(padding=(0, 1))
        robot = assembly.trackers[advice.robot].at(tick.now_ns)
        limit = advice.speed_limit_m_s
        table.add_row("advice", Text(advice.level.name, style=f"bold {COLOURS[advice.level]}"))
        table.add_row("reason", advice.reason.text)
        table.add_row("separation", _metres(advice.separation_m))
        table.add_row("speed limit", f"{limit:.2f} m/s" if limit is not None else "-")
        table.add_row("robot speed", f"{robot.speed_m_s:.2f} m/s" if robot.q is not None else "-")
        table.add_row("node", f"{tick.status.node_state.name.lower()}, people {tick.status.people}")
        name = assembly.config.node.robots[advice.robot].name
        return Panel(table, title=f"{name}  t = {self._seconds(tick.now_ns):.1f} s")

    def _plan(self, tick: Tick, assembly: Assembly) -> Text:
        cells = [[(" ", "") for _ in range(COLUMNS)] for _ in range(ROWS)]
        if tick.assessment is not None and len(tick.assessment.zones.ids):
            zones = tick.assessment.zones
            middle = len(zones.times_s) // 2
            both = zones.capsules
            for p in range(len(zones.ids)):
                zone = Capsules(both.a[p, middle], both.b[p, middle], both.radius[p, middle])
                _fill(cells, zone, "·", "bright_black")
        for tracker, model in zip(assembly.trackers, assembly.robots, strict=True):
            q = tracker.at(tick.now_ns).q
            if q is not None:
                _fill(cells, model.capsules(q), "█", "blue")
        if tick.snapshot is not None:
            for person in tick.snapshot.last_positions:
                ends = person[np.isfinite(person).all(axis=-1)]
                _fill(cells, Capsules(ends, ends, np.full(len(ends), 0.06)), "o", "bold yellow")
        for advice in tick.advices:
            _mark(
                cells=cells,
                row=ORIGIN_ROW,
                column=ORIGIN_COLUMN,
                mark="+",
                style=COLOURS[advice.level],
            )
        return Text("\n").join(
            Text.assemble(*[(mark, style) for mark, style in row]) for row in cells
        )


def _fill(cells: list[list[tuple[str, str]]], capsules: Capsules, mark: str, style: str) -> None:
    """Mark every cell whose centre lies in the floor plan of a capsule."""
    if len(capsules.radius) == 0:
        return
    xs = (np.arange(COLUMNS) - ORIGIN_COLUMN) * METRES_PER_COLUMN
    ys = (ORIGIN_ROW - np.arange(ROWS)) * METRES_PER_ROW
    points = np.stack(np.meshgrid(xs, ys), axis=-1)[..., None, :]  # (rows, columns, 1, 2)
    a, b = capsules.a[:, :2], capsules.b[:, :2]
    along = b - a
    length2 = np.maximum((along**2).sum(-1), 1e-12)
    t = np.clip(((points - a) * along).sum(-1) / length2, 0.0, 1.0)
    distance = np.linalg.norm(points - (a + t[..., None] * along), axis=-1)
    inside = (distance <= np.maximum(capsules.radius, METRES_PER_COLUMN)).any(-1)
    for row, column in np.argwhere(inside):
        _mark(cells=cells, row=int(row), column=int(column), mark=mark, style=style)


def _mark(
    *, cells: list[list[tuple[str, str]]], row: int, column: int, mark: str, style: str
) -> None:
    if 0 <= row < ROWS and 0 <= column < COLUMNS:
        cells[row][column] = (mark, style)


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} m"
