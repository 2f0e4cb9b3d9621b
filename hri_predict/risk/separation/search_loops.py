"""The search for the nearest pair, with loops; see ``search`` for details and the array version."""

from math import inf, isfinite, sqrt

import numpy as np

from hri_predict.base.arrays import Floats, Ints
from hri_predict.base.machine.compiled import part
from hri_predict.zones.loops.spheres import UNSEEN
from hri_predict.zones.toward import BINS, COSINES, STEEP, Toward

ROUNDING_M = 1e-9
"""Tolerance when excluding pairs, because two orders of addition may differ in the last bit."""
LEAST_GAP_M = 1e-6
"""Minimum distance of two axes that defines a direction between them."""
_POINT_M2 = 1e-24  # as in ``geometry``

THICK, SIZE = 3, 4
"""Rows of sphere arrays: the capsule's radius, and the radius of its bounding sphere."""

Arrays = tuple[Floats, Floats, Floats]
"""Ends a and b, and radius, of capsules."""
Spheres = tuple[Floats, Floats]
"""See ``spheres_of``."""
Bodies = tuple[Arrays, Spheres, Toward]
"""(P, K, S) capsules, their spheres, and the support of the first people (``NOTHING``: capsules
only)."""
CourseRows = tuple[Ints, Ints, Ints, Floats]
"""(G,) each: first step of the bodies in a course; position of the robot at that step, which
advances by one per step; number of steps, at least one; and upper limit of the distances to
compute."""
Found = tuple[Floats, Ints, Ints, Ints]
"""(G,) each: distance, person, segment and link."""


def search_by_loops(bodies: Bodies, robot: Arrays, courses: CourseRows) -> Found:
    """The minimum distance along each course, and the first pair that has it; see ``search``."""
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
            parts[q, c, THICK] = robot_radius[q, c]
            parts[q, c, SIZE] = robot_radius[q, c] + 0.5 * sqrt(square)
            for i in range(3):
                if not isfinite(parts[q, c, i]):
                    parts[q, c, SIZE] = inf
    for g in range(groups):
        best, best_step = enough_m[g], -1
        # Backwards: zones grow, so the last step is most often the nearest, and rules out most of
        # the others. So does the pair of the course before, if it is as near here. Of equal
        # distances, the first step counts, and the first pair in it.
        p, s, c, last = who[0, g - 1], who[1, g - 1], who[2, g - 1], count[g] - 1
        k, q = first_step[g] + last, first_place[g] + last
        bound = apart_exactly(bodies, (p, k, s), robot, (q, c))
        bound = min(best, bound) if isfinite(bound) else best
        for back in range(count[g]):
            within = count[g] - 1 - back
            k, q = first_step[g] + within, first_place[g] + within
            for c in range(links):
                x, y, z = parts[q, c, 0], parts[q, c, 1], parts[q, c, 2]
                size = parts[q, c, SIZE] + ROUNDING_M
                for p in range(persons):
                    off_x, off_y = x - around[0, p, k], y - around[1, p, k]
                    off_z = z - around[2, p, k]
                    square = off_x * off_x + off_y * off_y + off_z * off_z
                    reach = bound + size + around[SIZE, p, k]
                    reach = 0.0 if reach < 0.0 else reach
                    if square > reach * reach:
                        continue
                    for s in range(segments):  # without a branch: several at once
                        off_x, off_y = x - each[0, p, k, s], y - each[1, p, k, s]
                        off_z = z - each[2, p, k, s]
                        square = off_x * off_x + off_y * off_y + off_z * off_z
                        reach = bound + size + each[SIZE, p, k, s]
                        reach = 0.0 if reach < 0.0 else reach
                        far[s] = square - reach * reach
                    for s in range(segments):
                        if far[s] > 0.0:  # not if NaN
                            continue
                        exact = apart_exactly(bodies, (p, k, s), robot, (q, c))
                        if not isfinite(exact):
                            exact = -inf
                        if exact < best or (exact == best and k != best_step):
                            best, best_step, bound = exact, k, min(exact, bound)
                            who[0, g], who[1, g], who[2, g] = p, s, c
        distance[g] = best
    return distance, who[0], who[1], who[2]


@part
def apart_exactly(
    bodies: Bodies, body: tuple[int, int, int], robot: Arrays, part: tuple[int, int]
) -> float:
    """Return the distance of a segment at (person, step, segment) to a link at (place, link)."""
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
    """Return the vector between the nearest points, as in ``geometry.axis_distance``."""
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
    """Return the value clamped to 0..1; NaN remains NaN."""
    if parameter < 0.0:
        return 0.0
    return 1.0 if parameter > 1.0 else parameter


@part
def extent(toward: Toward, body: tuple[int, int, int], n: tuple[float, float, float]) -> float:
    """Return the extent of a segment along a unit vector, from the room's origin."""
    p, k, s = body
    x, y, z = n
    most = -inf
    for i in range(2):
        j = toward.ends[p, s, i]
        mid, path, way = toward.mid[p, k, j], toward.path[p, k, j], toward.way[p, k, j]
        ball = mid[0] * x + mid[1] * y + mid[2] * z + toward.radius[p, k, j]
        cosine = way[0] * x + way[1] * y + way[2] * z
        if abs(z) > STEEP:
            which = BINS - 1
        elif not way[0] * way[0] + way[1] * way[1] + way[2] * way[2] > 0.25:
            which = 0
        else:
            which = 1
            for edge in COSINES:
                which += cosine >= edge
        claim, within = toward.claim[p, k, j] * toward.shares[p, k, which], toward.within[p, j]
        if within > 0.0:
            claim = UNSEEN * sqrt(claim * claim + within * within)
        ahead = path[0] * x + path[1] * y + path[2] * z + toward.rest[p, k, j] + claim
        most = max(most, min(ball, ahead))
    return most + toward.extra[p, s]
