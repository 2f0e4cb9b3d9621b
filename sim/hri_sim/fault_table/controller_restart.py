"""A controller's restart: the arm must stop, and move on when the controller is back.

As in ``node_death``, both controllers are separate processes in real time. The node runs in this
process, so that all its advice can be observed, and it is not restarted.
"""

import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import baseline_demo
from hri_sim.controllers.cell import MockCell
from hri_sim.controllers.wiring import PERMIT_STALE_S
from hri_sim.fault_table.node_death import STEP_S, WAIT_S, ArmWatch, reported, write_config

OFF_S = 1.0  # from the kill until the controller is started again


@dataclass(frozen=True, kw_only=True)
class Restart:
    """The result of a restart; times in seconds.

    Attributes:
        stopped_s: from the kill until the controller's permit had expired.
        limit_s: the limit for ``stopped_s``: a permit's lifetime plus one cycle of the controller.
        stands_s: from the kill until the arm stood.
        moved_again_s: from the new controller's port until both controllers permitted motion and
            the arm moved.
        clear: number of ticks after the kill at which the node advised *clear*.
        levels: level -> number of ticks after the kill.
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
    cell = MockCell(
        links=demo.links, robots=demo.node.robots, base_dir=demo.base_dir, clock=MonotonicClock()
    )
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
    return Restart(
        stopped_s=stopped_s,
        limit_s=limit_s,
        stands_s=stands_s,
        moved_again_s=moved_again_s,
        clear=clear,
        levels=counts,
    )


def _until(condition: Callable[[], bool], node: threading.Thread) -> float:
    """Wait until ``condition`` holds; return that time, of ``time.monotonic``."""
    end_s = time.monotonic() + WAIT_S
    while not condition():
        if not node.is_alive():
            raise LinkError("node: it ended too early; see its error on standard error")
        if time.monotonic() > end_s:
            raise LinkError(f"node: the arm did not stop or move within {WAIT_S:g} s as expected")
        time.sleep(STEP_S)
    return time.monotonic()
