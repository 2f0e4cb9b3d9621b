"""Distance between capsules, vectorised and exact in degenerate cases.

The distance between two capsules is the distance between their axes (segments) minus both radii.
Segments: V. Lumelsky, "On fast computation of distance between line segments", Information
Processing Letters 21 (1985) 55-61, in the clamped form of C. Ericson, "Real-Time Collision
Detection" (2005), section 5.1.9. Two changes make it exact where that form is not: the denominator
and numerator of the first parameter come from cross products (``|d1 x d2|^2`` instead of ``a e -
b^2``), so a small angle between the axes costs no digits; and the distance is the length of the
difference vector, not an expansion of its square, so it stays exact near zero.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hri_predict.base.arrays import Bools, Floats

_POINT_M2 = 1e-24
"""A segment shorter than 1e-12 m is treated as the point at its first end."""

_ROUNDING_M = 1e-9
"""Two orders of addition may differ in the last bits; positions are below 1e4 m."""

Xyz = tuple[Floats, Floats, Floats]
"""Vectors, split by coordinate."""


_NEXT, _AFTER = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, slots=True, eq=False)
class Capsules:
    """A batch of capsules: all points within ``radius`` of the segment from ``a`` to ``b``.

    Attributes:
        a, b: (..., 3) ends, metres, room frame; equal ends make a sphere.
        radius: (...,) metres.
    """

    a: Floats
    b: Floats
    radius: Floats

    def __getitem__(self, index: Any) -> "Capsules":
        """Return a subset, by an index into the batch."""
        return Capsules(self.a[index], self.b[index], self.radius[index])


def capsule_distance(a: Capsules, b: Capsules) -> Floats:
    """Signed distance between the surfaces of capsules ``a`` and ``b``, broadcast together.

    Args:
        a, b: capsules whose batch shapes broadcast, metres, one common frame, finite.

    Returns:
        The broadcast batch shape; distance of the axes minus both radii, so that an overlap gives
        minus the depth, and two identical capsules give minus twice their radius. NaN where an
        input is NaN: callers that cannot rule it out must treat it as the smallest distance.
    """
    axes = segment_distance(a.a, a.b, b.a, b.b)
    return axes - a.radius - b.radius


def least_distance(bodies: Capsules, counts: Bools, others: Capsules) -> Floats:
    """Return the smallest distance of any body from any other capsule, metres.

    Args:
        bodies: (..., B) capsules.
        counts: (..., B) those that count.
        others: (..., C) capsules; both batch shapes broadcast.

    Returns:
        (...,) equal to the minimum of ``capsule_distance``, infinite where nothing counts. Most
        pairs are ruled out by the spheres around them, which takes a fraction of the time. A pair
        with NaN is not: see ``capsule_distance``.
    """
    a, b, radius = bodies.a[..., :, None, :], bodies.b[..., :, None, :], bodies.radius[..., :, None]
    a2, b2, radius_2 = (
        others.a[..., None, :, :],
        others.b[..., None, :, :],
        others.radius[..., None, :],
    )
    off = _minus(_split((a + b) / 2), _split((a2 + b2) / 2))
    most = np.sqrt(_dot(off, off)) - radius - radius_2
    most = np.where(counts[..., None], most, np.inf)
    reach = most.min(axis=(-2, -1), initial=np.inf)[..., None, None] + _ROUNDING_M
    near = ~(most - norm(b - a) / 2 - norm(b2 - a2) / 2 > reach) & counts[..., None]
    least = np.full(near.shape, np.inf)
    least[near] = capsule_distance(_chosen(near, a, b, radius), _chosen(near, a2, b2, radius_2))
    smallest: Floats = least.min(axis=(-2, -1), initial=np.inf)
    return smallest


def _chosen(chosen: Bools, a: Floats, b: Floats, radius: Floats) -> Capsules:
    """Return the chosen pairs' capsules (M,), of arrays that broadcast to ``chosen``."""
    a, b = (np.broadcast_to(ends, (*chosen.shape, 3))[chosen] for ends in (a, b))
    return Capsules(a, b, np.broadcast_to(radius, chosen.shape)[chosen])


def segment_distance(a1: Floats, b1: Floats, a2: Floats, b2: Floats) -> Floats:
    """Distance between segments ``a1 b1`` and ``a2 b2``, each (..., 3), broadcast together."""
    return axis_distance(_split(a1), _split(b1 - a1), _split(a2), _split(b2 - a2))


def axis_distance(start_1: Xyz, d1: Xyz, start_2: Xyz, d2: Xyz) -> Floats:
    """Like ``segment_distance``, for segments given by start and direction vector, split by
    coordinate.
    """
    r = _minus(start_1, start_2)
    # Inverse squared lengths, 0 for points: a point's parameter then stays 0 all the way through.
    inverse_1, inverse_2 = _inverse(_dot(d1, d1)), _inverse(_dot(d2, d2))
    b, c, f = _dot(d1, d2), _dot(d1, r), _dot(d2, r)

    # Where the infinite lines are nearest. Parallel lines (normal 0) have no such place: any start
    # serves, because the two projections below find the distance from wherever they begin.
    normal = _cross(d1, d2)
    square = _dot(normal, normal)
    s = np.asarray(_dot(_cross(d2, r), normal)) / np.where(square > 0.0, square, np.inf)
    s = _unit(s)
    # Project onto the second segment and back onto the first: each is the exact minimum over one
    # parameter with the other fixed, and together they reach the minimum over both (Ericson).
    t = _unit((f + s * b) * inverse_2)
    s = _unit((t * b - c) * inverse_1)

    gap = (
        r[0] + s * d1[0] - t * d2[0],
        r[1] + s * d1[1] - t * d2[1],
        r[2] + s * d1[2] - t * d2[2],
    )
    distance: Floats = np.sqrt(_dot(gap, gap))
    return distance


