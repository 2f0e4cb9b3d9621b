"""Deaths in real time: of the node, and of a controller. The arm must stop, and move on afterwards.

Two mock controllers and the node run as separate processes. A node that is killed uses the
controllers' ports as plain devices: it owns no part of the cell, so its death stops no other
process. When a controller dies, the node runs in this process, so that all its advice can be
observed.
"""

import contextlib
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.base.files import load_yaml
from hri_predict.base.machine.orphans import command_of
from hri_predict.contracts.cell import ControllerReport
from hri_predict.contracts.link import LinkSettings
from hri_predict.node.listeners import Tick
from hri_predict.protocol.messages import Level
from hri_predict.run import config as configuration
from hri_predict.run.session import Options, View, run
from hri_sim.baseline_demo import BASELINE, baseline_demo
from hri_sim.controllers.cell import MockCell
from hri_sim.controllers.wiring import PERMIT_STALE_S
from hri_sim.fault_table.outcome import FaultOutcome

How = Literal["kill", "terminate"]

STANDS_RAD_S = 1e-3  # an arm stands if all its joints are slower
WAIT_S = 60.0  # for the node to start and the arm to move, on a loaded machine
STEP_S = 0.001  # between two reads of the permits
_KEPT_SETTLED_S = 0.5


def die(
    name: str, how: How, people: Sequence[dict[str, Any]], limit_ms: float | None = None
) -> FaultOutcome:
    """End the demo's node by SIGKILL or SIGTERM while its robot moves; start it again.

    Args:
        name: name of the row.
        how: ``kill`` (SIGKILL: the node can send nothing more) or ``terminate`` (SIGTERM: the node
            sends a last message).
        people: people of the procedural source; they must let the robot move.
        limit_ms: limit until each controller permits no motion; default: the controller's silence
            time-out plus one of its cycles.

    Returns:
        the row, with the times of the slower controller. Motion recovers when, after the node's
        second start, both controllers permit it and the arm moves; no controller was restarted. The
        reason is the cause of the monitor's stop at the node's second end.

    Raises:
        LinkError: the cell or the node did not start, or the robot did not move or stop.
    """
    with _cell("hri-death-", people) as (cell, path, watch, reports):
        with _node(path) as node:
            watch.wait_for(watch.moves, _ended(node))
            stopped_s, stands_s, exit_s = _end(node, how, watch)
        began = time.monotonic()
        with _node(path) as node:
            moved_again_s = watch.wait_for(watch.moves, _ended(node)) - began
            time.sleep(_KEPT_SETTLED_S)
            _end(node, how, watch)
            status = node.returncode
        limit_ms = limit_ms or 1e3 * max(cell.stops_within_s(link) for link in stopped_s)
    cause, measured_ms = _last_stop(reports), 1e3 * max(stopped_s.values())
    expected_end = ("silent", -signal.SIGKILL) if how == "kill" else ("unknown", 0)
    return FaultOutcome(
        fault=name,
        expected="stop",
        acts="controller",
        limit_ms=limit_ms,
        measured_ms=measured_ms,
        reason=cause,
        recovered_ms=moved_again_s * 1e3,
        fine=measured_ms <= limit_ms and (cause, status) == expected_end,
        counted={
            **{f"{link}_stopped_ms": round(s * 1e3) for link, s in stopped_s.items()},
            "arm_stands_ms": round(stands_s * 1e3),
            "node_ended_ms": round(exit_s * 1e3),
        },
    )


@contextlib.contextmanager
def _cell(
    prefix: str, people: Sequence[dict[str, Any]]
) -> Iterator[tuple[MockCell, Path, "ArmWatch", list[ControllerReport]]]:
    """Start the demo's controllers.

    Yields the cell, the configuration of a node for it, a watch, and a list that holds the
    controllers' reports after the block, even after an error.
    """
    demo, clock = baseline_demo(), MonotonicClock()
    cell = MockCell(links=demo.links, robots=demo.node.robots, base_dir=demo.base_dir, clock=clock)
    reports: list[ControllerReport] = []
    with tempfile.TemporaryDirectory(prefix=prefix) as folder:
        try:
            path = write_config(Path(folder) / "node.yaml", demo.links, cell.start(), people)
            yield cell, path, ArmWatch(cell, [link.name for link in demo.links], clock), reports
        finally:
            reports += cell.stop()


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
        """Return whether all joints of the arm are at rest."""
        truth = self._cell.robot_truth(self._clock.now_ns())
        return all(np.abs(qd).max() < STANDS_RAD_S for _, qd in truth.values())

    def moves(self) -> bool:
        """Return whether all controllers permit motion and the arm moves."""
        return all(permit > 0 for permit in self.permits().values()) and not self.stands()

    def wait_for(self, condition: Callable[[], bool], ended: Callable[[], str]) -> float:
        """Wait until ``condition`` holds; return the time from ``time.monotonic``.

        Args:
            condition: to wait for.
            ended: returns the reason why the node exited, "" while it runs.

        Raises:
            LinkError: the node exits first, or the wait takes too long.
        """
        end_s = time.monotonic() + WAIT_S
        while not condition():
            if why := ended():
                raise LinkError(f"node: exited too early{why}")
            if time.monotonic() > end_s:
                raise LinkError(f"node: the robot did not move or stop within {WAIT_S:g} s")
            time.sleep(STEP_S)
        return time.monotonic()


