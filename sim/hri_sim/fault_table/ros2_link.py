"""Faults of a ROS 2 link in real time: their effect on a subscriber. Needs ROS 2.

The link sends Status and Advice (*slow*, half of full speed) at 25 Hz. The subscriber is the sample
``drivers/ros2/speed_follower.py`` in a process of its own.
"""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hri_drivers import links
from hri_drivers.links.ros2.link import Ros2Link, Ros2LinkSettings
from hri_predict.base.clock import MonotonicClock
from hri_predict.base.errors import LinkError
from hri_predict.protocol.messages import Advice, Level, NodeState, Status
from hri_predict.protocol.reasons import Reason
from hri_sim.fault_table.outcome import RECOVERY_S, Expected, FaultOutcome
from hri_sim.faults.link_faults import FaultyTransport

PERIOD_S, LENGTH_S, SETTLED_S = 0.04, 2.0, 1.0
SILENCE_S = 0.2  # of the follower and of the link
LATE_MS = 1e3 * (PERIOD_S + 0.01)  # one cycle, and the follower's timer
SILENT_MS = 1e3 * SILENCE_S + LATE_MS
START_S = 6.0  # until the two have found each other
HALF, STOPPED = "speed 0.500", "speed 0.000"
DOMAIN = 201  # of the table alone


@dataclass(frozen=True)
class Ros2Case:
    """One fault; see ``fault_table.Case``.

    Attributes:
        fault: fault of the link's transport; ``None``: the node posts nothing, or has ended.
    """

    name: str
    expected: Expected
    limit_ms: float | None
    fault: dict[str, Any] | None = None
    drain_s: float = 0.0


CASES = (
    Ros2Case("node hangs", "stop", SILENT_MS),
    Ros2Case("node ends", "stop", LATE_MS),
    Ros2Case("delayed 1 s", "stop", SILENT_MS, {"kind": "delay", "delay_s": 1.0}, drain_s=1.0),
    Ros2Case("everything lost", "stop", SILENT_MS, {"kind": "drop", "probability": 1.0}),
    Ros2Case("flooded, everything 10 times", "count only", None, {"kind": "flood"}),
)


def run_ros2_faults(only: str | None = None) -> Iterator[FaultOutcome]:
    """Run every case whose name contains ``only``."""
    for case in CASES:
        name = f"ros2 link: {case.name}"
        if only is None or only in name:
            yield run_ros2_case(name, case)


def run_ros2_case(name: str, case: Ros2Case) -> FaultOutcome:
    """Run one case.

    Raises:
        LinkError: ROS 2 does not start, or the follower heard nothing before the fault.
    """
    with contextlib.ExitStack() as stack:
        cell = _Cell(case, stack)
        end_s = cell.breaks_s + LENGTH_S + case.drain_s
        heard = False
        while (now_s := time.monotonic()) < end_s + RECOVERY_S:
            if now_s < cell.breaks_s:
                heard = cell.follower.newest == HALF
            elif not heard:
                raise LinkError(f"{name}: the follower hears nothing; is the machine overloaded?")
            elif now_s > end_s + SETTLED_S and cell.follower.newest == HALF:
                break
            cell.step(broken=cell.breaks_s <= now_s < cell.breaks_s + LENGTH_S)
        return _outcome(name, case, cell, end_s)


def _outcome(name: str, case: Ros2Case, cell: "_Cell", end_s: float) -> FaultOutcome:
    began_s = cell.breaks_s
    during = [(s, line) for s, line in cell.follower.lines if s >= began_s]
    first_s = next((s for s, line in during if line == STOPPED), None)
    measured = None if first_s is None else 1e3 * (first_s - began_s)
    well = cell.follower.newest == HALF
    recovered = 1e3 * max(0.0, during[-1][0] - end_s) if during and well else None
    too_fast = sum(line not in (HALF, STOPPED) for _, line in cell.follower.lines)
    if case.limit_ms is None:
        fine = measured is None
    else:
        fine = measured is not None and measured <= case.limit_ms and recovered is not None
    return FaultOutcome(
        fault=name,
        expected=case.expected,
        acts="subscriber",
        limit_ms=case.limit_ms,
        measured_ms=measured,
        reason="" if measured is None else "silent",
        clear_while_near=too_fast,
        recovered_ms=recovered,
        fine=fine and well and too_fast == 0,
    )


class _Follower:
    """The sample subscriber, and what it printed with seconds of the monotonic clock."""

    def __init__(self) -> None:
        package = Path(links.__file__).parents[1]
        folders = (package / "ros2", package.parent / "ros2")  # of a wheel, of a clone
        script = next(f / "speed_follower.py" for f in folders if f.is_dir())
        environment = os.environ | {
            "ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }  # fmt: skip
        self.lines: list[tuple[float, str]] = []
        self._process = subprocess.Popen(
            [sys.executable, str(script)], env=environment, stdout=subprocess.PIPE, text=True
        )
        threading.Thread(target=self._read, daemon=True).start()

    @property
    def newest(self) -> str:
        """The newest line, "" before the first."""
        return self.lines[-1][1] if self.lines else ""

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.lines.append((time.monotonic(), line.strip()))


class _Cell:
    """The link and its follower.

    Attributes:
        breaks_s: when the fault begins, on the monotonic clock.
    """

    def __init__(self, case: Ros2Case, stack: contextlib.ExitStack) -> None:
        self._case, self._clock, self._cycle = case, MonotonicClock(), 0
        stack.callback(self._close)
        self.follower = _Follower()
        self._link: Ros2Link | None = self._new_link()
        self.breaks_s = time.monotonic() + START_S

    def step(self, broken: bool) -> None:
        """Post what a node posts in a cycle, and wait for the next."""
        if broken and self._case.name == "node ends" and self._link is not None:
            self._link.stop()
            self._link = None
        elif not broken and self._link is None:
            self._link = self._new_link()
        if self._link is not None and not (broken and self._case.fault is None):
            self._post(self._link)
        time.sleep(PERIOD_S)

    def _new_link(self) -> Ros2Link:
        settings = Ros2LinkSettings(
            name="ros", full_speed_m_s=1.0, domain_id=DOMAIN, silence_timeout_s=SILENCE_S
        )
        window = {"start_s": START_S, "duration_s": LENGTH_S, "direction": "out"}
        faults = [] if self._case.fault is None else [self._case.fault | window]
        device: Any = Ros2Link.make_transport(settings)  # its units are whole, as CAN frames are
        wire: FaultyTransport[Any] = FaultyTransport(
            inner=device, faults=faults, clock=self._clock, seed=0
        )
        link = Ros2Link(settings, self._clock, wire)
        link.start()
        return link

    def _post(self, link: Ros2Link) -> None:
        self._cycle += 1
        now_ns = self._clock.now_ns()
        link.post(
            Advice(
                robot=0,
                level=Level.SLOW,
                reason=Reason.PERSON_NEAR,
                speed_limit_m_s=0.5,
                capture_ns=now_ns,
            )
        )
        link.post(
            Status(
                node_state=NodeState.RUNNING,
                reason=Reason.NONE,
                people=1,
                predictor=0,
                cycle=self._cycle % 256,
                capture_ns=now_ns,
            )
        )

    def _close(self) -> None:
        if self._link is not None:
            self._link.stop()
        self.follower.close()
