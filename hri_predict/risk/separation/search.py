"""Search for the nearest pair of body segment and robot capsule, with loops and with arrays.

Bounding spheres exclude most pairs, first for whole people. The distance between two capsules is at
least that of the spheres around them, and at most that of the spheres around their centres. The
distances of the remaining pairs are exact. Both versions compute each distance with the same
operations in the same order, so the results are bit-identical.

A body may also have a smaller extent in one direction than its capsule (``zones.toward``). If n is
the unit vector from the segment's nearest point to the link's, the distance is then at least the
gap between segment and link along n (docs/decisions/zones-toward-the-robot.md). This distance is
never less than that of the capsules, which therefore exclude pairs as before.

A *course* is a sequence of steps of the bodies, with the robot's position at each step.
"""

from math import inf, isfinite, sqrt

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import Capsules, Xyz, axis_distance
from hri_predict.base.machine.compiled import kernel
from hri_predict.risk.separation.search_loops import (
    ROUNDING_M,
    SIZE,
    THICK,
    Arrays,
    Bodies,
    CourseRows,
    Found,
    Spheres,
    apart_exactly,
    search_by_loops,
)

# -- spheres ---------------------------------------------------------------------------------------


def _spheres_by_arrays(a: Floats, b: Floats, radius: Floats) -> Spheres:
    """Spheres (5, P, K, S) around the capsules of people, and (5, P, K) around whole people.

    Rows: x, y, z, the capsule's radius (or that of the sphere), the radius of the sphere.
    """
    with np.errstate(invalid="ignore"):
        spheres = _spheres(_rows(Capsules(a, b, radius))).reshape(5, *radius.shape)
        return spheres, _around(spheres)


def _spheres_by_loops(a: Floats, b: Floats, radius: Floats) -> Spheres:
    persons, steps, segments = radius.shape
    spheres = np.empty((5, persons, steps, segments))
    around = np.empty((5, persons, steps))
    low, high = np.empty(3), np.empty(3)
    for p in range(persons):
        for k in range(steps):
            low[:], high[:] = inf, -inf
            sound = True
            for s in range(segments):
                square = 0.0
                for i in range(3):
                    along = b[p, k, s, i] - a[p, k, s, i]
                    middle = a[p, k, s, i] + 0.5 * along
                    square += along * along
                    spheres[i, p, k, s] = middle
                    low[i], high[i] = min(low[i], middle), max(high[i], middle)
                size = radius[p, k, s] + 0.5 * sqrt(square)
                spheres[THICK, p, k, s] = radius[p, k, s]
                spheres[SIZE, p, k, s] = size
                sound = sound and isfinite(size)
                for i in range(3):
                    sound = sound and isfinite(spheres[i, p, k, s])
            largest = -inf
            for s in range(segments):
                square = 0.0
                for i in range(3):
                    off = 0.5 * (low[i] + high[i]) - spheres[i, p, k, s]
                    square += off * off
                largest = max(largest, sqrt(square) + spheres[SIZE, p, k, s])
            for i in range(3):
                around[i, p, k] = 0.5 * (low[i] + high[i])
            around[THICK, p, k] = around[SIZE, p, k] = largest if sound else inf
    return spheres, around


spheres_of = kernel(_spheres_by_loops, _spheres_by_arrays)


# -- search ----------------------------------------------------------------------------------------


