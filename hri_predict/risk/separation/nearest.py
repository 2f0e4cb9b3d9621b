"""Which body segment is nearest to which part of the robot, step by step."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hri_predict.arrays import Floats, Ints
from hri_predict.geometry import Capsules, Xyz, axis_distance

ROUNDING_M = 1e-9
"""Pairs within this of a bound are kept: two orders of addition may differ in the last bit."""


_THICK, _SIZE = 3, 4
"""Rows of spheres: the capsule's radius, and the radius of the sphere around all of it."""


@dataclass(frozen=True, slots=True, eq=False)
class NearestInTime:
    """Nearest pair of any person and the robot per step or course: distance and indices."""

    distance: Floats
    person: Ints
    segment: Ints
    link: Ints


@dataclass(frozen=True, slots=True, eq=False)
class Courses:
    """L ways in which one robot may move on.

    Attributes:
        capsules: (L, K, C) of each course, step by step.
        until: (L,) the last step that counts, at least 1; the first is step 1.
        enough_m: (L,) larger distances need not be known: the result is then ``enough_m``.
    """

    capsules: Capsules
    until: Ints
    enough_m: Floats


class BodiesInTime:
    """Everybody's capsules, step by step, ready for comparison with a robot's.

    Bounding spheres rule out most pairs, first those of whole people. The distance between two
    capsules is at least that of the spheres around them, and at most that of the spheres about
    their middles. The distances of the remaining pairs are exact.

    Args:
        people: (P, K, S) capsules, P >= 1.
    """

    def __init__(self, people: Capsules) -> None:
        persons, self._steps, segments = people.radius.shape
        with np.errstate(invalid="ignore"):
            self._rows = _rows(people)  # (7, P K S)
            spheres = _spheres(self._rows)
            self._persons = _around(spheres.reshape(5, persons, self._steps, segments))  # (5, P, K)
        self._segments = spheres.reshape(5, persons * self._steps, segments)

    def nearest(self, robot: Capsules) -> NearestInTime:
        """Smallest distance between any of the people and the robot, step by step.

        Args:
            robot: (K, C) capsules; (1, C): it stays where it is.

        Returns:
            (K,) each. If anything in a step is not finite, its distance is minus infinity.
        """
        step = np.arange(self._steps)
        place = step if len(robot.radius) > 1 else np.zeros_like(step)
        return self._search(
            robot, step=step, place=place, group=step, enough_m=np.full(len(step), np.inf)
        )

    def standing(self, robots: Sequence[Capsules], steps: Sequence[int]) -> list[NearestInTime]:
        """``nearest`` of each of several robots that stay where they are.

        Args:
            robots: (C,) capsules each.
            steps: for each robot, how many of the K steps are wanted.
        """
        places = [Capsules(r.a[None], r.b[None], r.radius[None]) for r in robots]
        step = np.concatenate([np.arange(n) for n in steps])
        place = np.repeat(np.arange(len(robots)), steps)
        group = np.arange(len(step))
        found = self._search(
            _one_by_one(places),
            step=step,
            place=place,
            group=group,
            enough_m=np.full(len(step), np.inf),
        )
        return _parted(found, steps)

    def least(self, robots: Sequence[Courses]) -> list[NearestInTime]:
        """Smallest distance along each of several courses of each of several robots.

        Returns:
            (L,) each; minus infinity if anything is not finite.
        """
        steps = [np.minimum(r.until, r.capsules.radius.shape[1] - 1) for r in robots]
        counts = np.concatenate(steps)
        # every course's steps after now, course after course
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        length = np.repeat([r.capsules.radius.shape[1] for r in robots], [len(n) for n in steps])
        place = np.repeat(np.cumsum(length) - length, counts) + within + 1
        group = np.repeat(np.arange(len(counts)), counts)
        flat = [
            Capsules(
                c.a.reshape(-1, *c.a.shape[2:]),
                c.b.reshape(-1, *c.b.shape[2:]),
                c.radius.reshape(-1, c.radius.shape[2]),
            )
            for c in (r.capsules for r in robots)
        ]
        enough_m = np.concatenate([r.enough_m for r in robots])
        found = self._search(
            _one_by_one(flat), step=within + 1, place=place, group=group, enough_m=enough_m
        )
        return _parted(found, [len(n) for n in steps])

    @np.errstate(invalid="ignore")  # numbers that are not finite are handled below
    def _search(
        self, robot: Capsules, *, step: Ints, place: Ints, group: Ints, enough_m: Floats
    ) -> NearestInTime:
        """The least distance of each group of rows; a row is bodies at a step, and a robot's place.

        Args:
            robot: (Q, C) capsules.
            step, place: (R,) indices of the bodies' K and the robot's Q.
            group: (R,) ascending from 0, without gaps.
            enough_m: of each group.
        """
        persons, segments = self._persons.shape[1], self._segments.shape[2]
        places, links = robot.radius.shape
        robot_rows = _rows(robot)  # (7, Q C)
        parts = _spheres(robot_rows)
        starts = np.searchsorted(group, np.arange(len(enough_m)))

        # Whole people against links: (C, P, R), rows last because they are many.
        part = parts.reshape(5, places, links).swapaxes(1, 2).take(place, axis=2)[:, :, None]
        person = self._persons.take(step, axis=2)
        least = _apart(part, person[:, None])
        least -= part[_SIZE] + person[_SIZE]
        least = least.reshape(links * persons, -1)
        c, p = np.divmod(least.argmin(0), persons)
        likely_part = parts.take(place * links + c, axis=1)[..., None]
        likely_body = self._segments.take(p * self._steps + step, axis=1)
        first = _at_most(likely_part, likely_body).min(1)
        limit = np.minimum(enough_m, np.minimum.reduceat(first, starts)) + ROUNDING_M
        row, pair = np.nonzero(~(least > limit.take(group)).T)  # NaN stays in
        c, p = np.divmod(pair, persons)
        of = group.take(row)

        # Their segments: (n, S).
        part_at, body_at = place.take(row) * links + c, p * self._steps + step.take(row)
        part = parts.take(part_at, axis=1)[..., None]
        body = self._segments.take(body_at, axis=1)
        most = _at_most(part, body)
        if len(of):
            starts, some = _groups(of)
            closest = np.minimum.reduceat(most.reshape(-1), starts * segments)
            limit[some] = np.minimum(limit[some], closest + ROUNDING_M)
        least = most - (part[_SIZE] - part[_THICK] + (body[_SIZE] - body[_THICK]))
        n, s = np.nonzero(~(least > limit.take(of)[:, None]))
        bodies = self._rows.take(body_at.take(n) * segments + s, axis=1)
        links_at = robot_rows.take(part_at.take(n), axis=1)
        exact = axis_distance(*_axes(bodies), *_axes(links_at)) - bodies[6] - links_at[6]
        return _nearest(exact, of.take(n), enough_m, (p.take(n), s, c.take(n)))


