"""A cyclic joint trajectory from YAML: minimum-jerk moves between waypoints.

Between two waypoints every joint follows ``s(x) = 10 x^3 - 15 x^4 + 6 x^5`` (T. Flash, N. Hogan,
"The coordination of arm movements", J. Neuroscience 5 (1985) 1688-1703): position, velocity and
acceleration are continuous and the arm rests at each waypoint. Within a move, positions stay
between its ends and the maximum velocity is 15/8 of the mean, so limits are checked exactly.
"""

from bisect import bisect_right
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import Field, field_validator

from hri_predict.base.arrays import Floats
from hri_predict.base.errors import ConfigError, RobotError
from hri_predict.base.files import data_path, read_yaml, shipped_path
from hri_predict.base.machine.compiled import plain
from hri_predict.base.quantities.units import meant
from hri_predict.base.settings import MAX_ANGLE_RAD, MAX_ROOM_M, Settings, validated
from hri_predict.robots.body.ahead import Moves, at_phases
from hri_predict.robots.model import RobotModel, StandingMotion

_FARTHEST = (MAX_ROOM_M, MAX_ROOM_M, 2 * MAX_ANGLE_RAD)  # a base may turn round and back
OTHER_UNIT = 2.0
"""Factor beyond a position's limits above which a wrong unit is assumed."""
_SAMPLES = 64  # of the speed within a move
PEAK = 15 / 8
"""Maximum velocity of a minimum-jerk move divided by its mean velocity."""


class Waypoint(Settings):
    """Positions of the joints (rad, m), and of a moving base, at a time within the cycle (s)."""

    time_s: float = Field(ge=0, le=86_400)
    positions: Annotated[list[float], Field(min_length=1)]
    base: Annotated[list[float], Field(min_length=3, max_length=3)] | None = Field(
        None, description="x, y (m) and yaw (rad) in the room's frame"
    )

    @field_validator("base")
    @classmethod
    def _in_the_room(cls, value: list[float] | None) -> list[float] | None:
        for each, unit, most in zip(value or (), ("m", "m", "rad"), _FARTHEST, strict=False):
            if abs(each) > most:
                raise ValueError(f"{each:g} {unit} is beyond {most:g}; {meant(each, unit)}")
        return value

    @property
    def coordinates(self) -> list[float]:
        """All positions, the base's first."""
        return [*(self.base or ()), *self.positions]


class TrajectoryFile(Settings):
    """A trajectory: the first waypoint is at 0 s; the last repeats it and ends the cycle."""

    waypoints: Annotated[list[Waypoint], Field(min_length=2)]


