"""How long a robot takes to stop and how far it gets, as a function of its speed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np

from hri_predict.arrays import Floats

_SPEED_STEPS = 256
"""A speed limit is one of this many steps up to the robot's highest speed, rounded down."""


@dataclass(frozen=True, slots=True, eq=False)
class StoppingCurve:
    """A table of stopping time and distance over speed.

    Attributes:
        speed_m_s: (N,) ascending from 0 to the robot's highest speed.
        time_s: (N,) T_s, never falling.
        distance_m: (N,) S_s, never falling.
    """

    speed_m_s: Floats
    time_s: Floats
    distance_m: Floats

    @classmethod
    def of(cls, stopping: Callable[[float], tuple[float, float]], max_speed_m_s: float) -> Self:
        """Table of ``stopping`` (speed -> time, distance), made monotone from below."""
        speeds = np.linspace(0.0, max_speed_m_s, _SPEED_STEPS + 1)
        table = np.array([stopping(float(speed)) for speed in speeds], dtype=np.float64)
        if not (np.isfinite(table).all() and (table >= 0).all()):
            raise ValueError("stopping time and distance must be finite and not negative")
        time_s, distance_m = np.maximum.accumulate(table, axis=0).T
        return cls(speeds, time_s, distance_m)

    @property
    def max_speed_m_s(self) -> float:
        """The highest speed in the table."""
        return float(self.speed_m_s[-1])

    def at(self, speed_m_s: float) -> tuple[float, float]:
        """T_s and S_s at a speed, interpolated between the table's speeds."""
        time_s = np.interp(speed_m_s, self.speed_m_s, self.time_s)
        return float(time_s), float(np.interp(speed_m_s, self.speed_m_s, self.distance_m))