def _ended(node: "subprocess.Popen[bytes]") -> Callable[[], str]:
    return lambda: "" if node.poll() is None else f", with exit status {node.returncode}"


def _end(
    node: "subprocess.Popen[bytes]", how: How, watch: ArmWatch
) -> tuple[dict[str, float], float, float]:
    """Stop the node; return the times until each controller, the arm and the process stopped."""
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
    command = command_of("hri_predict", "run", str(config), "--json")
    node = subprocess.Popen(command, stdout=subprocess.DEVNULL, start_new_session=True)
    try:
        yield node
    finally:
        if node.poll() is None:
            node.kill()
        node.wait()


def _last_stop(reports: Sequence[ControllerReport]) -> str:
    """Return the cause of the monitor's last stop; the drive may merely have followed it."""
    monitor = next(report for report in reports if report.role == "monitor")
    stops = [cause for _, cause, limit in monitor.events if limit == 0.0]
    return stops[-1] if stops else monitor.ended


# -- a controller's restart: the arm must stop, and move on when the controller is back ------------

OFF_S = 1.0  # from the kill until the controller is started again


@dataclass
class _Levels(View):
    """Notes each tick's level, for the demo's only robot."""

    said: list[tuple[int, Level]] = field(default_factory=list)

    def on_tick(self, tick: Tick) -> None:
        """Note it."""
        self.said.append((tick.now_ns, tick.advices[0].level))


def restart_controller(name: str, link: str, people: Sequence[dict[str, Any]]) -> FaultOutcome:
    """Kill the controller of ``link`` while the arm moves; a second later start it again.

    Returns:
        the row: its limit is a permit's lifetime plus one cycle of the controller. Motion recovers
        when both controllers permit it and the arm moves, counted from the time the new controller
        has its port. It counts the ticks after the kill by level.

    Raises:
        LinkError: the cell or the node did not start, or the arm did not move or stop.
    """
    stop, levels = threading.Event(), _Levels()
    with _cell("hri-restart-", people) as (cell, path, arm, _):
        config, options = configuration.load(path), Options(view=levels)
        node = threading.Thread(target=run, args=(config, options, stop), daemon=True)

        def ended() -> str:
            return "" if node.is_alive() else "; see its error on standard error"

        node.start()
        try:
            arm.wait_for(arm.moves, ended)
            killed = time.monotonic()
            cell.kill(link)
            stopped_s = arm.wait_for(lambda: arm.permits()[link] == 0.0, ended) - killed
            stands_s = arm.wait_for(arm.stands, ended) - killed
            time.sleep(max(0.0, killed + OFF_S - time.monotonic()))
            cell.restart(link)
            back = time.monotonic()
            moved_again_s = arm.wait_for(arm.moves, ended) - back
        finally:
            stop.set()
            node.join()
        limit_s = PERMIT_STALE_S + cell.period_s(link)
    said = [level for at_ns, level in levels.said if at_ns >= killed * 1e9]
    counts = {level.name.lower(): said.count(level) for level in dict.fromkeys(said)}
    clear = said.count(Level.CLEAR)
    return FaultOutcome(
        fault=name,
        expected="stop",
        acts="controller",
        limit_ms=limit_s * 1e3,
        measured_ms=stopped_s * 1e3,
        reason="its permit is old",
        clear_while_near=clear,
        recovered_ms=moved_again_s * 1e3,
        fine=stopped_s <= limit_s and clear == 0,
        counted={"arm_stands_ms": round(stands_s * 1e3), **counts},
    )
