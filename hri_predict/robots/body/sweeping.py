"""Positions, speeds and swept space of a robot's capsules, with loops and with arrays.

Both versions give the same results except for rounding, because the order of sums differs. N
joints, C capsules, M configurations or paths, K places on a path.
"""

from math import cos, inf, sin, sqrt

import numpy as np

from hri_predict.base.arrays import Bools, Floats, Ints
from hri_predict.base.geometry import Capsules, cross, norm
from hri_predict.base.machine.compiled import kernel, part, plain
from hri_predict.robots.body.sweep import Pieces
from hri_predict.robots.kinematics import links_of, twists_of

Geometry = tuple[Floats, Floats, Bools, Floats, Ints, Floats, Floats]
"""(3, 4) base, (N, 3, 16) blocks, (N,) slides and (N, 3, 2) axis and origin of a ``Chain``; (C,)
link, (C, 4, 2) ends and (C,) radius of its capsules."""
Path = tuple[Floats, Floats, Floats, Floats]
"""(M, K, N) positions q, bounds of the absolute derivatives (M, K, N) or (1, 1, N) each, and (M, K)
h of each stretch; see ``sweep``."""


# -- moving ----------------------------------------------------------------------------------------


def _moving_by_arrays(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    """Return ends (2, M, C, 3) of all capsules at ``q`` (M, N), and a speed bound (M,), m/s.

    ``qd`` is (M, N). The bound is exact for the axes: speed is convex along an axis, so an end is
    the fastest point. A point off the axis adds at most |omega| x radius.
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
    """Return both ends (2, ..., C, 3) of every capsule on links (N+1, ..., 3, 4)."""
    link, lead = geometry[4], links.shape[1:-2]
    at = links.take(link, axis=0).reshape(len(link), -1, 4)
    # one product of matrices for each capsule's ends
    ends = np.matmul(at, geometry[5]).reshape(len(link), -1, 3, 2)
    return np.ascontiguousarray(ends.transpose(3, 1, 0, 2)).reshape(2, *lead, len(link), 3)


def _moving_by_loops(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    slides, axes, link, radius = geometry[2], geometry[3], geometry[4], geometry[6]
    places, joints = q.shape
    links = np.empty((places, joints + 1, 3, 4))
    ends, speed = _place(geometry, q, links), np.empty(places)
    turn, shift = np.zeros((joints + 1, 3)), np.zeros((joints + 1, 3))
    axis, at = np.empty(3), np.empty(3)
    for m in range(places):
        for i in range(joints):
            for r in range(3):
                axis[r], at[r] = 0.0, links[m, i, r, 3]
                for c in range(3):
                    axis[r] += links[m, i, r, c] * axes[i, c, 0]
                    at[r] += links[m, i, r, c] * axes[i, c, 1]
                axis[r] *= qd[m, i]
            for r in range(3):
                s, t = (r + 1) % 3, (r + 2) % 3
                turn[i + 1, r], shift[i + 1, r] = turn[i, r], shift[i, r]
                if slides[i]:
                    shift[i + 1, r] += axis[r]
                else:
                    turn[i + 1, r] += axis[r]
                    shift[i + 1, r] += at[s] * axis[t] - at[t] * axis[s]
        speed[m] = -inf
        for c in range(len(link)):
            n = link[c]
            fastest, around = -inf, 0.0
            for e in range(2):
                square = 0.0
                for r in range(3):
                    s, t = (r + 1) % 3, (r + 2) % 3
                    turned = turn[n, s] * ends[e, m, c, t] - turn[n, t] * ends[e, m, c, s]
                    square += (shift[n, r] + turned) ** 2
                fastest = _larger(fastest, sqrt(square))
            for r in range(3):
                around += turn[n, r] * turn[n, r]
            speed[m] = _larger(speed[m], fastest + sqrt(around) * radius[c])
    return ends, speed


# -- swept -----------------------------------------------------------------------------------------


def _swept_by_arrays(
    geometry: Geometry, pieces: tuple[Floats, Floats, Floats], path: Path
) -> tuple[Floats, Floats, Floats]:
    """Return capsules (M, K, C) that contain the robot along each stretch of paths: a, b, radius.

    Args:
        geometry: geometry of the robot.
        pieces: ``arms``, ``behind`` and ``beyond`` of its ``Pieces``.
        path: see ``Path``; the first position of each path is its start.
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
    links = np.empty((1, joints + 1, 3, 4))
    ends = _place(geometry, q.reshape(paths * places, joints), links)
    a, b = np.empty((paths, places, count, 3)), np.empty((paths, places, count, 3))
    grown, first, bend = np.empty((paths, places, count)), np.empty(count), np.empty(count)
    for m in range(paths):
        of = m if dq.shape[0] > 1 else 0
        for k in range(places):
            at, h = k if dq.shape[1] > 1 else 0, half[m, k]
            for c in range(count):
                first[c], bend[c] = 0.0, 0.0
            turning, turned = 0.0, 0.0
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
            now = m * places + k
            before = now - 1 if k > 0 else now
            for c in range(count):
                farther = 0.0
                for e in range(2):
                    square = 0.0
                    for r in range(3):
                        off = ends[e, now, c, r] - ends[e, before, c, r]
                        square += off * off
                    farther = max(farther, 0.5 * sqrt(square))
                for r in range(3):
                    a[m, k, c, r] = 0.5 * (ends[0, now, c, r] + ends[0, before, c, r])
                    b[m, k, c, r] = 0.5 * (ends[1, now, c, r] + ends[1, before, c, r])
                grown[m, k, c] = radius[c] + min(farther + bend[c] * (h * h / 2), first[c] * h)
    return a, b, grown


# -- parts -----------------------------------------------------------------------------------------


@part
def _place(geometry: Geometry, q: Floats, links: Floats) -> Floats:
    """Return ends (2, M, C, 3) of the capsules at ``q`` (M, N); unchanged positions are copied.

    ``links`` (M, N+1, 3, 4) receives the poses of the links; (1, N+1, 3, 4): not needed.
    """
    base, blocks, slides, link, points = (
        geometry[0],
        geometry[1],
        geometry[2],
        geometry[4],
        geometry[5],
    )
    places, joints = q.shape
    ends = np.empty((2, places, len(link), 3))
    for m in range(places):
        at = m if len(links) > 1 else 0
        moves = m == 0 or len(links) > 1
        for i in range(joints):
            moves = moves or q[m, i] != q[m - 1, i]
        if not moves:
            for e in range(2):
                for c in range(len(link)):
                    for row in range(3):
                        ends[e, m, c, row] = ends[e, m - 1, c, row]
            continue
        for row in range(3):
            for column in range(4):
                links[at, 0, row, column] = base[row, column]
        for i in range(joints):
            x, y = (q[m, i], 0.0) if slides[i] else (sin(q[m, i]), cos(q[m, i]))
            for j in range(4):
                u = blocks[i, 0, j] + x * blocks[i, 1, j] + y * blocks[i, 2, j]
                v = blocks[i, 0, j + 4] + x * blocks[i, 1, j + 4] + y * blocks[i, 2, j + 4]
                w = blocks[i, 0, j + 8] + x * blocks[i, 1, j + 8] + y * blocks[i, 2, j + 8]
                for row in range(3):
                    links[at, i + 1, row, j] = (
                        links[at, i, row, 0] * u
                        + links[at, i, row, 1] * v
                        + links[at, i, row, 2] * w
                    )
            for row in range(3):
                links[at, i + 1, row, 3] += links[at, i, row, 3]
        for c in range(len(link)):
            n = link[c]
            for e in range(2):
                x, y, z = points[c, 0, e], points[c, 1, e], points[c, 2, e]
                for row in range(3):
                    ends[e, m, c, row] = (
                        links[at, n, row, 0] * x
                        + links[at, n, row, 1] * y
                        + links[at, n, row, 2] * z
                        + links[at, n, row, 3]
                    )
    return ends


@part
def _larger(a: float, b: float) -> float:
    """Return the larger value; NaN if either is NaN."""
    return b if b > a or b != b else a


moving = kernel(_moving_by_loops, _moving_by_arrays)
swept = kernel(_swept_by_loops, _swept_by_arrays)


# -- as capsules -----------------------------------------------------------------------------------


def capsules_of(geometry: Geometry, ends: Floats) -> Capsules:
    """Return capsules (..., C) with these ends (2, ..., C, 3)."""
    return Capsules(ends[0], ends[1], np.full(ends.shape[1:-1], geometry[6]))


def moving_capsules(geometry: Geometry, q: Floats, qd: Floats) -> tuple[Capsules, Floats]:
    """Return capsules (..., C) at ``q`` (..., N), and a bound (...) of their speed at ``qd``."""
    lead, dof = q.shape[:-1], q.shape[-1]
    if qd.shape != q.shape:
        qd = np.broadcast_to(qd, q.shape)
    ends, speed = moving(geometry, plain(q.reshape(-1, dof)), plain(qd.reshape(-1, dof)))
    return capsules_of(geometry, ends.reshape(2, *lead, *ends.shape[2:])), speed.reshape(lead)


def swept_capsules(
    geometry: Geometry, pieces: Pieces, q: Floats, bounds: tuple[Floats, Floats, Floats]
) -> Capsules:
    """Return capsules (..., K, C) around the robot along each stretch of paths ``q`` (..., K, N).

    ``bounds``: bounds of both absolute derivatives, (..., K, N) or (N,), and (..., K) h.
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
