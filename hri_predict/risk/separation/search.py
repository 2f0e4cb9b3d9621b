"""The search for the nearest pair of body segment and robot capsule, as loops and as arrays.

Bounding spheres rule out most pairs, first those of whole people. The distance between two capsules
is at least that of the spheres around them, and at most that of the spheres about their middles.
The distances of the remaining pairs are exact. Both versions compute each distance by the same
operations in the same order, so they find the same to the last bit.

A body may also state how far it extends in one direction (``zones.toward``): less than its capsule
does. With n, the unit vector from the segment's nearest point to the link's, the distance is then
at least the gap between both along n (docs/decisions/zones-toward-the-robot.md). It is never less
than that of the capsules, which rule out pairs as before.

A *course* is a number of bodies' steps, one after the other, and the robot's place at each.
"""

from math import inf, isfinite, sqrt

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.geometry import Capsules, Xyz, axis_distance
from hri_predict.base.machine.compiled import kernel, part
from hri_predict.risk.separation.extent import extent
from hri_predict.zones.toward import Toward

ROUNDING_M = 1e-9
"""Pairs within this of a bound are kept: two orders of addition may differ in the last bit."""
LEAST_GAP_M = 1e-6
"""Axes nearer than this have no direction from one to the other."""
_POINT_M2 = 1e-24  # as in ``geometry``

_THICK, _SIZE = 3, 4
"""Rows of spheres: the capsule's radius, and the radius of the sphere around all of it."""

Arrays = tuple[Floats, Floats, Floats]
"""Ends a and b and radius of capsules."""
Spheres = tuple[Floats, Floats]
"""See ``spheres_of``."""
Bodies = tuple[Arrays, Spheres, Toward]
"""(P, K, S) capsules, their spheres, and the support of the first people (``NOTHING``: capsules
alone)."""
CourseRows = tuple[Ints, Ints, Ints, Floats]
"""(G,) each: the bodies' step with which a course begins; the robot's place then, which moves on by
one with each step; how many steps, one at least; and which larger distances need not be known."""
Found = tuple[Floats, Ints, Ints, Ints]
"""(G,) each: distance, person, segment and link."""


# -- spheres ---------------------------------------------------------------------------------------


def _spheres_by_arrays(a: Floats, b: Floats, radius: Floats) -> Spheres:
    """Spheres (5, P, K, S) about the middles of people's capsules, and (5, P, K) around people.

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
                spheres[_THICK, p, k, s] = radius[p, k, s]
                spheres[_SIZE, p, k, s] = size
                sound = sound and isfinite(size)
                for i in range(3):
                    sound = sound and isfinite(spheres[i, p, k, s])
            largest = -inf
            for s in range(segments):
                square = 0.0
                for i in range(3):
                    off = 0.5 * (low[i] + high[i]) - spheres[i, p, k, s]
                    square += off * off
                largest = max(largest, sqrt(square) + spheres[_SIZE, p, k, s])
            for i in range(3):
                around[i, p, k] = 0.5 * (low[i] + high[i])
            around[_THICK, p, k] = around[_SIZE, p, k] = largest if sound else inf
    return spheres, around


spheres_of = kernel(_spheres_by_loops, _spheres_by_arrays)


# -- search ----------------------------------------------------------------------------------------


@np.errstate(invalid="ignore")  # numbers that are not finite are handled below
def _search_by_arrays(bodies: Bodies, robot: Arrays, courses: CourseRows) -> Found:
    """The least distance along each of G courses, and the first pair that has it.

    Args:
        bodies: of people, step by step.
        robot: (Q, C) capsules at Q places.
        courses: see ``CourseRows``.

    Returns:
        Where nothing is as near as ``enough``, that and the first pair of all. If anything in a
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
    least -= whole[_SIZE] + person[_SIZE]
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
    least = most - (link[_SIZE] - link[_THICK] + (body[_SIZE] - body[_THICK]))
    n, s = np.nonzero(~(least > limit.take(of)[:, None]))
    segment_rows = rows.take(body_at.take(n) * segments + s, axis=1)
    link_rows = robot_rows.take(part_at.take(n), axis=1)
    exact = axis_distance(*_axes(segment_rows), *_axes(link_rows)) - segment_rows[6] - link_rows[6]
    who = p.take(n), s, c.take(n)
    if not capsules_alone:
        known = np.flatnonzero(who[0] < len(toward.extra))
        at = who[0][known], step.take(row).take(n)[known], s[known]
        exact[known] = [
            _gap(bodies, (p_, k_, s_), link, least)
            for p_, k_, s_, link, least in zip(
                *at, link_rows[:, known].T, exact[known], strict=True
            )
        ]
    return _nearest(exact, of.take(n), enough_m, who)


