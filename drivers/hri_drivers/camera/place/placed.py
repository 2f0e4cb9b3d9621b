"""A person's position from a camera, or the reason why the position is not known."""

from dataclasses import dataclass

from hri_predict.base.arrays import Bools, Floats

MIN_VISIBILITY = 0.5
"""Minimum visibility of an observed joint."""
NEAREST_M, FARTHEST_M = 0.5, 15.0
"""Distances at which a camera can place a person."""
SIGMAS_99 = 2.58
"""99 % of a normal distribution lie within this many standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A person's joints in metres.

    Attributes:
        positions: (J, 3) metres in the camera's own axes (x right, y down, z away from it); for
            several cameras, in the first camera's axes. NaN where not observed.
        observed: (J,) which joints were observed.
        error_m: 99 % bound in metres of the error common to all joints.
    """

    positions: Floats
    observed: Bools
    error_m: float


@dataclass(frozen=True, slots=True)
class Unplaced:
    """A person who is seen, but whose position is unknown; the room is not empty.

    Attributes:
        why: one of a few fixed texts, so that occurrences can be counted.
    """

    why: str
