"""Stopping time and distance of a robot, as functions of its speed."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.machine.compiled import plain
from hri_predict.robots.file import StoppingFile

STANDING_M_S = 0.001
"""Speed below which a robot is at rest, with zero stopping time and distance."""
_SPEED_STEPS = 256
"""Number of steps up to the robot's highest speed, to which speed limits are rounded down."""


class StoppingTable:
    """Stopping time and distance at any speed, interpolated from a table.

    Values are linear between the table's speeds. Below the first speed: the first time, with
    proportional distance. Above the last speed: constant deceleration, with time proportional to
    the speed and distance to its square.

    Args:
        speeds, times, distances: (N,) m/s, s, m; see ``StoppingFile``.

    Attributes:
        stretch: factor on times and distances.
    """

    def __init__(self, speeds: Floats, times: Floats, distances: Floats) -> None:
        self._speeds, self._times, self._distances = speeds, times, distances
        self._distance_curve = np.append(0.0, speeds), np.append(0.0, distances)
        self.stretch = 1.0

    @classmethod
    def of(cls, stopping: StoppingFile, loads: Sequence[float | None]) -> Self:
        """Return the row with the smallest load that covers all loads (kg); ``None``: any load.

        A row with more load never stops sooner (``StoppingFile``).
        """
        known = [load for load in loads if load is not None]
        heaviest = max(known) if len(known) == len(loads) else np.inf
        covering = (row for row in stopping.rows if row.payload_kg >= heaviest)
        row = next(covering, stopping.rows[-1])
        return cls(np.array(stopping.speed_m_s), np.array(row.time_s), np.array(row.distance_m))

    @property
    def rows(self) -> tuple[Floats, Floats, Floats]:
        """Speeds, times and distances as given."""
        return self._speeds, self._times, self._distances

    def times_s(self, speeds: Floats) -> Floats:
        """Return the times from the onset of braking to rest, in seconds, for several speeds."""
        beyond = np.maximum(speeds / self._speeds[-1], 1.0)
        times: Floats = np.interp(speeds, self._speeds, self._times) * (beyond * self.stretch)
        return np.where(speeds >= STANDING_M_S, times, 0.0)

    def distances_m(self, speeds: Floats) -> Floats:
        """Metres likewise."""
        knots, distances = self._distance_curve
        beyond = np.maximum(speeds / knots[-1], 1.0) ** 2
        distance: Floats = np.interp(speeds, knots, distances) * (beyond * self.stretch)
        return np.where(speeds >= STANDING_M_S, distance, 0.0)

    def at(self, speed: float) -> tuple[float, float]:
        """Return time and distance at one speed, fast."""
        if not speed >= STANDING_M_S:
            return 0.0, 0.0
        beyond = max(speed / float(self._speeds[-1]), 1.0)
        knots, distances = self._distance_curve
        time_s = float(np.interp(speed, self._speeds, self._times))
        distance_m = float(np.interp(speed, knots, distances))
        return time_s * (beyond * self.stretch), distance_m * (beyond**2 * self.stretch)

    def hold_s(self, speeds: Floats, stopping_s: Floats) -> Floats:
        """Return the delay from the brake command to the start of a uniform deceleration.

        Holding the speed for h and then braking uniformly over T - h covers speed x (T + h) / 2, so
        the delay accounts for table distances longer than speed x T / 2.
        """
        moving = np.where(speeds > 0, speeds, 1.0)
        hold = np.where(speeds > 0, 2 * self.distances_m(speeds) / moving - stopping_s, 0.0)
        result: Floats = np.minimum(np.maximum(hold, 0.0), stopping_s)
        return result

    def hold_most_s(self, speeds: Floats) -> Floats:
        """Return the longest ``hold_s`` up to each speed, or up to the table's next speed.

        Between two of the table's speeds S = a + b v and T = c + d v, so 2 S / v - T has at most
        one maximum, at v^2 = -2 a / d, and otherwise its extremes at the two speeds. Above the last
        speed it increases with v.
        """
        knots, times, distances = self._speeds, self._times, self._distance_curve[1][1:]
        step = np.maximum(np.diff(knots), 1e-9)
        steep = np.diff(distances) / step
        start = distances[:-1] - steep * knots[:-1]
        square = np.maximum(-2 * start, 0.0) * step / np.maximum(np.diff(times), 1e-12)
        top = np.clip(np.sqrt(square), knots[:-1], knots[1:])
        there = 2 * np.interp(top, knots, distances) / top - np.interp(top, knots, times)
        twice = 2 * distances / knots
        at_knots = twice - times
        between = np.maximum(there, np.maximum(at_knots[1:], at_knots[:-1]))
        most = np.maximum.accumulate(np.append(at_knots[0], between))
        beyond = (twice[-1] - times[-1]) * np.maximum(speeds / knots[-1], 1.0)
        found = most[np.minimum(np.searchsorted(knots, speeds), len(knots) - 1)]
        result: Floats = np.maximum(np.maximum(found, beyond), 0.0) * self.stretch
        return result

    def travel_s(
        self, speeds: Floats, times_s: Floats, reaction_s: float, stopping_s: Floats
    ) -> Floats:
        """Return the distance of a robot along its path at ``times_s`` (..., K), in seconds at full
        speed.

        ``speeds`` and ``stopping_s`` are (..., 1).
        """
        hold = self.hold_s(speeds, stopping_s)
        onset, braking = reaction_s + hold, stopping_s - hold
        after = np.minimum(np.maximum(times_s - onset, 0.0), braking)
        lost = after**2 / np.where(braking > 0, 2 * braking, np.inf)
        travel: Floats = np.minimum(np.maximum(times_s, 0.0), onset) + after - lost
        return travel


@dataclass(frozen=True, slots=True, eq=False)
class StoppingCurve:
    """A table of stopping time and distance over speed.

    Attributes:
        speed_m_s: (N,) ascending from 0 to the robot's highest speed.
        time_s: (N,) T_s, non-decreasing.
        distance_m: (N,) S_s, non-decreasing.
    """

    speed_m_s: Floats
    time_s: Floats
    distance_m: Floats

    @classmethod
    def of(cls, stopping: Callable[[float], tuple[float, float]], max_speed_m_s: float) -> Self:
        """Return a table of ``stopping`` (speed -> time, distance), made monotone from below."""
        speeds = np.linspace(0.0, max_speed_m_s, _SPEED_STEPS + 1)
        table = np.array([stopping(float(speed)) for speed in speeds], dtype=np.float64)
        if not (np.isfinite(table).all() and (table >= 0).all()):
            raise ValueError("stopping time and distance must be finite and not negative")
        time_s, distance_m = np.maximum.accumulate(table, axis=0).T
        return cls(speeds, plain(time_s), plain(distance_m))

    @property
    def max_speed_m_s(self) -> float:
        """The highest speed in the table."""
        return float(self.speed_m_s[-1])

    @property
    def arrays(self) -> tuple[Floats, Floats, Floats]:
        """Speeds, times and distances."""
        return self.speed_m_s, self.time_s, self.distance_m

    def highest(self, counts: Ints) -> tuple[float, ...]:
        """Return, for each count, the maximum of the first speeds; 0 for a count of 0."""
        return tuple(float(self.speed_m_s[n - 1]) if n > 0 else 0.0 for n in counts.tolist())

    def at(self, speed_m_s: float) -> tuple[float, float]:
        """Return T_s and S_s at a speed, interpolated between the table's speeds."""
        time_s = np.interp(speed_m_s, self.speed_m_s, self.time_s)
        return float(time_s), float(np.interp(speed_m_s, self.speed_m_s, self.distance_m))
