"""The node's death: the controllers must stop by themselves, and move on when the node is back.

Two mock controllers and the node run as separate processes in real time. The node gets the
controllers' ports as plain devices, so that it owns no part of the cell and its death ends nothing
else.
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

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.files import load_yaml
from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.link import LinkSettings
from hri_predict.run import config as configuration
from hri_sim.baseline_demo import BASELINE, baseline_demo
from hri_sim.controllers.cell import MockCell

How = Literal["kill", "terminate"]

STANDS_RAD_S = 1e-3  # an arm stands if all its joints are slower
WAIT_S = 60.0  # for the node to start and the arm to move, on a loaded machine
STEP_S = 0.001  # between two reads of the permits
_KEPT_SETTLED_S = 0.5


@dataclass(frozen=True, kw_only=True)
class Death:
    """The result of a node's death; times in seconds from the signal.

    Attributes:
        stopped_s: link name -> time until its controller permitted no motion.
        stands_s: time until the arm stood.
        limit_s: link name -> the controller's silence time-out plus one of its cycles.
        exit_status: the node's exit status; negative: the signal that ended it.
        exit_s: time until its process had ended.
        moved_again_s: from the node's second start until both controllers permitted motion and the
            arm moved; no controller was restarted.
        cause: the cause that the monitor reports for its stop at the node's second end: ``silent``,
            or the level that it received.
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
        how: ``kill`` (SIGKILL: the node can send nothing more) or ``terminate`` (SIGTERM: the node
            sends a last message).
        people: people of the procedural source; they must let the robot move.

    Raises:
        LinkError: the cell or the node did not start, or the robot did not move or stop.
    """
    demo = baseline_demo()
    clock = MonotonicClock()
    cell = MockCell(links=demo.links, robots=demo.node.robots, base_dir=demo.base_dir, clock=clock)
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
    """Write the demo's configuration with ``ports`` as its devices and without ``simulate:``.

    Args:
        path: the file to write.
        links: the demo's links.
        ports: link name -> port or channel.
        people: the people in the room.
    """
    data = load_yaml(configuration.shipped("demo.yaml").read_text(encoding="utf-8"))
    for link, settings in zip(data["links"], links, strict=True):
        del link["simulate"]
        link["channel" if settings.kind == "can" else "port"] = ports[settings.name]
    data["predictor"] = BASELINE
    data["source"]["people"] = list(people)
    data["alerts"] = {"terminal": False}
    path.write_text(yaml.safe_dump(data), encoding="utf-8")
    return path


class ArmWatch:
    """Watches the controllers' permits and the arm."""

    def __init__(self, cell: MockCell, links: Sequence[str], clock: MonotonicClock) -> None:
        self._cell, self._links, self._clock = cell, links, clock

    def permits(self) -> dict[str, float]:
        """Return link name -> the speed that its controller permits now, m/s."""
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
        """Wait until ``condition`` holds.

        Raises:
            LinkError: the node ends first, or the wait takes too long.
        """
        end_s = time.monotonic() + WAIT_S
        while not condition():
            if node.poll() is not None:
                raise LinkError(f"node: ended too early, with exit status {node.returncode}")
            if time.monotonic() > end_s:
                raise LinkError(f"node: the robot did not move within {WAIT_S:g} s")
            time.sleep(STEP_S)


def _end(
    node: "subprocess.Popen[bytes]", how: How, watch: ArmWatch
) -> tuple[dict[str, float], float, float]:
    """End the node; return the seconds until each controller, the arm and the process stopped."""
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
            raise LinkError(f"node: the robot may still move {WAIT_S:g} s after the node's end")
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
    """Yield a list that holds the controllers' reports after the block, however it ends."""
    reports: list[ControllerReport] = []
    try:
        yield reports
    finally:
        reports += cell.stop()


def _last_stop(reports: Sequence[ControllerReport]) -> str:
    """Return the cause of the monitor's last stop; the drive may only have followed it."""
    monitor = next(report for report in reports if report.role == "monitor")
    stops = [cause for _, cause, limit in monitor.events if limit == 0.0]
    return stops[-1] if stops else monitor.ended
