"""A robot on its planned path: its place on the path, further motion and stop.

The path is a ``Trajectory``; a *phase* is a place on it, in seconds at full speed. A controller
with a speed limit runs the path at the rate that keeps its fastest point below the limit. A
controller that must stop brakes on the path (a stop of category 2 of IEC 60204-1: controlled, power
kept), with the times and distances of the robot's stopping table.
"""

import math
from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.machine.compiled import plain
from hri_predict.robots.body import ahead
from hri_predict.robots.body.ahead import stretches
from hri_predict.robots.model import RobotModel
from hri_predict.robots.trajectory import Trajectory

GRID_S = 0.01
"""Step of the table of the path, in seconds at full speed."""
JOINT_TOLERANCE = 0.02
"""Maximum deviation of joints on the path, rad or m. Smaller deviations enlarge the robot."""
VELOCITY_NOISE = 0.05
"""Maximum deviation of velocities, rad/s or m/s, plus ``VELOCITY_TOLERANCE`` of the fastest."""
VELOCITY_TOLERANCE = 0.05
_EXCESS = 0.01  # of the rate: less is rounding
_MOST_RATE = 1.1


@dataclass(frozen=True, slots=True)
class OnPlan:
    """A robot's place on its plan.

    Attributes:
        phase_s: seconds at full speed along the cycle.
        rate: phase per second, 1 at full speed; a little above where the robot is faster.
        off_m: maximum distance of any robot point from its place on the path.
    """

    phase_s: float
    rate: float
    off_m: float = 0.0


