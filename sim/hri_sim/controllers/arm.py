"""A simulated arm that follows its trajectory no faster than permitted.

The arm never leaves its path: it only slows down along the path, as in a "stop category 2".
"""

import math
from typing import Protocol

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.protocol.messages import BaseMotion

_GRID_S = 0.002  # spacing of the table of the path's nominal speed
_SUBSTEP_S = 0.001
_FLOOR = 0.05  # fraction of the path's peak speed; see ``SimulatedArm``


class Kinematics(Protocol):
    """The part of a robot model that the arm uses."""

    def tip_speed(self, q: Floats, qd: Floats) -> Floats:
        """Speed of the fastest point of any capsule, m/s."""


class Path(Protocol):
    """The part of a trajectory that the arm uses: cyclic, with continuous velocity."""

    @property
    def duration_s(self) -> float:
        """Duration of one cycle at nominal speed, in seconds."""

    def at(self, t_s: float | Floats) -> tuple[Floats, Floats]:
        """Joints (..., N) rad and velocities (..., N) rad/s, at times (...)."""


def nominal_speeds(model: Kinematics, trajectory: Path) -> Floats:
    """(M,) speed of the fastest point over one cycle at full speed, evenly spaced in time, m/s."""
    duration_s = float(trajectory.duration_s)
    count = max(2, math.ceil(duration_s / _GRID_S)) + 1
    return np.asarray(model.tip_speed(*trajectory.at(np.linspace(0.0, duration_s, count))))


class SimulatedArm:
    """The arm: a path parameter ``path_s`` (seconds of the trajectory) and its rate in 0..1.

    It may also move backwards along its path, but reverses only at standstill.

    The speed of its fastest point is the rate times the trajectory's own speed there.
    ``deceleration_m_s2`` and ``acceleration_m_s2`` limit the change of that speed: a stop from v
    takes at most v / deceleration, whatever the trajectory does in that time. Where the trajectory
    itself is (nearly) at rest, a small floor speed replaces its speed in this calculation, so that
    the arm passes its turning points and dwells.
    """

    def __init__(
        self,
        *,
        model: Kinematics,
        trajectory: Path,
        deceleration_m_s2: float,
        acceleration_m_s2: float,
        path_s: float = 0.0,
        rate: float = 0.0,
        speeds: Floats | None = None,
    ) -> None:
        """Start at ``path_s`` with ``rate``; ``speeds``: result of ``nominal_speeds``, if known."""
        self._trajectory = trajectory
        self.deceleration_m_s2 = deceleration_m_s2
        self._acceleration = acceleration_m_s2
        self._duration_s = float(trajectory.duration_s)
        speeds = nominal_speeds(model, trajectory) if speeds is None else speeds
        self.peak_speed_m_s = float(speeds.max())
        floor = max(_FLOOR * self.peak_speed_m_s, 1e-6)
        self._governed = np.maximum(speeds, floor).tolist()  # plain floats: read one by one, fast
        self._last = len(speeds) - 2
        self._per_s = (len(speeds) - 1) / self._duration_s
        self.path_s = path_s % self._duration_s
        self.rate = rate
        self._way = 1.0  # -1 while it goes back
        self._now_ns: int | None = None

    def step(self, now_ns: int, permitted_m_s: float, *, backwards: bool = False) -> None:
        """Advance to ``now_ns``, braking or accelerating to ``permitted_m_s`` on the way."""
        if self._now_ns is None or now_ns <= self._now_ns:
            self._now_ns = now_ns if self._now_ns is None else self._now_ns
            return
        if not permitted_m_s > 0:  # NaN too
            permitted_m_s = 0.0
        way = -1.0 if backwards else 1.0
        if way != self._way and self.rate == 0.0:
            self._way = way
        elif way != self._way:
            permitted_m_s = 0.0  # it stands before it turns round
        elapsed_s = (now_ns - self._now_ns) * 1e-9
        self._now_ns = now_ns
        count = min(max(1, math.ceil(elapsed_s / _SUBSTEP_S)), 1000)
        self._substeps(count, elapsed_s / count, permitted_m_s)

    def joints(self) -> tuple[Floats, Floats]:
        """Joint positions and velocities (N,), rad and rad/s."""
        q, nominal = self._trajectory.at(self.path_s)
        return np.asarray(q, dtype=float), np.asarray(nominal, dtype=float) * (
            self._way * self.rate
        )

    @property
    def at_rest(self) -> bool:
        """Whether the arm stands because motion is not permitted."""
        return self.rate == 0.0

    def _substeps(self, count: int, dt: float, permitted_m_s: float) -> None:
        """Advance ``count`` times by ``dt``: one loop over plain numbers, for speed."""
        path_s, rate, way = self.path_s, self.rate, self._way
        slower, faster = self.deceleration_m_s2 * dt, self._acceleration * dt
        for _ in range(count):
            speed = rate * self._nominal(path_s)
            # where this substep ends, to first order: that is where the new speed holds
            ahead = self._nominal(path_s + way * rate * dt)
            wanted = permitted_m_s if permitted_m_s < ahead else ahead
            if speed > wanted:
                reached = max(wanted, speed - slower)
            else:
                reached = min(wanted, speed + faster)
            before, rate = rate, min(reached / ahead, 1.0)
            if permitted_m_s < speed:
                rate = min(rate, before)  # it must brake, so a slower path never speeds it up
            path_s = (path_s + way * 0.5 * (before + rate) * dt) % self._duration_s
        self.path_s, self.rate = path_s, rate

    def _nominal(self, path_s: float) -> float:
        place = (path_s % self._duration_s) * self._per_s
        i = int(place)
        if i > self._last:
            i = self._last
        low, high = self._governed[i], self._governed[i + 1]
        value: float = low + (high - low) * (place - i)
        return value


def base_of(q: Floats, qd: Floats) -> BaseMotion:
    """Pose and twist of a moving base; they precede the joints."""
    (x, y, yaw), (vx, vy, turn) = q[:3].tolist(), qd[:3].tolist()
    yaw = math.remainder(yaw, 2 * math.pi)
    return BaseMotion(x_m=x, y_m=y, yaw_rad=yaw, vx_m_s=vx, vy_m_s=vy, yaw_rate_rad_s=turn)
