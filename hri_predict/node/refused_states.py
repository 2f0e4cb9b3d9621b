"""Readable reasons for unused RobotStates, with the joint, for programmers of controllers."""

import logging
import math
from collections.abc import Collection, Sequence

from hri_predict.protocol.messages import RobotState
from hri_predict.robots.model import RobotModel
from hri_predict.robots.tracker import RobotTracker

SAY_NS = 10_000_000_000
"""Minimum time between two log lines about one robot."""
STUCK = 25
"""Number of consecutive repeats from which on a counter is treated as stuck."""
_DEGREES = math.degrees(1.0)

log = logging.getLogger(__name__)


class RefusedStates:
    """Counts refused and repeated states of one robot, and logs the reason at a limited rate.

    Attributes:
        newest: reason of the newest refusal; empty before the first.
    """

    def __init__(self, tracker: RobotTracker) -> None:
        self.newest = ""
        self._tracker = tracker
        self._invalid = self._repeated = self._in_a_row = 0
        self._said_ns: int | None = None

    def look(self, state: RobotState, received_ns: int, link: str) -> None:
        """Record the tracker's reaction to the newest state."""
        counts = self._tracker.outcomes
        refused = counts["invalid"] > self._invalid
        repeated = counts["repeated"] > self._repeated
        self._invalid, self._repeated = counts["invalid"], counts["repeated"]
        self._in_a_row = self._in_a_row + 1 if repeated else 0
        if refused:
            self.newest = why_refused(state, self._tracker.model)
            self._say(received_ns, link, f"{self._invalid} RobotStates refused: {self.newest}")
        elif self._in_a_row >= STUCK:
            why = f"have one counter, {state.counter}: count up by 1 with each new state"
            self._say(received_ns, link, f"{self._in_a_row} RobotStates {why}")

    def _say(self, now_ns: int, link: str, what: str) -> None:
        if self._said_ns is None or now_ns - self._said_ns >= SAY_NS:
            self._said_ns = now_ns
            log.warning("robot '%s', link '%s': %s", self._tracker.settings.name, link, what)


class StrangeStates:
    """Counts RobotStates of robots that their link does not advise; logs them at a limited rate.

    Attributes:
        count: number of these states.
    """

    def __init__(self) -> None:
        self.count = 0
        self._said_ns: int | None = None

    def add(self, robot: int, received_ns: int, link: str, advised: Collection[int]) -> None:
        """Record a state of the robot with this number."""
        self.count += 1
        if self._said_ns is None or received_ns - self._said_ns >= SAY_NS:
            self._said_ns = received_ns
            log.warning(
                "link '%s': %d RobotStates refused: the newest is of robot %d, but the robots of "
                "this link are %s: correct the number, or the link's 'robots'",
                link,
                self.count,
                robot,
                ", ".join(map(str, sorted(advised))) or "none",
            )


def why_refused(state: RobotState, model: RobotModel) -> str:
    """Return a state's first mistake, with the joint, its value and the remedy."""
    offset = model.dof - model.reported
    names = model.joint_names[offset:]
    for what, values in (("positions", state.positions), ("velocities", state.velocities)):
        if len(values) != len(names):
            return (
                f"{len(values)} {what} for {len(names)} joints: send one for each of "
                f"{', '.join(names)}, in this order"
            )
    if model.mobile is not None and state.base is None:
        return "the base's pose is missing: send it with each state"
    if model.mobile is None and state.base is not None:
        return "it has a base's pose, and the base is configured to stand: leave it out"
    low, high = model.position_min[offset:].tolist(), model.position_max[offset:].tolist()
    fastest = model.velocity_max[offset:].tolist()
    units = list(model.units[offset:])
    ranges = list(zip(low, high, strict=True))
    if (line := _outside("", state.positions, ranges, names=names, units=units)) is not None:
        return line
    speeds = [(-most, most) for most in fastest]
    per_s = [f"{unit}/s" for unit in units]
    if (
        line := _outside("the velocity of ", state.velocities, speeds, names=names, units=per_s)
    ) is not None:
        return line
    return "the base's pose or velocity is outside its limits"


def _outside(
    what: str,
    values: Sequence[float | None],
    ranges: Sequence[tuple[float, float]],
    *,
    names: Sequence[str],
    units: Sequence[str],
) -> str | None:
    """Describe the first value that is missing or out of range."""
    for k, (value, (low, high)) in enumerate(zip(values, ranges, strict=True)):
        name = f"{what}joint {k + 1}, '{names[k]}',"
        if value is None or not math.isfinite(value):
            return f"{name} is not a number: send a measured one"
        if not low <= value <= high:
            line = f"{name} = {value:g} is outside its limits {low:.4g}..{high:.4g} {units[k]}"
            if units[k].startswith("rad") and _are_degrees(values, ranges, units):
                line += ": radians are meant, these look like degrees"
            return line
    return None


def _are_degrees(
    values: Sequence[float | None], ranges: Sequence[tuple[float, float]], units: Sequence[str]
) -> bool:
    """Whether all values are within their ranges if those of revolute joints are in degrees."""
    return all(
        value is not None and low <= (value / _DEGREES if unit.startswith("rad") else value) <= high
        for value, (low, high), unit in zip(values, ranges, units, strict=True)
    )