class Plan:
    """A trajectory and the robot that follows it.

    Args:
        trajectory: the path.
        model: the robot.
    """

    def __init__(self, trajectory: Trajectory, model: RobotModel) -> None:
        self.trajectory = trajectory
        self._model = model
        count = max(4, math.ceil(trajectory.duration_s / GRID_S))
        self._step_s = trajectory.duration_s / count
        self._phases: Floats = np.arange(count, dtype=np.float64) * self._step_s
        self._q, self._dq = trajectory.at(self._phases)
        self._dq_square = np.maximum((self._dq**2).sum(1), 1e-12)
        speed = model.tip_speed(self._q, self._dq)
        self._speed: Floats = np.append(speed, speed[0])  # closed
        self._closed: Floats = np.append(self._phases, trajectory.duration_s)
        # how far from the nearest of the table's places a place on the path may be
        gap = np.abs(self._dq).max(0) * self._step_s
        # one row a joint: comparing along long rows takes a third of the time
        self._joints: Floats = np.ascontiguousarray(self._q.T)
        self._near: Floats = (JOINT_TOLERANCE + gap)[:, None]

    def locate(self, q: Floats, qd: Floats, expected_s: float | None) -> OnPlan | None:
        """Return the place on the path for ``q`` (N,) rad, m, ``qd`` (N,) per second; ``None``: not
        on it.

        Joints must agree within ``JOINT_TOLERANCE``, and velocities with those of the path at some
        rate from 0 to 1. Of several places, the one nearest to ``expected_s`` is used. Without
        ``expected_s``, the place with the best agreement of joints is used, but none for a robot at
        rest, which may move either way.
        """
        if not (np.isfinite(q).all() and np.isfinite(qd).all()):
            return None
        off = np.abs(self._joints - q[:, None])
        near = np.flatnonzero((off <= self._near).all(0))  # few of many
        dq = self._dq[near]
        rate = np.clip((dq @ qd) / self._dq_square[near], 0.0, 1.0)
        fastest = float(np.abs(qd).max())
        tolerance = VELOCITY_NOISE + VELOCITY_TOLERANCE * fastest
        near = near[(np.abs(rate[:, None] * dq - qd) <= tolerance).all(1)]
        cost = np.full(len(self._q), np.inf)
        own = cost[near] = (off.take(near, axis=1) ** 2).sum(0)
        places = near[(own <= cost[near - 1]) & (own <= cost[(near + 1) % len(cost)])]
        if not len(places) or (expected_s is None and fastest <= VELOCITY_NOISE):
            return None
        if expected_s is None:
            place = int(places[cost[places].argmin()])
        else:
            away = self._phases[places] - expected_s
            around = self.trajectory.duration_s
            place = int(places[np.abs(away - around * np.round(away / around)).argmin()])
        return self._refined(place, q, qd)

    def _refined(self, place: int, q: Floats, qd: Floats) -> OnPlan | None:
        """Return the place near table entry ``place`` with the joints nearest to ``q``."""
        along = (self._q[(place + 1) % len(self._q)] - self._q[place - 1]) / 2
        part = (q - self._q[place]) @ along / max(float(along @ along), 1e-12)
        phase = float(self._phases[place] + np.clip(part, -1.0, 1.0) * self._step_s)
        on_path, dq = self.trajectory.at(phase)
        off = np.abs(q - on_path)
        if not (off <= JOINT_TOLERANCE).all():
            return None
        rate = float(np.clip(dq @ qd / max(float(dq @ dq), 1e-12), 0.0, _MOST_RATE))
        rate = rate if rate > 1.0 + _EXCESS else min(rate, 1.0)
        return OnPlan(phase % self.trajectory.duration_s, rate, self._model.shift_m(off))

    def stopping_capsules(
        self, start: OnPlan, speeds_m_s: Floats, times_s: Floats, reaction_s: float
    ) -> tuple[Capsules, Floats]:
        """Return the robot following its path and stopping on it, for several speeds.

        Until ``reaction_s`` it follows the path with its fastest point at the given speed, or at
        full speed if the path is slower (at ``start.rate`` if that is higher). Then it brakes on
        the path, for the time and along the distance of the stopping table at its speed.

        Args:
            start: place at time 0.
            speeds_m_s: (L,) speeds of the fastest point.
            times_s: (K,) seconds, from 0, non-decreasing.
            reaction_s: time until braking starts.

        Returns:
            (L, K, C) capsules; entry k contains the robot during the whole of
            [times_s[k-1], times_s[k]], entry 0 at the instant times_s[0] (the proof is at
            ``RobotModel.swept_capsules``). And (L,) seconds from time 0 until the robot stops.
        """
        phases, stands_s = self.phases(start, speeds_m_s, times_s, reaction_s)
        swept = self._model.swept_capsules(*stretches(self.trajectory.moves, phases))
        return Capsules(swept.a, swept.b, swept.radius + start.off_m), stands_s

    def phases(
        self, start: OnPlan, speeds_m_s: Floats, times_s: Floats, reaction_s: float
    ) -> tuple[Floats, Floats]:
        """Return (L, K) phases at ``times_s``, for ``stopping_capsules``, and (L,) times at which
        the robot stops.
        """
        path = self._closed, self._speed, self._step_s
        begin = start.phase_s, reaction_s, max(start.rate, 1.0)
        asked = plain(speeds_m_s), plain(times_s)
        return ahead.phases(path, self._model.stopping_tables, begin, asked)

    def forwards_m_s(self, phase_s: float, qd: Floats) -> float:
        """Return the forward speed of the fastest point on the path, at joint velocities (N,)
        rad/s; negative for backward motion.
        """
        _, dq = self.trajectory.at(phase_s)
        rate = float(dq @ qd) / max(float(dq @ dq), 1e-12)
        return rate * float(self._speed_at(np.array(phase_s)))

    def back_from(self, phase_s: float, speed_m_s: float, seconds: float, steps: int) -> Floats:
        """Return (steps + 1,) phases of a robot that moves back from ``phase_s`` for some seconds.

        Its fastest point has the given speed, or the path's speed if that is lower.
        """
        phases = [phase_s]
        for _ in range(steps):
            rate = float(self._rates(np.array([speed_m_s]), np.array([phases[-1]]))[0])
            phases.append(phases[-1] - rate * seconds / steps)
        return np.array(phases)

    def _rates(self, speeds_m_s: Floats, phases_s: Floats) -> Floats:
        """Return the phase per second at which the fastest point has the given speed, at most 1."""
        return np.minimum(1.0, speeds_m_s / np.maximum(self._speed_at(phases_s), 1e-9))

    def _speed_at(self, phases_s: Floats) -> Floats:
        """Return the speed of the fastest point at full speed."""
        phases = np.asarray(phases_s) % self.trajectory.duration_s
        speed: Floats = np.interp(phases, self._closed, self._speed)
        return speed
