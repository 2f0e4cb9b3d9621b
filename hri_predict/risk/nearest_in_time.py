"""Which body segment is nearest to which part of the robot, step by step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.risk.geometry import capsule_distance
from hri_predict.risk.types import Capsules
from hri_predict.scene import Floats


@dataclass(frozen=True, slots=True, eq=False)
class NearestInTime:
    """Nearest pair of any person and the robot per step: (K,) distance and indices."""

    distance: Floats
    person: NDArray[np.intp]
    segment: NDArray[np.intp]
    link: NDArray[np.intp]


@np.errstate(invalid="ignore")  # what is not finite is found and answered below
def nearest_in_time(people: Capsules, robot: Capsules) -> NearestInTime:
    """Smallest distance between any of the people and the robot, step by step, exact.

    Most pairs are ruled out by their bounding spheres: the distance of two capsules is at least
    that of the spheres around them and at most that of the spheres about their middles.

    Args:
        people: (P, K, S) capsules, P >= 1.
        robot: (K, C) capsules.

    Returns:
        (K,) each; a step in which anything is not finite has the distance minus infinity.
    """
    count, steps, segments = people.radius.shape
    links = robot.radius.shape[-1]
    middle, half = _spheres(people.a, people.b)  # (P, K, S) each
    robot_middle, robot_half = _spheres(robot.a, robot.b)
    square = np.zeros((steps, count * segments, links))
    for body_x, robot_x in zip(middle, robot_middle, strict=True):
        gap = _by_step(body_x)[..., None] - robot_x[:, None]
        square += gap * gap
    most = np.sqrt(square) - _by_step(people.radius)[..., None] - robot.radius[:, None]
    least = most - _by_step(half)[..., None] - robot_half[:, None]
    bound = most.reshape(steps, -1).min(1)
    step, body, link = np.nonzero(~(least > bound[:, None, None]))  # NaN stays in
    person, segment = np.divmod(body, segments)
    exact = capsule_distance(
        Capsules(
            people.a[person, step, segment],
            people.b[person, step, segment],
            people.radius[person, step, segment],
        ),
        Capsules(robot.a[step, link], robot.b[step, link], robot.radius[step, link]),
    )
    distance = np.full((steps, count * segments * links), np.inf)
    flat = body * links + link
    distance[step, flat] = np.where(np.isfinite(exact), exact, -np.inf)
    index = distance.argmin(1)
    body, link = np.divmod(index, links)
    person, segment = np.divmod(body, segments)
    return NearestInTime(distance[np.arange(steps), index], person, segment, link)


def _by_step(values: Floats) -> Floats:
    """(P, K, S) to (K, P S)."""
    result: Floats = values.swapaxes(0, 1).reshape(values.shape[1], -1)
    return result


def _spheres(a: Floats, b: Floats) -> tuple[list[Floats], Floats]:
    """Middles of axes, one array per coordinate (the fastest for numpy), and half their length."""
    middle, axis = 0.5 * (a + b), b - a
    square = axis[..., 0] ** 2 + axis[..., 1] ** 2 + axis[..., 2] ** 2
    return [middle[..., i] for i in range(3)], 0.5 * np.sqrt(square)
