"""Bodies of one shape at places of the room, as a source gives them."""

import numpy as np

from hri_predict.base.arrays import Bools
from hri_predict.base.settings import Region
from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person

J = len(JOINTS)
SHAPE = np.random.default_rng(7).uniform([-0.2, -0.4, 0.0], [0.2, 0.4, 1.8], (J, 3))
"""About the size of a body, so that the mean of the joints stands for it."""
ALL, NONE = np.ones(J, bool), np.zeros(J, bool)
DOOR = Region(polygon=[[4.0, -1.0], [6.0, -1.0], [6.0, 1.0], [4.0, 1.0]])
EXIT = {"polygon": [[2, -3], [2.8, -3], [2.8, 3], [2, 3]], "z_min": -1, "z_max": 3}


def body(number: int, x: float, y: float = 0.0, observed: Bools = ALL) -> Person:
    """Somebody who stands ``x``, ``y`` from the origin."""
    return Person(number, SHAPE + np.array([x, y, 0.0]), observed)


def noisy(number: int, x: float, y: float = 0.0, *, seed: int) -> Person:
    """A person who stands there, with the noise of a sensor."""
    noise = np.random.default_rng([number, seed]).normal(0.0, 0.002, (J, 3))
    return Person(number, SHAPE + np.array([x, y, 0.0]) + noise, ALL)


def nowhere(number: int) -> Person:
    """Somebody of whom no joint is seen."""
    return Person(number, np.full((J, 3), np.nan), NONE)


def lost_at(snapshot) -> list[float]:
    """Where people were lost: x of the first joint, less the body's own."""
    return sorted(round(float(p.positions[0, 0] - SHAPE[0, 0]), 1) for p in snapshot.lost)
