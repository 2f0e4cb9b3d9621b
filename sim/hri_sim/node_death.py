"""The node's death: the controllers must stop by themselves, and go on when it is back.

Everything is real here: two mock controllers and the node, each a process of its own, and the
clock on the wall. The node is started with the controllers' ports as plain devices, so that it owns
nothing of the cell and its death takes nothing with it.
"""

import contextlib
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from hri_predict import config as configuration
from hri_predict.clock import MonotonicClock
from hri_predict.errors import LinkError
from hri_predict.link import LinkSettings
from hri_sim.baseline_demo import BASELINE, baseline_demo
from hri_sim.cell import MockCell
from hri_sim.controller import ControllerReport

How = Literal["kill", "terminate"]

STANDS_RAD_S = 1e-3  # an arm whose joints are all slower stands
WAIT_S = 60.0  # for the node to start and the arm to move: a loaded machine takes its time
STEP_S = 0.001  # between two looks at the permits
_KEPT_SETTLED_S = 0.5


@dataclass(frozen=True)
class Death:
    """What came of it; times in seconds from the signal.

    Attributes:
        stopped_s: link name -> until its controller permitted no motion.
        stands_s: until the arm stood.
        limit_s: link name -> the controller's silence time-out and one cycle of its own.
        exit_status: of the node; negative: the signal that ended it.
        exit_s: until its process had ended.
        moved_again_s: from the node's second start until both controllers permitted motion and the
            arm moved, with no controller started again.
        cause: why the monitor says that it stopped when the node ended the second time: ``silent``,
            or the level that it was told.
    """

    stopped_s: dict[str, float]
    stands_s: float
    limit_s: dict[str, float]
    exit_status: int
    exit_s: float
    moved_again_s: float
    cause: str


def die(how: How, people: Sequence[dict[str, Any]] = ()) -> Death:
    """End the demo's node by SIGKILL or SIGTERM while its robot moves; start it again.

    Args:
        how: ``kill`` (SIGKILL: nothing can be said any more) or ``terminate`` (SIGTERM: a last
            word).
        people: of the procedural source; such that the robot may move.

    Raises:
        LinkError: the cell or the node did not start, or the robot did not move or stop.
    """
    demo = baseline_demo()
    clock = MonotonicClock()
    cell = MockCell(demo.links, demo.node.robots, demo.base_dir, clock)
    with tempfile.TemporaryDirectory(prefix="hri-death-") as folder, reported(cell) as reports:
        path = write_config(Path(folder) / "node.yaml", demo.links, cell.start(), people)
        watch = ArmWatch(cell, [link.name for link in demo.links], clock)
        with _node(path) as node:
            watch.wait_for(watch.moves, node)
            stopped_s, stands_s, exit_s = _end(node, how, watch)
        began = time.monotonic()
        with _node(path) as node:
            watch.wait_for(watch.moves, node)
            moved_again_s = time.monotonic() - began
            time.sleep(_KEPT_SETTLED_S)
            _end(node, how, watch)
            status = node.returncode
    return Death(
        stopped_s=stopped_s,
        stands_s=stands_s,
        limit_s={link.name: cell.stops_within_s(link.name) for link in demo.links},
        exit_status=status,
        exit_s=exit_s,
        moved_again_s=moved_again_s,
        cause=_last_stop(reports),
    )


def write_config(
    path: Path,
    links: Sequence[LinkSettings],
    ports: dict[str, str],
    people: Sequence[dict[str, Any]],
) -> Path:
    """Write the demo's configuration with ``ports`` as its devices: nothing is simulated any more.

    Args:
        path: the file to write.
        links: the demo's.
        ports: link name -> port or channel.
        people: who is in the room.
    """
    data = yaml.safe_load(configuration.shipped("demo.yaml").read_text(encoding="utf-8"))
    for link, settings in zip(data["links"], links, strict=True):
        del link["simulate"]
        link["channel" if settings.kind == "can" else "port"] = ports[settings.name]
    data["predictor"] = BASELINE
    data["source"]["people"] = list(people)
    data["alerts"] = {"terminal": False}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


class ArmWatch:
    """Looks at the controllers' permits and at the arm."""

    def __init__(self, cell: MockCell, links: Sequence[str], clock: MonotonicClock) -> None:
        self._cell, self._links, self._clock = cell, links, clock

    def permits(self) -> dict[str, float]:
        """Link name -> what its controller permits now, m/s."""
        now_ns = self._clock.now_ns()
        return {link: self._cell.permit(link, now_ns) for link in self._links}

    def stands(self) -> bool:
        """Whether no joint of the arm moves."""
        truth = self._cell.robot_truth(self._clock.now_ns())
        return all(np.abs(qd).max() < STANDS_RAD_S for _, qd in truth.values())

    def moves(self) -> bool:
        """Whether all controllers permit motion, and the arm moves."""
        return all(permit > 0 for permit in self.permits().values()) and not self.stands()

    def wait_for(self, condition: Callable[[], bool], node: "subprocess.Popen[bytes]") -> None:
        """Wait for it; raises ``LinkError`` if the node ends first or it takes too long."""
        end_s = time.monotonic() + WAIT_S
        while not condition():
            if node.poll() is not None:
                raise LinkError(f"node: ended with status {node.returncode} before its time")
            if time.monotonic() > end_s:
                raise LinkError(f"node: the robot did not move within {WAIT_S:g} s")
            time.sleep(STEP_S)


def _end(
    node: "subprocess.Popen[bytes]", how: How, watch: ArmWatch
) -> tuple[dict[str, float], float, float]:
    """End the node; seconds until each controller stopped, the arm stood, the process was gone."""
    stopped: dict[str, float] = {}
    stands = exited = None
    began = time.monotonic()
    node.send_signal(signal.SIGKILL if how == "kill" else signal.SIGTERM)
    while stands is None or exited is None or not all(p in stopped for p in watch.permits()):
        since = time.monotonic() - began
        for link, permit in watch.permits().items():
            if permit == 0.0:
                stopped.setdefault(link, since)
        if stands is None and stopped and watch.stands():
            stands = since
        if exited is None and node.poll() is not None:
            exited = since
        if since > WAIT_S:
            raise LinkError(f"node: {WAIT_S:g} s after its end the robot may still move")
        time.sleep(STEP_S)
    return stopped, stands, exited


@contextlib.contextmanager
def _node(config: Path) -> Iterator["subprocess.Popen[bytes]"]:
    command = [sys.executable, "-m", "hri_predict", "run", str(config), "--json"]
    node = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        yield node
    finally:
        if node.poll() is None:
            node.kill()
        node.wait()


@contextlib.contextmanager
def reported(cell: MockCell) -> Iterator[list[ControllerReport]]:
    """The reports are there when the block is over, however it ends."""
    reports: list[ControllerReport] = []
    try:
        yield reports
    finally:
        reports += cell.stop()


def _last_stop(reports: Sequence[ControllerReport]) -> str:
    """Why the monitor stopped last; the drive may merely have followed it."""
    monitor = next(report for report in reports if report.role == "monitor")
    stops = [cause for _, cause, limit in monitor.events if limit == 0.0]
    return stops[-1] if stops else monitor.ended