def nearest_points(first: Capsules, second: Capsules) -> tuple[Floats, Floats]:
    """Return the nearest points (3,) on the surfaces of two single capsules.

    Their distance is that of the capsules; for overlapping capsules, the depth of the overlap. If
    the axes touch, both are the common point.
    """
    a1, a2 = first.a, second.a
    d1, d2, r = first.b - a1, second.b - a2, a1 - a2
    a, e, b, c, f = d1 @ d1, d2 @ d2, d1 @ d2, d1 @ r, d2 @ r
    square = a * e - b * b
    s = _share(float((b * f - c * e) / square)) if square > 1e-12 * a * e else 0.0
    t = _share(float((b * s + f) / e)) if e > 0 else 0.0
    s = _share(float((b * t - c) / a)) if a > 0 else 0.0
    on_1, on_2 = a1 + s * d1, a2 + t * d2
    gap = on_2 - on_1
    length = float(np.sqrt(gap @ gap))
    if length < 1e-9:
        return on_1, on_2
    return on_1 + gap * (first.radius / length), on_2 - gap * (second.radius / length)


def _share(value: float) -> float:
    return min(max(value, 0.0), 1.0)


def horizontal_distance(capsules: Capsules, point: Floats) -> Floats:
    """Distance (...,) of each capsule's surface from the vertical line through ``point`` (3,).

    Negative if the line passes through it; minus infinity for a capsule that is not finite.
    """
    flat = np.array([1.0, 1.0, 0.0])
    at = point * flat
    distance = segment_distance(capsules.a * flat, capsules.b * flat, at, at) - capsules.radius
    return np.where(np.isfinite(distance), distance, -np.inf)


# Three arrays, one per coordinate, instead of a last axis of 3: numpy's loops then run over long
# contiguous memory, which makes the whole about five times as fast as with einsum.


def _split(points: Floats) -> Xyz:
    # not numpy.moveaxis, which takes longer than the copy
    x, y, z = points.transpose(points.ndim - 1, *range(points.ndim - 1)).copy()
    return x, y, z


def _minus(u: Xyz, v: Xyz) -> Xyz:
    return u[0] - v[0], u[1] - v[1], u[2] - v[2]


def _dot(u: Xyz, v: Xyz) -> Floats:
    result: Floats = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
    return result


def _cross(u: Xyz, v: Xyz) -> Xyz:
    return (
        u[1] * v[2] - u[2] * v[1],
        u[2] * v[0] - u[0] * v[2],
        u[0] * v[1] - u[1] * v[0],
    )


def _unit(parameter: Floats) -> Floats:
    """Clamp to 0..1; on small arrays faster than ``numpy.clip``."""
    return np.minimum(np.maximum(parameter, 0.0), 1.0)


def _inverse(square: Floats) -> Floats:
    return np.where(square > _POINT_M2, 1.0 / np.maximum(square, _POINT_M2), 0.0)


def rotation_of(quaternion: Sequence[float] | Floats) -> Floats:
    """(3, 3) rotation of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def transform(matrix: Floats, points: Floats) -> Floats:
    """Apply a (4, 4) transform to points (..., 3)."""
    result: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return result


def cross(u: Floats, v: Floats) -> Floats:
    """Cross product over the last axis; on small arrays much faster than ``numpy.cross``."""
    u_next, u_after = u.take(_NEXT, axis=-1), u.take(_AFTER, axis=-1)
    result: Floats = u_next * v.take(_AFTER, axis=-1)
    result -= u_after * v.take(_NEXT, axis=-1)
    return result


def norm(vectors: Floats) -> Floats:
    """Length over the last axis of 3; on small arrays much faster than ``numpy.linalg.norm``."""
    x, y, z = vectors[..., 0], vectors[..., 1], vectors[..., 2]
    length: Floats = np.sqrt(x * x + y * y + z * z)
    return length


def in_polygon(points: Floats, corners: Floats) -> Bools:
    """Whether each of (..., 2) points lies inside the polygon with (N, 2) corners: even-odd rule.

    It counts the edges crossed by a ray. A point on an edge may be inside or outside.
    """
    x, y = points[..., 0, None], points[..., 1, None]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    spans = (y0 > y) != (y1 > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        crossing = x0 + (y - y0) * (x1 - x0) / (y1 - y0)
    inside: Bools = (np.count_nonzero(spans & (x < crossing), axis=-1) % 2).astype(bool)
    return inside


def side(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    """Return twice the area of a triangle in the plane; positive if c lies left of a to b."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def crosses_itself(polygon: Sequence[Sequence[float]]) -> bool:
    """Whether two edges cross at a point inside both, so that the polygon's interior is
    ambiguous.
    """

    edges = list(zip(polygon, [*polygon[1:], polygon[0]], strict=True))
    return any(
        side(a, b, c) * side(a, b, d) < 0 and side(c, d, a) * side(c, d, b) < 0
        for (a, b), (c, d) in itertools.combinations(edges, 2)
    )


def is_in_polygon(x: float, y: float, corners: Sequence[Sequence[float]]) -> bool:
    """``in_polygon`` for one point, with plain numbers: much faster for a few corners."""
    inside = False
    for (x0, y0), (x1, y1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) * (x1 - x0) / (y1 - y0):
            inside = not inside
    return inside
