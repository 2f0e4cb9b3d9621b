"""Space that boxes hide from cameras, as polygons on the floor: ``source.shadows``."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hri_predict.base.arrays import Floats

_FAR_M = 100.0


def shadows_of(
    boxes: Sequence[Sequence[float]], cameras: Sequence[Sequence[float]], room_m: float
) -> list[dict[str, Any]]:
    """Prisms in which something is hidden from every camera.

    Args:
        boxes: x and y of two opposite corners, and the height.
        cameras: places.
        room_m: from the origin to each wall.
    """
    room = [[-room_m, -room_m], [room_m, -room_m], [room_m, room_m], [-room_m, room_m]]
    hidden: list[Floats] = [np.array(room)]
    for camera in cameras:
        shadows = [_shadow(np.asarray(box), np.asarray(camera)) for box in boxes]
        hidden = [part for h in hidden for s in shadows if len(part := _clipped(h, s)) >= 3]
    return [{"polygon": part.tolist(), "z_max": 2.0} for part in hidden if _area(part) > 1e-4]


def _shadow(box: Floats, camera: Floats) -> Floats:
    """(N, 2) the floor behind a box, seen from a camera, with the box: a convex polygon."""
    corners = box[[[0, 1], [2, 1], [2, 3], [0, 3]]]
    way = corners - camera[:2]
    # a ray over the box's edge meets the floor so much farther away; never, if the box is higher
    over = camera[2] - box[4]
    stretch = camera[2] / over if over > 0.05 else _FAR_M
    return _hull(np.concatenate([corners, camera[:2] + way * min(stretch, _FAR_M)]))


def _hull(points: Floats) -> Floats:
    """Convex hull, counterclockwise (Andrew's monotone chain)."""
    order = sorted(map(tuple, points.tolist()))
    chains = []
    for chosen in (order, order[::-1]):
        chain: list[tuple[float, ...]] = []
        for point in chosen:
            while len(chain) >= 2 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        chains.append(chain[:-1])
    return np.array(chains[0] + chains[1])


def _turn(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _clipped(subject: Floats, convex: Floats) -> Floats:
    """The part of a polygon inside a convex, counterclockwise one (Sutherland, Hodgman 1974)."""
    points = [tuple(p) for p in subject.tolist()]
    for a, b in zip(convex.tolist(), np.roll(convex, -1, axis=0).tolist(), strict=True):
        inside = [_turn(a, b, p) >= 0 for p in points]
        kept = []
        for i, point in enumerate(points):
            before, was_inside = points[i - 1], inside[i - 1]
            if inside[i] != was_inside:
                kept.append(_crossing(a, b, before, point))
            if inside[i]:
                kept.append(point)
        points = kept
    return np.array(points).reshape(-1, 2)


def _crossing(
    a: Sequence[float], b: Sequence[float], p: Sequence[float], q: Sequence[float]
) -> tuple[float, float]:
    """Return the point where the line a b crosses the segment p q."""
    from_p, from_q = _turn(a, b, p), _turn(a, b, q)
    part = from_p / (from_p - from_q)
    return p[0] + part * (q[0] - p[0]), p[1] + part * (q[1] - p[1])


def _area(polygon: Floats) -> float:
    x, y = polygon.T
    return 0.5 * abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)))