def _search_by_loops(bodies: Bodies, robot: Arrays, courses: CourseRows) -> Found:
    (_, _, radius), (each, around), _ = bodies
    robot_a, robot_b, robot_radius = robot
    first_step, first_place, count, enough_m = courses
    persons, segments = radius.shape[0], radius.shape[2]
    places, links = robot_radius.shape
    groups = len(count)
    distance, who = enough_m.copy(), np.zeros((3, groups), np.int64)
    parts, far = np.empty((places, links, 5)), np.empty(segments)
    for q in range(places):
        for c in range(links):
            square = 0.0
            for i in range(3):
                along = robot_b[q, c, i] - robot_a[q, c, i]
                parts[q, c, i] = robot_a[q, c, i] + 0.5 * along
                square += along * along
            parts[q, c, _THICK] = robot_radius[q, c]
            parts[q, c, _SIZE] = robot_radius[q, c] + 0.5 * sqrt(square)
            for i in range(3):
                if not isfinite(parts[q, c, i]):
                    parts[q, c, _SIZE] = inf
    for g in range(groups):
        best, best_step = enough_m[g], -1
        # Backwards: zones grow, so the last step is most often the nearest, and rules out most of
        # the others. So does the pair of the course before, if it is as near here. Of equal
        # distances, the first step counts, and the first pair in it.
        p, s, c, last = who[0, g - 1], who[1, g - 1], who[2, g - 1], count[g] - 1
        k, q = first_step[g] + last, first_place[g] + last
        bound = _apart_exactly(bodies, (p, k, s), robot, (q, c))
        bound = min(best, bound) if isfinite(bound) else best
        for back in range(count[g]):
            within = count[g] - 1 - back
            k, q = first_step[g] + within, first_place[g] + within
            for c in range(links):
                x, y, z = parts[q, c, 0], parts[q, c, 1], parts[q, c, 2]
                size = parts[q, c, _SIZE] + ROUNDING_M
                for p in range(persons):
                    off_x, off_y = x - around[0, p, k], y - around[1, p, k]
                    off_z = z - around[2, p, k]
                    square = off_x * off_x + off_y * off_y + off_z * off_z
                    reach = bound + size + around[_SIZE, p, k]
                    reach = 0.0 if reach < 0.0 else reach
                    if square > reach * reach:
                        continue
                    for s in range(segments):  # without a branch: several at once
                        off_x, off_y = x - each[0, p, k, s], y - each[1, p, k, s]
                        off_z = z - each[2, p, k, s]
                        square = off_x * off_x + off_y * off_y + off_z * off_z
                        reach = bound + size + each[_SIZE, p, k, s]
                        reach = 0.0 if reach < 0.0 else reach
                        far[s] = square - reach * reach
                    for s in range(segments):
                        if far[s] > 0.0:  # not if NaN
                            continue
                        exact = _apart_exactly(bodies, (p, k, s), robot, (q, c))
                        if not isfinite(exact):
                            exact = -inf
                        if exact < best or (exact == best and k != best_step):
                            best, best_step, bound = exact, k, min(exact, bound)
                            who[0, g], who[1, g], who[2, g] = p, s, c
        distance[g] = best
    return distance, who[0], who[1], who[2]


