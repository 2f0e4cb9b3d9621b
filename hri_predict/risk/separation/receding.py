"""Part of its path on which every part of a robot recedes from all people.

In ISO/TS 15066, v_r is the robot's speed *towards* the person. A robot does not recede if its tool
recedes but its elbow swings outwards. So each link's distance to each person is checked separately;
the first decrease ends the part.
"""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import Capsules, capsule_distance

FALLS_M = 1e-9
"""Smaller changes are ignored, because a link may turn about its own axis."""


def receding_steps(people: Capsules, robot: Capsules) -> int:
    """Return the number of steps of a path without a decrease of any link-person distance.

    Args:
        people: (P, S) capsules, as captured.
        robot: (K, C) capsules at instants along the path, K >= 2; the first is now.

    Returns:
        0..K-1. Distances are compared only at the instants. A distance that is not finite ends the
        count.
    """
    steps = len(robot.radius)
    for first, until in ((0, 2), (1, steps)):  # most approaching links show it in the first step
        grows = np.diff(link_distances(people, robot[first:until]), axis=0) >= -FALLS_M
        falls = np.flatnonzero(~grows.all(axis=(1, 2)))
        if falls.size:
            return first + int(falls[0])
    return steps - 1


def link_distances(people: Capsules, robot: Capsules) -> Floats:
    """Return the distance (K, C, P) of each robot capsule (K, C) from each person (P, S)."""
    distance: Floats = capsule_distance(people, robot[:, :, None, None]).min(-1)
    return distance
