"""A controller's restart: the arm must stop, and go on when the controller is back.

As in ``node_death`` both controllers are processes of their own, in real time; the node runs here,
so that all that it advises is seen. Nobody starts the node again.
"""

import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hri_predict import config as configuration
from hri_predict.clock import MonotonicClock
from hri_predict.errors import LinkError
from hri_predict.protocol.messages import Level
from hri_predict.session import Options, View, run
from hri_predict.tick import Tick
from hri_sim.baseline_demo import baseline_demo
from hri_sim.cell import MockCell
from hri_sim.node_death import STEP_S, WAIT_S, ArmWatch, reported, write_config
from hri_sim.wiring import PERMIT_STALE_S

OFF_S = 1.0  # from the kill until the controller is started again


@dataclass(frozen=True)
class Restart:
    """What came of it; times in seconds.

    Attributes:
        stopped_s: from the kill until the controller's permit was gone for its fellow and the arm.
        limit_s: for that: how long a permit lasts, and one cycle of the controller's own.
        stands_s: from the kill until the arm stood.
        moved_again_s: from when the new controller's port was there until both controllers
            permitted motion and the arm moved.
        clear: ticks from the kill on at which the node said *clear*.
        levels: level -> ticks from the kill on.
    """

    stopped_s: float
    limit_s: float
    stands_s: float
    moved_again_s: float
    clear: int
    levels: dict[str, int]


@dataclass
class _Levels(View):
    """Notes each tick's level, for the demo's only robot."""

    said: list[tuple[int, Level]] = field(default_factory=list)

    def on_tick(self, tick: Tick) -> None:
        """Note it."""
        self.said.append((tick.now_ns, tick.advices[0].level))


def restart_controller(link: str, people: Sequence[dict[str, Any]]) -> Restart:
    """Kill the controller of ``link`` while the arm moves; a second later start it again.

    Raises:
        LinkError: the cell or the node did not start, or the arm did not move or stop.
    """
    demo = baseline_demo()
    cell = MockCell(demo.links, demo.node.robots, demo.base_dir, MonotonicClock())
    stop, levels = threading.Event(), _Levels()
    with tempfile.TemporaryDirectory(prefix="hri-restart-") as folder, reported(cell):
        path = write_config(Path(folder) / "node.yaml", demo.links, cell.start(), people)
        config, options = configuration.load(path), Options(view=levels)
        node = threading.Thread(target=run, args=(config, options, stop), daemon=True)
        arm = ArmWatch(cell, [each.name for each in demo.links], MonotonicClock())
        node.start()
        try:
            _until(arm.moves, node)
            killed = time.monotonic()
            cell.kill(link)
            stopped_s = _until(lambda: arm.permits()[link] == 0.0, node) - killed
            stands_s = _until(arm.stands, node) - killed
            time.sleep(max(0.0, killed + OFF_S - time.monotonic()))
            cell.restart(link)
            back = time.monotonic()
            moved_again_s = _until(arm.moves, node) - back
        finally:
            stop.set()
            node.join()
        limit_s = PERMIT_STALE_S + cell.period_s(link)
    said = [level for at_ns, level in levels.said if at_ns >= killed * 1e9]
    counts = {level.name.lower(): said.count(level) for level in dict.fromkeys(said)}
    clear = said.count(Level.CLEAR)
    return Restart(stopped_s, limit_s, stands_s, moved_again_s, clear, counts)


def _until(condition: Callable[[], bool], node: threading.Thread) -> float:
    """Wait for it; returns when it was there, of ``time.monotonic``."""
    end_s = time.monotonic() + WAIT_S
    while not condition():
        if not node.is_alive():
            raise LinkError("node: it ended before its time; its error is on standard error")
        if time.monotonic() > end_s:
            raise LinkError(f"node: the arm did not do within {WAIT_S:g} s what it should")
        time.sleep(STEP_S)
    return time.monotonic()
