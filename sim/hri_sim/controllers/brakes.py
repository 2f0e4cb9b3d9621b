"""Motion of a simulated drive, and its braking: never later than its stopping table says.

The node relies on the robot's stopping table, so the simulated arm must not stop later.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.robots.model import RobotModel
from hri_predict.robots.stopping import StoppingTable
from hri_predict.robots.trajectory import Trajectory
from hri_sim.controllers.arm import nominal_speeds

_SPEED_STEPS = 50
_PHASES = 400


@dataclass(frozen=True, eq=False)
class Drive:
    """The robot that a drive moves, and its trajectory."""

    model: RobotModel
    trajectory: Trajectory

    @cached_property
    def peak_m_s(self) -> float:
        """Peak speed of the fastest point at full speed, m/s."""
        return self.trajectory.peak_tip_speed(self.model)

    @cached_property
    def speeds(self) -> Floats:
        """See ``arm.nominal_speeds``."""
        return nominal_speeds(self.model, self.trajectory)


class Brakes:
    """The deceleration of a drive's fastest point, with each of its tools.

    Args:
        drive: the robot and its trajectory.
        deceleration_m_s2: as set; ``None``: from the stopping tables.
        up_to_m_s: the highest speed.
    """

    def __init__(self, drive: Drive, deceleration_m_s2: float | None, up_to_m_s: float) -> None:
        self._drive, self._set, self._up_to_m_s = drive, deceleration_m_s2, up_to_m_s
        self._known: dict[int | None, float] = {}

    def with_tool(self, tool: int | None) -> float:
        """m/s^2 with the tool of this number; ``None``: with the worst of all."""
        if self._set is not None:
            return self._set
        if tool not in self._known:
            model = self._drive.model.counting(tool)
            if model.mobile is None:
                self._known[tool] = deceleration_of(model, self._up_to_m_s)
            else:
                self._known[tool] = deceleration_with_base(model, self._drive.trajectory)
        return self._known[tool]


def deceleration_of(model: RobotModel, up_to_m_s: float) -> float:
    """Return a uniform deceleration (m/s^2) within the stopping time and distance at any speed."""
    speeds = up_to_m_s * np.arange(1, _SPEED_STEPS + 1) / _SPEED_STEPS
    return _least(speeds, speeds, model.table) or 1.0


def deceleration_with_base(model: RobotModel, trajectory: Trajectory) -> float:
    """The same of an arm and its base, which follow one path and brake on it together.

    Each is then within its own table at every place of the path, at any speed.
    """
    assert model.mobile is not None
    q, qd = trajectory.at(np.linspace(0.0, trajectory.duration_s, _PHASES))
    together, of_base = model.tip_speed(q, qd), model.mobile.speed(qd)
    shares = np.arange(1, _SPEED_STEPS + 1)[:, None] / _SPEED_STEPS
    parts = ((together - of_base, model.table), (of_base, model.mobile.table))
    return max(_least(shares * together, shares * part, table) for part, table in parts) or 1.0


def _least(together: Floats, part: Floats, table: StoppingTable) -> float:
    """The deceleration of ``together`` that stops the part within its table; 0: none is needed."""
    times, distances = table.times_s(part), table.distances_m(part)
    counts = (times > 0) & (distances > 0)
    if not counts.any():
        return 0.0
    together, part = together[counts], part[counts]
    # it stands after together / d, on a way of part / 2 times that
    by_time = together / times[counts]
    by_way = together * part / (2 * distances[counts])
    return float(np.maximum(by_time, by_way).max())