class Trajectory:
    """A cyclic trajectory of N joints.

    Args:
        times_s: (M,) increasing from 0.
        positions: (M, N) rad, m; the last row equals the first.

    Attributes:
        duration_s: duration of one cycle.
        moves: the trajectory as arrays; see ``ahead``.
    """

    def __init__(self, times_s: Floats, positions: Floats) -> None:
        self.duration_s = float(times_s[-1])
        # A move's maximum acceleration is 10 / sqrt(3) x move / time^2, where
        # s''(x) = 60 x - 180 x^2 + 120 x^3 has its extremes (x = 1/2 -+ 1/sqrt(12)).
        span = np.diff(times_s)[:, None]
        acceleration = 10 / np.sqrt(3) * np.abs(np.diff(positions, axis=0)) / span**2
        self.moves: Moves = plain(times_s), plain(positions), acceleration
        self._moments: list[float] = times_s.tolist()

    def at(self, t_s: float | Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (..., N), rad, m, per second, at times ``t_s`` (...)."""
        return self.at_phase(t_s, 1.0)

    def at_phase(self, phase_s: float | Floats, rate: float | Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (..., N) of an arm that follows the path at any speed.

        Args:
            phase_s: (...) progress in the cycle, in seconds at full speed; any value.
            rate: (...) phase per second: 1 is full speed, 0 is at rest.
        """
        if isinstance(phase_s, float) and isinstance(rate, float):
            return self._at_one(phase_s, rate)
        q, qd = at_phases(self.moves, np.asarray(phase_s, dtype=np.float64))
        return q, qd * np.asarray(rate)[..., None]

    def _at_one(self, phase_s: float, rate: float) -> tuple[Floats, Floats]:
        """``at_phase`` for one place in plain numbers, fast enough for every controller cycle."""
        phase = phase_s % self.duration_s
        i = min(bisect_right(self._moments, phase) - 1, len(self._moments) - 2)
        span = self._moments[i + 1] - self._moments[i]
        x = (phase - self._moments[i]) / span
        start = self.moves[1][i]
        move = self.moves[1][i + 1] - start
        q: Floats = start + move * (x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
        qd: Floats = move * (30.0 * x * x * (1.0 - x) ** 2) / span * rate
        return q, qd

    def peak_tip_speed(self, model: RobotModel) -> float:
        """Return the speed (m/s) of the fastest point of ``model`` over one cycle, sampled within
        each move.
        """
        times = self.moves[0]
        within = np.linspace(0.0, 1.0, _SAMPLES, endpoint=False)
        q, qd = self.at((times[:-1, None] + within * np.diff(times)[:, None]).ravel())
        return float(np.max(model.tip_speed(q, qd)))


def load_trajectory(
    file: str, model: RobotModel, base_dir: Path | None, key: str = ""
) -> Trajectory:
    """Read a trajectory by a shipped name ("pick_and_place") or the path of a YAML file.

    Args:
        file: a name under ``configs/trajectories``, or a path ending in .yaml.
        model: the robot that will follow it.
        base_dir: base of relative paths.
        key: the key that names it, for the message.

    Raises:
        RobotError: it is unreadable, has a wrong joint count, exceeds the joints' limits, or is
            not cyclic.
    """
    where = f"{key}: " if key else ""
    try:
        path = trajectory_path(file, base_dir)
        data = validated(
            TrajectoryFile, read_yaml(path, "trajectory file"), f"trajectory file {path}"
        )
    except ConfigError as error:
        raise RobotError(f"{where}{error}") from error
    problem = _problem(data.waypoints, model)
    if problem:
        raise RobotError(f"{where}trajectory file {path}: {problem}")
    times = np.array([w.time_s for w in data.waypoints])
    return Trajectory(times, np.array([w.coordinates for w in data.waypoints]))


def standing_at(motion: StandingMotion, model: RobotModel, name: str) -> Floats:
    """Return joints (N,) of a robot at rest.

    Args:
        motion: its configured position.
        model: the robot.
        name: name of the robot.

    Raises:
        RobotError: the positions do not fit the robot.
    """
    if len(motion.positions) != model.dof:
        raise RobotError(
            f"motion.positions: {len(motion.positions)} values, but robot '{name}' has "
            f"{model.dof} joints; give one for each of {', '.join(model.joint_names)}"
        )
    q = np.array(motion.positions)
    outside = np.flatnonzero((q < model.position_min) | (q > model.position_max))
    if outside.size:
        j = outside[0]
        raise RobotError(f"motion.positions: robot '{name}': {_outside(model, int(j), q[j])}")
    return q


def shipped_for(model: str) -> str | None:
    """Return the shipped trajectory that was made for this robot model; ``None`` without one."""
    name = f"{model}_pick_and_place"
    return name if data_path("trajectories", f"{name}.yaml").exists() else None


def slower(file: str, model: str) -> str:
    """Return, in words, a trajectory to use instead of one that is too fast for its robot."""
    own = shipped_for(model)
    return "one whose points take longer" if own is None or own == file else own


def trajectory_path(file: str, base_dir: Path | None) -> Path:
    """Return the trajectory's file, which may not exist if ``file`` is a path.

    Raises:
        ConfigError: no trajectory of this name is shipped.
    """
    return shipped_path("trajectory", "trajectories", file, base_dir)


def _outside(model: RobotModel, j: int, position: float) -> str:
    """Return the error for a joint outside its limits, with the remedy.

    A wrong unit is suggested only for implausible positions: not for 0 if the limits exclude 0, and
    not just beyond the limits.
    """
    low, high = float(model.position_min[j]), float(model.position_max[j])
    unit = model.units[j]
    remedy = "give a position within them"
    if abs(position) > OTHER_UNIT * max(abs(low), abs(high)):
        remedy = meant(position, unit, low, high)
    return (
        f"joint '{model.joint_names[j]}' at {position:g} {unit} is outside {low:g} .. {high:g}; "
        f"{remedy}"
    )


def _problem(waypoints: list[Waypoint], model: RobotModel) -> str:
    """Return the fault of the waypoints for this robot, and the remedy; or ""."""
    joints = model.joint_names[-model.reported :]
    for i, w in enumerate(waypoints):
        if len(w.positions) != model.reported:
            return (
                f"waypoints.{i}: {len(w.positions)} positions, but robot '{model.name}' has "
                f"{model.reported} joints; give one for each of {', '.join(joints)}"
            )
        if (w.base is None) != (model.mobile is None):
            moves = "moves; give base: [x, y, yaw]" if w.base is None else "is fixed; omit base"
            return f"waypoints.{i}: the base of robot '{model.name}' {moves}"
    times = np.array([w.time_s for w in waypoints])
    positions = np.array([w.coordinates for w in waypoints])
    if times[0] != 0:
        return f"waypoints.0: time_s is {times[0]:g}; the first waypoint must be at 0"
    late = np.flatnonzero(np.diff(times) <= 0)
    if late.size:
        return f"waypoints.{late[0] + 1}: time_s must exceed that of the previous waypoint"
    if not np.array_equal(positions[0], positions[-1]):
        return "the last waypoint must repeat the first one's positions, to close the cycle"
    outside = np.argwhere((positions < model.position_min) | (positions > model.position_max))
    if outside.size:
        i, j = outside[0]
        return f"waypoints.{i}: {_outside(model, j, positions[i, j])}"
    peak = PEAK * np.abs(np.diff(positions, axis=0)) / np.diff(times)[:, None]
    fast = np.argwhere(peak > model.velocity_max)
    if fast.size:
        i, j = fast[0]
        return (
            f"waypoints.{i + 1}: joint '{model.joint_names[j]}' would reach "
            f"{peak[i, j]:.3g} {model.units[j]}/s, above its {model.velocity_max[j]:g}; give the "
            f"move more time"
        )
    if model.mobile is not None:
        fastest, most = np.hypot(peak[:, 0], peak[:, 1]), model.mobile.settings.max_speed_m_s
        if fastest.max() > most:
            i = int(fastest.argmax())
            return (
                f"waypoints.{i + 1}: the base would reach {fastest[i]:.3g} m/s, above its {most:g};"
                f" allow more time for this move"
            )
    return ""
