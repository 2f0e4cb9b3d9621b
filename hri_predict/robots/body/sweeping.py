"""Where a robot's capsules are, how fast they move, and what they sweep: as loops and as arrays.

Each version computes the same; the sums' order differs, so they agree to rounding. N joints, C
capsules, M configurations or paths, K places on a path.
"""

from math import cos, inf, sin, sqrt

import numpy as np

from hri_predict.arrays import Bools, Floats, Ints
from hri_predict.geometry import Capsules, cross, norm
from hri_predict.machine.compiled import kernel, part, plain
from hri_predict.robots.body.sweep import Pieces
from hri_predict.robots.kinematics import links_of, twists_of

Geometry = tuple[Floats, Floats, Bools, Floats, Ints, Floats, Floats]
"""(3, 4) base, (N, 3, 16) blocks, (N,) slides and (N, 3, 2) axis and origin of a ``Chain``; (C,)
link, (C, 4, 2) ends and (C,) radius of its capsules."""
Path = tuple[Floats, Floats, Floats, Floats]
"""(M, K, N) places q, bounds of their derivatives' amounts (M, K, N) or (1, 1, N) each, and (M, K)
h of each stretch; see ``sweep``."""


# -- moving ----------------------------------------------------------------------------------------


def _moving_by_arrays(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    """Ends (2, M, C, 3) of all capsules at ``q`` (M, N), and a bound (M,) of their speed, m/s.

    ``qd`` is (M, N). It is exact for the axes: speed is convex along an axis, so an end is the
    fastest point. A point off the axis adds at most |omega| x radius.
    """
    link, radius = geometry[4], geometry[6]
    links = links_of(geometry[0], geometry[1], geometry[2], q)
    ends = ends_of(geometry, links)
    omega, v0 = twists_of(geometry[3], geometry[2], links, qd)
    turn, shift = (np.moveaxis(v.take(link, axis=0), 0, -2) for v in (omega, v0))
    fastest = norm(shift + cross(turn, ends)).max(axis=0)
    speed: Floats = (fastest + norm(turn) * radius).max(axis=-1)
    return ends, speed


def ends_of(geometry: Geometry, links: Floats) -> Floats:
    """(2, ..., C, 3) both ends of every capsule on links (N+1, ..., 3, 4)."""
    link, lead = geometry[4], links.shape[1:-2]
    at = links.take(link, axis=0).reshape(len(link), -1, 4)
    # one product of matrices for each capsule's ends
    ends = np.matmul(at, geometry[5]).reshape(len(link), -1, 3, 2)
    return np.ascontiguousarray(ends.transpose(3, 1, 0, 2)).reshape(2, *lead, len(link), 3)


def _moving_by_loops(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    axes, link, radius = geometry[3], geometry[4], geometry[6]
    slides = geometry[2]
    places, joints = q.shape
    links = np.empty((joints + 1, 3, 4))
    ends, speed = np.empty((2, places, len(link), 3)), np.empty(places)
    turn, shift = np.zeros((joints + 1, 3)), np.zeros((joints + 1, 3))
    for m in range(places):
        _place(geometry, q[m], links, ends[:, m])
        for i in range(joints):
            x, y, z = _turned(links[i], axes[i, :, 0])
            x, y, z = x * qd[m, i], y * qd[m, i], z * qd[m, i]
            turn[i + 1], shift[i + 1] = turn[i], shift[i]
            if slides[i]:
                _add(shift[i + 1], x, y, z)
                continue
            at_x, at_y, at_z = _turned(links[i], axes[i, :, 1])
            at_x, at_y, at_z = at_x + links[i, 0, 3], at_y + links[i, 1, 3], at_z + links[i, 2, 3]
            _add(turn[i + 1], x, y, z)
            _add(shift[i + 1], at_y * z - at_z * y, at_z * x - at_x * z, at_x * y - at_y * x)
        speed[m] = -inf
        for c in range(len(link)):
            w, v = turn[link[c]], shift[link[c]]
            fastest = -inf
            for e in range(2):
                end = ends[e, m, c]
                x = v[0] + (w[1] * end[2] - w[2] * end[1])
                y = v[1] + (w[2] * end[0] - w[0] * end[2])
                z = v[2] + (w[0] * end[1] - w[1] * end[0])
                fastest = _larger(fastest, sqrt(x * x + y * y + z * z))
            around = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) * radius[c]
            speed[m] = _larger(speed[m], fastest + around)
    return ends, speed


# -- swept -----------------------------------------------------------------------------------------


def _swept_by_arrays(
    geometry: Geometry, pieces: tuple[Floats, Floats, Floats], path: Path
) -> tuple[Floats, Floats, Floats]:
    """Capsules (M, K, C) that contain the robot along each stretch of some paths: a, b, radius.

    Args:
        geometry: of the robot.
        pieces: ``arms``, ``behind`` and ``beyond`` of its ``Pieces``.
        path: see ``Path``; the first place of each is where it begins.
    """
    q, dq, ddq, half = path
    ends = ends_of(geometry, links_of(geometry[0], geometry[1], geometry[2], q))
    before = np.concatenate([ends[..., :1, :, :], ends[..., :-1, :, :]], axis=-3)
    a, b = 0.5 * (ends + before)
    none = np.zeros(len(geometry[2]))
    hung = Pieces(pieces[0], geometry[2], pieces[1], none, pieces[2])
    grow = hung.departure(ends, before, q=q, dq=dq, ddq=ddq, half=half)
    return a, b, geometry[6] + grow


def _swept_by_loops(
    geometry: Geometry, pieces: tuple[Floats, Floats, Floats], path: Path
) -> tuple[Floats, Floats, Floats]:
    slides, radius = geometry[2], geometry[6]
    arms, behind = pieces[0], pieces[1]
    q, dq, ddq, half = path
    paths, places, joints = q.shape
    count = len(radius)
    a, b = np.empty((paths, places, count, 3)), np.empty((paths, places, count, 3))
    grown = np.empty((paths, places, count))
    links, ends = np.empty((joints + 1, 3, 4)), np.empty((2, 2, count, 3))
    first, bend = np.empty(count), np.empty(count)
    for m in range(paths):
        of = m if dq.shape[0] > 1 else 0
        now = 0
        for k in range(places):
            before = now
            if k == 0 or (q[m, k] != q[m, k - 1]).any():
                now = 1 - now
                _place(geometry, q[m, k], links, ends[now])
                if k == 0:
                    before = now
            h = half[m, k]
            first[:], bend[:] = 0.0, 0.0
            turning, turned = 0.0, 0.0
            at = k if dq.shape[1] > 1 else 0
            for i in range(joints if h != 0.0 else 0):
                rate, rise = dq[of, at, i], ddq[of, at, i]
                if slides[i]:
                    extent = max(abs(q[m, k, i]), abs(q[m, max(k - 1, 0), i])) + rate * h
                    double = 1.5 * turning * turning + turned
                    for c in range(count):
                        first[c] += (rate + extent * turning) * behind[c, i]
                        bend[c] += (rise + 2 * rate * turning + extent * double) * behind[c, i]
                else:
                    turning += rate
                    turned += rise - rate * rate / 2
                double = 1.5 * turning * turning + turned
                for c in range(count):
                    first[c] += turning * arms[c, i]
                    bend[c] += double * arms[c, i]
            for c in range(count):
                farther = 0.0
                for e in range(2):
                    x = ends[now, e, c, 0] - ends[before, e, c, 0]
                    y = ends[now, e, c, 1] - ends[before, e, c, 1]
                    z = ends[now, e, c, 2] - ends[before, e, c, 2]
                    farther = max(farther, 0.5 * sqrt(x * x + y * y + z * z))
                for j in range(3):
                    a[m, k, c, j] = 0.5 * (ends[now, 0, c, j] + ends[before, 0, c, j])
                    b[m, k, c, j] = 0.5 * (ends[now, 1, c, j] + ends[before, 1, c, j])
                grown[m, k, c] = radius[c] + min(farther + bend[c] * (h * h / 2), first[c] * h)
    return a, b, grown


# -- parts -----------------------------------------------------------------------------------------


@part
def _place(geometry: Geometry, q: Floats, links: Floats, ends: Floats) -> None:
    """Write the poses (N+1, 3, 4) of the links and the ends (2, C, 3) of the capsules at ``q``."""
    blocks, slides, link, points = geometry[1], geometry[2], geometry[4], geometry[5]
    links[0] = geometry[0]
    local = np.empty((3, 4))
    for i in range(len(q)):
        x, y = (q[i], 0.0) if slides[i] else (sin(q[i]), cos(q[i]))
        for row in range(3):
            for column in range(4):
                j = 4 * row + column
                local[row, column] = blocks[i, 0, j] + x * blocks[i, 1, j] + y * blocks[i, 2, j]
        for row in range(3):
            u, v, w = links[i, row, 0], links[i, row, 1], links[i, row, 2]
            for column in range(4):
                links[i + 1, row, column] = (
                    u * local[0, column] + v * local[1, column] + w * local[2, column]
                )
            links[i + 1, row, 3] += links[i, row, 3]
    for c in range(len(link)):
        pose = links[link[c]]
        for e in range(2):
            for row in range(3):
                ends[e, c, row] = (
                    pose[row, 0] * points[c, 0, e]
                    + pose[row, 1] * points[c, 1, e]
                    + pose[row, 2] * points[c, 2, e]
                    + pose[row, 3]
                )


@part
def _turned(pose: Floats, v: Floats) -> tuple[float, float, float]:
    x = pose[0, 0] * v[0] + pose[0, 1] * v[1] + pose[0, 2] * v[2]
    y = pose[1, 0] * v[0] + pose[1, 1] * v[1] + pose[1, 2] * v[2]
    z = pose[2, 0] * v[0] + pose[2, 1] * v[1] + pose[2, 2] * v[2]
    return x, y, z


@part
def _add(to: Floats, x: float, y: float, z: float) -> None:
    to[0] += x
    to[1] += y
    to[2] += z


@part
def _larger(a: float, b: float) -> float:
    """The larger; NaN if either is."""
    return b if b > a or b != b else a


moving = kernel(_moving_by_loops, _moving_by_arrays)
swept = kernel(_swept_by_loops, _swept_by_arrays)


# -- as capsules -----------------------------------------------------------------------------------


def capsules_of(geometry: Geometry, ends: Floats) -> Capsules:
    """(..., C) capsules with these ends (2, ..., C, 3)."""
    return Capsules(ends[0], ends[1], np.full(ends.shape[1:-1], geometry[6]))


def moving_capsules(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Capsules, Floats]:
    """(..., C) capsules at ``q`` (..., N), and a bound (...) of their speed at ``qd``."""
    lead, dof = q.shape[:-1], q.shape[-1]
    if qd.shape != q.shape:
        qd = np.broadcast_to(qd, q.shape)
    ends, speed = moving(geometry, plain(q.reshape(-1, dof)), plain(qd.reshape(-1, dof)))
    return capsules_of(geometry, ends.reshape(2, *lead, *ends.shape[2:])), speed.reshape(lead)


def swept_capsules(
    geometry: Geometry, pieces: Pieces, q: Floats, bounds: tuple[Floats, Floats, Floats]
) -> Capsules:
    """(..., K, C) capsules that hold the robot along each stretch of paths ``q`` (..., K, N).

    ``bounds`` are those of both derivatives' amounts, (..., K, N) or (N,), and (..., K) h.
    """
    (dq, ddq, half), lead = bounds, q.shape[:-1]
    if half.shape != lead:
        half = np.broadcast_to(half, lead)
    whole = plain(q.reshape(-1, *q.shape[-2:]))
    path = whole, _bounds(dq, whole), _bounds(ddq, whole), plain(half.reshape(whole.shape[:2]))
    a, b, radius = swept(geometry, (pieces.arms, pieces.behind, pieces.beyond), path)
    shape = *lead, radius.shape[-1]
    return Capsules(a.reshape(*shape, 3), b.reshape(*shape, 3), radius.reshape(shape))


def _bounds(of: Floats, path: Floats) -> Floats:
    """(M, K, N) or (1, 1, N)."""
    return plain(of.reshape(path.shape) if of.ndim > 1 else of.reshape(1, 1, -1))
