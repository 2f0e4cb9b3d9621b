"""A person who walks up to the robot, hides, and reaches into its way much later."""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from tests.attacks.people import at, reach_in, walk


@dataclass(frozen=True, kw_only=True)
class Hider:
    """One such person.

    Attributes:
        bearing: of the place beside the robot, rad.
        away_m: distance of that place from the robot's base.
        start_s, speed_m_s: of the walk.
        lost_s: when the tracker loses the person.
        reach_s: when the hand goes into the robot's way.
        height_m: stature.
    """

    bearing: float
    away_m: float
    start_s: float
    speed_m_s: float
    lost_s: float
    reach_s: float
    height_m: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Hider":
        """Draw one; the robot's cycle lies within 0.6 rad of +x."""
        start_s, speed = float(rng.uniform(0.3, 2.0)), float(rng.uniform(1.0, 1.6))
        there_s = start_s + 3.6 / speed
        return cls(
            bearing=float(rng.uniform(-0.4, 0.4)),
            away_m=float(rng.uniform(1.2, 1.5)),
            start_s=start_s,
            speed_m_s=speed,
            lost_s=there_s + float(rng.uniform(0.2, 1.5)),
            reach_s=there_s + float(rng.uniform(9.0, 12.0)),
            height_m=float(rng.uniform(1.6, 1.9)),
        )

    @property
    def place(self) -> Floats:
        """(2,) where the person stands beside the robot."""
        return at(self.bearing, self.away_m)

    @property
    def end_s(self) -> float:
        """When the story is over."""
        return self.reach_s + 3.0

    def joints(self, t: float) -> Floats:
        """(21, 3) true joints."""
        if t < self.reach_s - 1.0:
            points: list[Floats | list[float]] = [[3.6, 2.4], [2.4, 0.9], self.place]
            return walk(t, points, self.speed_m_s, self.start_s, self.height_m)
        return reach_in(t, self.reach_s, self.bearing)
