"""How far along its path a robot gets away from everybody with every part of itself.

ISO/TS 15066 lets v_r be the robot's speed *towards* the person. A tool that retreats while an elbow
swings out does not get away: so each link's distance to each person is followed by itself, and the
first that falls ends the retreat.
"""

import numpy as np

from hri_predict.risk.geometry import capsule_distance
from hri_predict.risk.types import Capsules
from hri_predict.scene import Floats

FALLS_M = 1e-9
"""A distance that changes by no more than this stays the same: a link turning about itself."""


def retreat_steps(people: Capsules, robot: Capsules) -> int:
    """How many steps of a path every distance of link and person grows, or at least does not fall.

    Args:
        people: (P, S) capsules, as captured.
        robot: (K, C) capsules at instants along the path, K >= 2; the first is now.

    Returns:
        0..K-1; distances are compared at the instants, not in between. What is not finite ends it.
    """
    steps = len(robot.radius)
    before = link_distances(people, _part(robot, 0, 1))
    done = 0
    for until in (2, steps):  # who approaches does so at once: then the rest needs no look
        after = link_distances(people, _part(robot, done + 1, until))
        grows = np.diff(after, axis=0, prepend=before) >= -FALLS_M
        falls = np.flatnonzero(~grows.all(axis=(1, 2)))
        if falls.size:
            return done + int(falls[0])
        done, before = until - 1, after[-1:]
        if done == steps - 1:
            break
    return done


def link_distances(people: Capsules, robot: Capsules) -> Floats:
    """(K, C, P) distance of each robot capsule (K, C) to each of the people (P, S)."""
    a = Capsules(people.a, people.b, people.radius)
    b = Capsules(
        robot.a[:, :, None, None], robot.b[:, :, None, None], robot.radius[:, :, None, None]
    )
    distance: Floats = capsule_distance(a, b).min(-1)
    return distance


def _part(robot: Capsules, start: int, stop: int) -> Capsules:
    return Capsules(robot.a[start:stop], robot.b[start:stop], robot.radius[start:stop])
