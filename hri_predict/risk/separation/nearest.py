"""Nearest pair of body segment and robot part at each step."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import Capsules
from hri_predict.base.machine.compiled import plain
from hri_predict.risk.separation.search import search, spheres_of
from hri_predict.zones.toward import NOTHING, Toward


@dataclass(frozen=True, slots=True, eq=False)
class NearestInTime:
    """Nearest pair of people and robot per step or course: distance and indices."""

    distance: Floats
    person: Ints
    segment: Ints
    link: Ints

    def __getitem__(self, some: slice) -> "NearestInTime":
        """A selection of the steps."""
        return NearestInTime(
            self.distance[some], self.person[some], self.segment[some], self.link[some]
        )


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """L possible courses of one robot.

    Attributes:
        capsules: (L, K, C) capsules of each course at each step.
        until: (L,) last step to be considered, at least 1; the first step is 1.
        enough_m: (L,) upper limit of the result; larger distances are not computed.
    """

    capsules: Capsules
    until: Ints
    enough_m: Floats


class BodiesInTime:
    """The capsules of all people at each step, prepared for comparison with a robot's.

    Args:
        people: (P, K, S) capsules, P >= 1.
        toward: extent by direction of the first people; ``None``: the extent of their capsules.
    """

    def __init__(self, people: Capsules, toward: Toward | None = None) -> None:
        self._people = _plain(people)
        self._toward = NOTHING if toward is None else toward
        self._steps = people.radius.shape[1]
        self._spheres = spheres_of(*self._people)

    def nearest(self, robot: Capsules) -> NearestInTime:
        """Return the smallest distance between the people and the robot at each step.

        Args:
            robot: (K, C) capsules; (1, C): the robot does not move.

        Returns:
            (K,) each. If any value in a step is not finite, its distance is minus infinity.
        """
        step = np.arange(self._steps)
        place = step if len(robot.radius) > 1 else np.zeros_like(step)
        return self._search(robot, (step, place))

    def standing(self, robots: Sequence[Capsules], steps: Sequence[int]) -> list[NearestInTime]:
        """Return ``nearest`` for each of several robots that do not move.

        Args:
            robots: (C,) capsules per robot.
            steps: for each robot, the number of the K steps to compute.
        """
        places = [r[None] for r in robots]
        step, place = np.empty((2, sum(steps)), np.int64)
        end = 0
        for i, count in enumerate(steps):
            begin, end = end, end + count
            step[begin:end], place[begin:end] = np.arange(count), i
        found = self._search(_one_by_one(places), (step, place))
        return _parted(found, steps)

    def least(self, robots: Sequence[Courses]) -> list[NearestInTime]:
        """Return the smallest distance along each of several courses of several robots.

        Returns:
            (L,) per robot; minus infinity if any value is not finite.
        """
        flat, first, count, before = [], [], [], 0
        for robot in robots:
            courses, length, links = robot.capsules.radius.shape
            flat.append(_flat(robot.capsules, courses * length, links))
            first.append(before + 1 + length * np.arange(courses))
            count.append(np.minimum(robot.until, length - 1))
            before += courses * length
        counts = [len(n) for n in count]
        if len(robots) == 1:
            first_place, steps, enough_m = first[0], count[0], robots[0].enough_m
        else:
            first_place, steps = np.concatenate(first), np.concatenate(count)
            enough_m = np.concatenate([r.enough_m for r in robots])
        first_step = np.ones(len(steps), np.int64)
        found = self._search(_one_by_one(flat), (first_step, first_place), steps, enough_m)
        return _parted(found, counts)

    def _search(
        self,
        robot: Capsules,
        first: tuple[Ints, Ints],
        count: Ints | None = None,
        enough_m: Floats | None = None,
    ) -> NearestInTime:
        """Call ``search`` for courses that start at the steps and positions in ``first``.

        Without ``count``, each course is one step, without a limit on the distance.
        """
        if count is None:
            count = np.ones(len(first[0]), np.int64)
        if enough_m is None:
            enough_m = np.full(len(first[0]), np.inf)
        courses = *first, count, enough_m
        return NearestInTime(
            *search((self._people, self._spheres, self._toward), _plain(robot), courses)
        )


def nearest_in_time(people: Capsules, robot: Capsules) -> NearestInTime:
    """Return ``BodiesInTime(people).nearest(robot)``, for a single comparison."""
    return BodiesInTime(people).nearest(robot)


def _one_by_one(robots: Sequence[Capsules]) -> Capsules:
    """Return (Q, C) capsules of all robots in sequence; missing capsules repeat the first."""
    if len(robots) == 1:
        return robots[0]
    links = max(r.radius.shape[1] for r in robots)

    def joined(parts: list[Floats]) -> Floats:
        for i, each in enumerate(parts):
            missing = links - each.shape[1]
            if missing:
                parts[i] = np.concatenate([each, *[each[:, :1]] * missing], axis=1)
        return np.concatenate(parts)

    return Capsules(*(joined([getattr(r, part) for r in robots]) for part in ("a", "b", "radius")))


def _parted(found: NearestInTime, counts: Sequence[int]) -> list[NearestInTime]:
    ends = list(accumulate(counts))
    return [found[start:end] for start, end in zip([0, *ends], ends, strict=False)]


def _flat(capsules: Capsules, places: int, links: int) -> Capsules:
    """Return (L, K, C) capsules as (L K, C)."""
    a, b = (end.reshape(places, links, 3) for end in (capsules.a, capsules.b))
    return Capsules(a, b, capsules.radius.reshape(places, links))


def _plain(capsules: Capsules) -> tuple[Floats, Floats, Floats]:
    """Its arrays, in the form for compiled loops."""
    return plain(capsules.a), plain(capsules.b), plain(capsules.radius)
