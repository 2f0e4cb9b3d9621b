"""A person's place by a camera, or why it is not known."""

from dataclasses import dataclass

from hri_predict.base.arrays import Bools, Floats

MIN_VISIBILITY = 0.5
"""A joint with less is not observed."""
NEAREST_M, FARTHEST_M = 0.5, 15.0
"""Distances at which a camera can place a person."""
SIGMAS_99 = 2.58
"""99 % of a normal distribution lie within this many standard deviations."""


@dataclass(frozen=True, slots=True, eq=False)
class Placed:
    """A person's joints in metres.

    Attributes:
        positions: (J, 3) metres in the camera's own axes (x right, y down, z away from it); of
            several cameras, in the first one's. NaN where not observed.
        observed: (J,) which joints were observed.
        error_m: radius in metres that holds the error common to all joints, 99 %.
    """

    positions: Floats
    observed: Bools
    error_m: float


@dataclass(frozen=True, slots=True)
class Unplaced:
    """A person who is seen, and whose place is not known: never a reason to call a room empty.

    Attributes:
        why: one of a few texts, so that they can be counted.
    """

    why: str