def nearest_in_time(people: Capsules, robot: Capsules) -> NearestInTime:
    """``BodiesInTime(people).nearest(robot)``, for one comparison."""
    return BodiesInTime(people).nearest(robot)


def _one_by_one(robots: Sequence[Capsules]) -> Capsules:
    """(Q, C) capsules of all robots, one after the other; missing ones repeat the first."""
    if len(robots) == 1:
        return robots[0]
    links = max(r.radius.shape[1] for r in robots)

    def joined(parts: Sequence[Floats]) -> Floats:
        return np.concatenate(
            [np.concatenate([p, *[p[:, :1]] * (links - p.shape[1])], axis=1) for p in parts]
        )

    return Capsules(
        joined([r.a for r in robots]),
        joined([r.b for r in robots]),
        joined([r.radius for r in robots]),
    )


def _parted(found: NearestInTime, counts: Sequence[int]) -> list[NearestInTime]:
    ends = np.cumsum(counts).tolist()
    return [
        NearestInTime(
            found.distance[start:end],
            found.person[start:end],
            found.segment[start:end],
            found.link[start:end],
        )
        for start, end in zip([0, *ends], ends, strict=False)
    ]


def _groups(group: Ints) -> tuple[Ints, Ints]:
    """Where each group (ascending, not empty) starts, and the groups' numbers."""
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    return starts, group[starts]


def _nearest(
    exact: Floats, group: Ints, enough_m: Floats, who: tuple[Ints, Ints, Ints]
) -> NearestInTime:
    """The least distance of each group (ascending), and the pair that has it."""
    distance, found = enough_m.astype(np.float64), np.zeros((3, len(enough_m)), np.intp)
    if len(group):
        exact = np.where(np.isfinite(exact), exact, -np.inf)
        starts, some = _groups(group)
        distance[some] = np.minimum(np.minimum.reduceat(exact, starts), distance[some])
        is_least = np.flatnonzero(exact <= distance[group])[::-1]  # backwards: the first one stays
        found[:, group[is_least]] = [index[is_least] for index in who]
    return NearestInTime(distance, *found)


def _rows(capsules: Capsules) -> Floats:
    """(7, M) of M capsules: the axis's start, the vector to its end, the radius."""
    start = capsules.a.reshape(-1, 3)
    rows = np.empty((7, len(start)))
    rows[:3] = start.T
    np.subtract(capsules.b.reshape(-1, 3).T, rows[:3], out=rows[3:6])
    rows[6] = capsules.radius.reshape(-1)
    return rows


def _axes(rows: Floats) -> tuple[Xyz, Xyz]:
    """Start and direction of the axes in rows."""
    return (rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5])


def _spheres(rows: Floats) -> Floats:
    """(5, M) sphere about each capsule's middle: x, y, z, and the rows below."""
    spheres = np.empty((5, rows.shape[1]))
    axis = rows[3:6]
    np.add(rows[:3], 0.5 * axis, out=spheres[:3])
    spheres[_THICK] = rows[6]
    np.add(rows[6], 0.5 * np.sqrt(_square(axis)), out=spheres[_SIZE])
    return spheres


def _around(spheres: Floats) -> Floats:
    """(5, ...) a sphere that holds all (5, ..., S) of the last axis."""
    result = np.empty(spheres.shape[:-1])
    result[:3] = 0.5 * (spheres[:3].min(-1) + spheres[:3].max(-1))
    result[_SIZE] = (_apart(result[..., None], spheres) + spheres[_SIZE]).max(-1)
    result[_THICK] = result[_SIZE]
    return result


def _apart(a: Floats, b: Floats) -> Floats:
    """Distance between the spheres' centres, broadcast."""
    distance = _square(a[:3] - b[:3])
    return np.sqrt(distance, out=distance)


def _square(vectors: Floats) -> Floats:
    """Squared length of (3, ...) vectors."""
    square = vectors * vectors
    result: Floats = square[0]
    result += square[1]
    result += square[2]
    return result


def _at_most(part: Floats, body: Floats) -> Floats:
    """The largest possible distance of capsules: that of their middles less both radii."""
    most = _apart(part, body)
    most -= part[_THICK] + body[_THICK]
    return most
