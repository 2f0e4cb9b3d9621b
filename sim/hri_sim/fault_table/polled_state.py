"""Faults of a polled robot state: their effect on the node's knowledge of the robot.

The server is ``hri_sim.robot_server`` in a separate process; its arm swings.
"""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import yaml

from hri_drivers.links.configured import ConfiguredLink, ConfiguredLinkSettings
from hri_predict.base.files import data_path
from hri_predict.base.settings import validated
from hri_predict.contracts import registry
from hri_predict.protocol.messages import RobotState
from hri_predict.robots.model import load_robot
from hri_predict.robots.settings import RobotSettings
from hri_predict.robots.tracker import RobotTracker
from hri_sim.fault_table.link_cell import LOOK_S, LinkCase, LinkCell, run_cases
from hri_sim.fault_table.outcome import FaultOutcome
from hri_sim.robot_server.process import ServerProcess
from hri_sim.wires.ports import free_tcp_port

STALE_MS = 1e3 * (0.15 + 2 * LOOK_S)  # of both configurations, and until the test looks
SOON_MS = 1e3 * (2 * 0.02 + 2 * LOOK_S)  # the next two readings


@dataclass(frozen=True)
class StateCase(LinkCase):
    """One fault; ``server``: name of a fault of the server, or ``gone`` or ``stopped``."""

    server: str = ""


def _case(name: str, limit_ms: float, server: str) -> StateCase:
    return StateCase(name, "unknown", limit_ms, "hangs", server=server)  # the link sends nothing


CASES = (
    _case("server gone, and back", STALE_MS, "gone"),
    _case("server does not answer", STALE_MS, "stopped"),
    _case("answers after 0.15 s", STALE_MS, "late"),
    _case("heartbeat stops", STALE_MS, "frozen"),
    _case("a position is not a number", SOON_MS, "not a number"),
    _case("positions of another type", SOON_MS, "wrong type"),
    _case("not in automatic mode", SOON_MS, "mode"),
)


class StateCell(LinkCell):
    """A polling link, its server, and the node's tracker of the robot."""

    start_s, acts = 2.0, "node"
    well = "known"
    stopped = {
        "ROBOT_STATE_STALE": "unknown",
        "ROBOT_STATE_INVALID": "unknown",
        "ROBOT_NOT_AUTOMATIC": "unknown",
        "ROBOT_STATE_JUMPED": "unknown",
        "ROBOT_STATE_FROZEN": "unknown",
        "ROBOT_VELOCITY_WRONG": "unknown",
    }
    protocol: ClassVar[str]

    def __init__(self, case: LinkCase) -> None:
        super().__init__(case)
        self._config = yaml.safe_load(data_path(f"robot_{self.protocol}.yaml").read_text())
        robot = validated(RobotSettings, self._config["robots"][0], "the robot")
        self._robot = robot
        model = load_robot(robot, Path())
        model.moving(np.zeros(model.dof), np.zeros(model.dof))  # compiled before time matters
        self._tracker = RobotTracker(robot, model)
        self._port = free_tcp_port()
        self._server = self._started()
        self._port = self._server.port  # once it listens
        self._broken = False
        self._counted: dict[str, int] = {}

    def settings(self) -> tuple[type[ConfiguredLink[Any, Any]], ConfiguredLinkSettings]:
        """Return the shipped configuration's link, at the server's port."""
        entry = self._config["links"][0] | {"port": self._port, "wait_for_device": True}
        kind: Any = registry.load("links", entry["kind"])
        settings = validated(kind.settings_model, entry, "the link")
        return kind, kind.of_robots(settings, [self._robot])

    def look(self) -> None:
        """Process the readings, and record what the node knows of the robot."""
        if self._link is not None:
            for received in self._link.take():
                if isinstance(received.message, RobotState):
                    self._tracker.update(received.message, received.received_ns, "state")
            counters = self._link.counters
            self._counted = {"malformed": counters.malformed, "reconnects": counters.reconnects}
        reasons = self._tracker.at(self._clock.now_ns()).reasons
        self.shown.append((time.monotonic(), reasons[0].name if reasons else self.well))
        time.sleep(LOOK_S)

    def counted(self) -> dict[str, int]:
        """Return the counts of the link, and those of readings that the tracker refused."""
        return self._counted | {"invalid": self._tracker.counters["invalid"]}

    def break_or_mend(self, broken: bool) -> None:
        """Start or end the fault of the server."""
        assert isinstance(self.case, StateCase)
        if broken == self._broken:
            return
        self._broken = broken
        if self.case.server == "gone":
            if broken:
                self._server.kill()
            else:
                self._server = self._started()
        elif self.case.server == "stopped":
            self._server.hang(broken)
        else:
            self._server.toggle()

    def close(self) -> None:
        """Stop the link and the server."""
        super().close()
        self._server.kill()

    def _started(self) -> ServerProcess:
        assert isinstance(self.case, StateCase)
        fault = "none" if self.case.server in ("gone", "stopped") else self.case.server
        return ServerProcess(self.protocol, fault, self._port)


class ModbusStateCell(StateCell):
    """By Modbus."""

    protocol = "modbus"


class OpcUaStateCell(StateCell):
    """A polling link over OPC UA."""

    protocol = "opcua"


def run_states(only: str | None) -> Iterator[FaultOutcome]:
    """Run every case whose name contains ``only``, by each protocol that is installed."""
    for package, cell in (("pymodbus", ModbusStateCell), ("asyncua", OpcUaStateCell)):
        if find_spec(package) is not None:
            yield from run_cases(f"{cell.protocol}_client", cell, CASES, only)
