"""Which body segment is nearest to which part of the robot, step by step."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hri_predict.risk.geometry import capsule_distance
from hri_predict.risk.types import Capsules
from hri_predict.scene import Floats


@dataclass(frozen=True, slots=True, eq=False)
class NearestInTime:
    """Nearest pair of any person and the robot per step: (..., K) distance and indices."""

    distance: Floats
    person: NDArray[np.intp]
    segment: NDArray[np.intp]
    link: NDArray[np.intp]


class BodiesInTime:
    """Everybody's capsules step by step, ready to be compared with a robot's.

    Args:
        people: (P, K, S) capsules, P >= 1.
    """

    def __init__(self, people: Capsules) -> None:
        self._segments = people.radius.shape[-1]
        self._a, self._b = _by_step(people.a), _by_step(people.b)  # (K, P S, 3)
        self._radius = _by_step(people.radius)
        self._middle, self._half = _spheres(self._a, self._b)

    @np.errstate(invalid="ignore")  # what is not finite is found and answered below
    def nearest(self, robot: Capsules) -> NearestInTime:
        """Smallest distance between any of the people and the robot, step by step, exact.

        Most pairs are ruled out by their bounding spheres: the distance of two capsules is at least
        that of the spheres around them and at most that of the spheres about their middles.

        Args:
            robot: (..., K, C) capsules; leading axes are several courses of the robot, and K = 1
                is a robot that stays where it is.

        Returns:
            (..., K) each; a step in which anything is not finite has the distance minus infinity.
        """
        steps, bodies = self._radius.shape
        links = robot.radius.shape[-1]
        lead = robot.radius.shape[:-2]
        middle, half = _spheres(robot.a, robot.b)
        # (..., K, C, P S): the longer axis last, where numpy's loops run
        most = self._middle[0][:, None] - middle[0][..., None]
        most *= most
        for body_x, robot_x in zip(self._middle[1:], middle[1:], strict=True):
            gap = body_x[:, None] - robot_x[..., None]
            gap *= gap
            most += gap
        np.sqrt(most, out=most)
        most -= self._radius[:, None] + robot.radius[..., None]
        bound = most.min(axis=(-2, -1), keepdims=True)
        least = np.subtract(most, self._half[:, None] + half[..., None], out=most)
        possible = ~(least > bound)  # NaN stays in
        row, pair = np.nonzero(possible.reshape(-1, bodies * links))
        link, body = np.divmod(pair, bodies)
        step = row % steps
        # a row of the robot's: its own step, or the only one
        of_robot = row if robot.radius.shape[-2] == steps else row // steps
        exact = capsule_distance(
            Capsules(self._a[step, body], self._b[step, body], self._radius[step, body]),
            Capsules(
                robot.a.reshape(-1, links, 3)[of_robot, link],
                robot.b.reshape(-1, links, 3)[of_robot, link],
                robot.radius.reshape(-1, links)[of_robot, link],
            ),
        )
        distance = np.full((possible.size // (bodies * links), bodies * links), np.inf)
        distance[row, pair] = np.where(np.isfinite(exact), exact, -np.inf)
        index = distance.argmin(1)
        shape = (*lead, steps)
        link, body = np.divmod(index, bodies)
        person, segment = np.divmod(body, self._segments)
        least_m = distance[np.arange(len(index)), index]
        return NearestInTime(
            least_m.reshape(shape),
            person.reshape(shape),
            segment.reshape(shape),
            link.reshape(shape),
        )


def nearest_in_time(people: Capsules, robot: Capsules) -> NearestInTime:
    """``BodiesInTime(people).nearest(robot)``, for one comparison."""
    return BodiesInTime(people).nearest(robot)


def _by_step(values: Floats) -> Floats:
    """(P, K, S, ...) to (K, P S, ...)."""
    people, steps, segments = values.shape[:3]
    result: Floats = values.swapaxes(0, 1).reshape(steps, people * segments, *values.shape[3:])
    return result


def _spheres(a: Floats, b: Floats) -> tuple[list[Floats], Floats]:
    """Middles of axes, one array per coordinate (the fastest for numpy), and half their length."""
    middle, axis = 0.5 * (a + b), b - a
    square = axis[..., 0] ** 2 + axis[..., 1] ** 2 + axis[..., 2] ** 2
    return [np.ascontiguousarray(middle[..., i]) for i in range(3)], 0.5 * np.sqrt(square)