@part
def _apart_exactly(
    bodies: Bodies, body: tuple[int, int, int], robot: Arrays, part: tuple[int, int]
) -> float:
    """The distance of a segment at (person, step, segment) and a link at (place, link)."""
    p, k, s = body
    q, c = part
    (a, b, radius), _, toward = bodies
    robot_a, robot_b, robot_radius = robot
    x, y, z = _axis_gap(a[p, k, s], b[p, k, s], robot_a[q, c], robot_b[q, c])
    size = sqrt(x * x + y * y + z * z)
    exact = size - radius[p, k, s] - robot_radius[q, c]
    if p >= len(toward.extra) or not size > LEAST_GAP_M or not isfinite(size):
        return exact
    x, y, z = -x / size, -y / size, -z / size
    near = robot_a[q, c, 0] * x + robot_a[q, c, 1] * y + robot_a[q, c, 2] * z
    end = robot_b[q, c, 0] * x + robot_b[q, c, 1] * y + robot_b[q, c, 2] * z
    far = extent(toward, body, (x, y, z))
    gap = min(near, end) - robot_radius[q, c] - far
    return max(exact, gap) if isfinite(gap) else exact


@part
def _axis_gap(a1: Floats, b1: Floats, a2: Floats, b2: Floats) -> tuple[float, float, float]:
    """The vector between the nearest points, as ``geometry.axis_distance`` finds them."""
    ux, uy, uz = b1[0] - a1[0], b1[1] - a1[1], b1[2] - a1[2]
    vx, vy, vz = b2[0] - a2[0], b2[1] - a2[1], b2[2] - a2[2]
    rx, ry, rz = a1[0] - a2[0], a1[1] - a2[1], a1[2] - a2[2]
    square_1, square_2 = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
    inverse_1 = 1.0 / square_1 if square_1 > _POINT_M2 else 0.0
    inverse_2 = 1.0 / square_2 if square_2 > _POINT_M2 else 0.0
    along = ux * vx + uy * vy + uz * vz
    c = ux * rx + uy * ry + uz * rz
    f = vx * rx + vy * ry + vz * rz
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    square = nx * nx + ny * ny + nz * nz
    wx, wy, wz = vy * rz - vz * ry, vz * rx - vx * rz, vx * ry - vy * rx
    s = (wx * nx + wy * ny + wz * nz) / (square if square > 0.0 else inf)
    s = _unit(s)
    t = _unit((f + s * along) * inverse_2)
    s = _unit((t * along - c) * inverse_1)
    return rx + s * ux - t * vx, ry + s * uy - t * vy, rz + s * uz - t * vz


@part
def _unit(parameter: float) -> float:
    """Clamped to 0..1; NaN stays."""
    if parameter < 0.0:
        return 0.0
    return 1.0 if parameter > 1.0 else parameter


search = kernel(_search_by_loops, _search_by_arrays)


# -- arrays ----------------------------------------------------------------------------------------


def _gap(bodies: Bodies, body: tuple[int, int, int], link: Floats, capsules_m: float) -> float:
    """``_apart_exactly`` of a link in rows (7,); the capsules' distance is known."""
    (a, b, _), _, toward = bodies
    start, end = link[:3], link[:3] + link[3:6]
    x, y, z = _axis_gap(a[body], b[body], start, end)
    size = sqrt(x * x + y * y + z * z)
    if not size > LEAST_GAP_M or not isfinite(size):
        return capsules_m
    n = -x / size, -y / size, -z / size
    near = min(float(start @ n), float(end @ n))
    gap = near - float(link[6]) - extent(toward, body, n)
    return max(capsules_m, gap) if isfinite(gap) else capsules_m


def _groups(group: Ints) -> tuple[Ints, Ints]:
    """Return the start of each group (ascending, not empty), and the groups' numbers."""
    starts = np.flatnonzero(np.concatenate([[True], group[1:] != group[:-1]]))
    return starts, group[starts]


def _nearest(exact: Floats, group: Ints, enough_m: Floats, who: tuple[Ints, Ints, Ints]) -> Found:
    """The least distance of each group (ascending), and the pair that has it."""
    distance, found = enough_m.astype(np.float64), np.zeros((3, len(enough_m)), np.intp)
    if len(group):
        exact = np.where(np.isfinite(exact), exact, -np.inf)
        starts, some = _groups(group)
        distance[some] = np.minimum(np.minimum.reduceat(exact, starts), distance[some])
        is_least = np.flatnonzero(exact <= distance[group])[::-1]  # backwards: the first one stays
        found[:, group[is_least]] = [index[is_least] for index in who]
    return distance, found[0], found[1], found[2]


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