@np.errstate(invalid="ignore")  # numbers that are not finite are handled below
def _search_by_arrays(bodies: Bodies, robot: Arrays, courses: CourseRows) -> Found:
    """Return the minimum distance along each of G courses, and the first pair that has it.

    Args:
        bodies: the people at each step.
        robot: (Q, C) capsules at Q positions.
        courses: see ``CourseRows``.

    Returns:
        If no distance is below ``enough``, ``enough`` and the very first pair. If any value in a
        course is not finite, its distance is minus infinity.
    """
    people, spheres, toward = bodies
    first_step, first_place, count, enough_m = courses
    radius, robot_radius = people[2], robot[2]
    persons, steps, segments = radius.shape
    places, links = robot_radius.shape
    group = np.repeat(np.arange(len(count)), count)
    ends = np.cumsum(count)
    starts = ends - count
    within = np.arange(len(group)) - np.repeat(starts, count)
    step, place = first_step.take(group) + within, first_place.take(group) + within
    rows = _rows(Capsules(*people))
    balls = spheres[0].reshape(5, persons * steps, segments)
    robot_rows = _rows(Capsules(*robot))  # (7, Q C)
    parts = _spheres(robot_rows)

    # Whole people against links: (C, P, R), rows last because they are many.
    whole = parts.reshape(5, places, links).swapaxes(1, 2).take(place, axis=2)[:, :, None]
    person = spheres[1].take(step, axis=2)
    least = _apart(whole, person[:, None])
    least -= whole[SIZE] + person[SIZE]
    least = least.reshape(links * persons, -1)
    c, p = np.divmod(least.argmin(0), persons)
    likely_part = parts.take(place * links + c, axis=1)[..., None]
    likely_body = balls.take(p * steps + step, axis=1)
    first = _at_most(likely_part, likely_body).min(1)
    capsules_alone = not len(toward.extra)
    limit = enough_m + ROUNDING_M
    if capsules_alone:
        limit = np.minimum(enough_m, np.minimum.reduceat(first, starts)) + ROUNDING_M
    row, pair = np.nonzero(~(least > limit.take(group)).T)  # NaN stays in
    c, p = np.divmod(pair, persons)
    of = group.take(row)

    # Their segments: (n, S).
    part_at, body_at = place.take(row) * links + c, p * steps + step.take(row)
    link, body = parts.take(part_at, axis=1)[..., None], balls.take(body_at, axis=1)
    most = _at_most(link, body)
    if len(of) and capsules_alone:
        starts, some = _groups(of)
        closest = np.minimum.reduceat(most.reshape(-1), starts * segments)
        limit[some] = np.minimum(limit[some], closest + ROUNDING_M)
    least = most - (link[SIZE] - link[THICK] + (body[SIZE] - body[THICK]))
    n, s = np.nonzero(~(least > limit.take(of)[:, None]))
    segment_rows = rows.take(body_at.take(n) * segments + s, axis=1)
    link_rows = robot_rows.take(part_at.take(n), axis=1)
    exact = axis_distance(*_axes(segment_rows), *_axes(link_rows)) - segment_rows[6] - link_rows[6]
    who = p.take(n), s, c.take(n)
    if not capsules_alone:
        known = np.flatnonzero(who[0] < len(toward.extra))
        at = who[0][known], step.take(row).take(n)[known], s[known]
        on = part_at.take(n)[known]
        exact[known] = [
            apart_exactly(bodies, (p_, k_, s_), robot, divmod(q_c, links))
            for p_, k_, s_, q_c in zip(*at, on, strict=True)
        ]
    return _nearest(exact, of.take(n), enough_m, who)


search = kernel(search_by_loops, _search_by_arrays)


# -- arrays ----------------------------------------------------------------------------------------


def _groups(group: Ints) -> tuple[Ints, Ints]:
    """Return the start of each non-empty group (ascending), and the group numbers."""
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    return starts, group[starts]


def _nearest(exact: Floats, group: Ints, enough_m: Floats, who: tuple[Ints, Ints, Ints]) -> Found:
    """Return the minimum distance of each group (ascending), and the pair that has it."""
    distance, found = enough_m.astype(np.float64), np.zeros((3, len(enough_m)), np.intp)
    if len(group):
        exact = np.where(np.isfinite(exact), exact, -np.inf)
        starts, some = _groups(group)
        distance[some] = np.minimum(np.minimum.reduceat(exact, starts), distance[some])
        is_least = np.flatnonzero(exact <= distance[group])[::-1]  # backwards: the first one stays
        found[:, group[is_least]] = [index[is_least] for index in who]
    return distance, found[0], found[1], found[2]


def _rows(capsules: Capsules) -> Floats:
    """Return (7, M) for M capsules: start of the axis, vector to its end, radius."""
    start = capsules.a.reshape(-1, 3)
    rows = np.empty((7, len(start)))
    rows[:3] = start.T
    np.subtract(capsules.b.reshape(-1, 3).T, rows[:3], out=rows[3:6])
    rows[6] = capsules.radius.reshape(-1)
    return rows


def _axes(rows: Floats) -> tuple[Xyz, Xyz]:
    """Return start and direction of the axes in rows."""
    return (rows[0], rows[1], rows[2]), (rows[3], rows[4], rows[5])


def _spheres(rows: Floats) -> Floats:
    """Return (5, M) spheres around the capsules: x, y, z, and the rows described at ``Spheres``."""
    spheres = np.empty((5, rows.shape[1]))
    axis = rows[3:6]
    np.add(rows[:3], 0.5 * axis, out=spheres[:3])
    spheres[THICK] = rows[6]
    np.add(rows[6], 0.5 * np.sqrt(_square(axis)), out=spheres[SIZE])
    return spheres


def _around(spheres: Floats) -> Floats:
    """Return (5, ...) spheres that contain all spheres (5, ..., S) of the last axis."""
    result = np.empty(spheres.shape[:-1])
    result[:3] = 0.5 * (spheres[:3].min(-1) + spheres[:3].max(-1))
    result[SIZE] = (_apart(result[..., None], spheres) + spheres[SIZE]).max(-1)
    result[THICK] = result[SIZE]
    return result


def _apart(a: Floats, b: Floats) -> Floats:
    """Return the distance between the centres of spheres, broadcast."""
    distance = _square(a[:3] - b[:3])
    return np.sqrt(distance, out=distance)


def _square(vectors: Floats) -> Floats:
    """Return the squared length of (3, ...) vectors."""
    square = vectors * vectors
    result: Floats = square[0]
    result += square[1]
    result += square[2]
    return result


def _at_most(part: Floats, body: Floats) -> Floats:
    """Return an upper bound of capsules' distance: distance of the centres minus both radii."""
    most = _apart(part, body)
    most -= part[THICK] + body[THICK]
    return most
