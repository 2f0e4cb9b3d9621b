"""Fit a small capsule around a body; it always contains the whole body.

The search minimises the volume over the six coordinates of the capsule's two ends. The radius is
not searched; it follows from the farthest point, so every candidate contains the whole body. The
search is an elitist evolution strategy, (1 + 32) in the words of H.-G. Beyer, H.-P. Schwefel,
"Evolution strategies", Natural Computing 1 (2002) 3-52, whose step grows while it gains and shrinks
when it does not: gradients mislead, because the volume has kinks wherever the farthest point
changes. It starts from capsules along the body's three principal axes and from a sphere, and is
seeded: the same body gives the same capsule.
"""

from dataclasses import dataclass

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import segment_distance

GENERATIONS = 150
CANDIDATES = 32
DIRECTIONS = 400  # whose outermost points steer the search


@dataclass(frozen=True, slots=True, eq=False)
class FittedCapsule:
    """Two ends (3,) and a radius, metres, in the frame of the points."""

    a: Floats
    b: Floats
    radius: float

    @property
    def volume(self) -> float:
        """Cubic metres."""
        return float(_volume(np.asarray(np.linalg.norm(self.b - self.a)), self.radius))


def needed_radius(points: Floats, radii: Floats, a: Floats, b: Floats) -> float:
    """Return the radius with which the capsule ``a b`` contains every sphere, metres.

    Args:
        points: (N, 3) centres.
        radii: (N,) radii of the spheres, 0 for points.
        a, b: (3,) ends.
    """
    return float(np.max(segment_distance(points, points, a, b) + radii))


def fit_capsule(points: Floats, radii: Floats | None = None) -> FittedCapsule:
    """A capsule that contains every sphere, of about the minimum volume and never above that of the
    sphere about the mean of the centres.

    Args:
        points: (N, 3) centres, metres, N >= 1; a mesh's vertices (it lies in their convex hull).
        radii: (N,) radii of the spheres; ``None``: all are points.

    Raises:
        ValueError: no points, or one that is not finite.
    """
    points = np.asarray(points, float)
    radii = np.zeros(len(points)) if radii is None else np.asarray(radii, float)
    if len(points) == 0 or not (np.isfinite(points).all() and np.isfinite(radii).all()):
        raise ValueError("a capsule needs at least one point, and all of them finite")
    mean, axes = points.mean(axis=0), _principal_axes(points)
    local = (points - mean) @ axes
    outermost = _outermost(local, radii)
    rng = np.random.default_rng(0)
    size = float(np.max(np.linalg.norm(local, axis=1) + radii))
    starts = _starts(local, radii)
    found = [
        _search(start, local[outermost], radii[outermost], size=size, rng=rng) for start in starts
    ]
    ends = np.array([*found, np.zeros(6)])  # the last: the sphere about the mean
    best = ends[np.argmin(_volumes(ends, local, radii))]
    a, b = (axes @ end + mean for end in (best[:3], best[3:]))
    return FittedCapsule(a, b, needed_radius(points, radii, a, b))


def _volume(length: Floats, radius: Floats | float) -> Floats:
    volume: Floats = np.pi * radius**2 * (length + 4 / 3 * radius)
    return volume


def _volumes(ends: Floats, points: Floats, radii: Floats) -> Floats:
    """Return volumes (K,) of the capsules with ``ends`` (K, 6) that contain all spheres."""
    a, b = ends[:, None, :3], ends[:, None, 3:]
    radius = np.max(segment_distance(points, points, a, b) + radii, axis=-1)
    return _volume(np.linalg.norm(ends[:, 3:] - ends[:, :3], axis=-1), radius)


def _principal_axes(points: Floats) -> Floats:
    """Return (3, 3) axes as columns, longest last. The skewness fixes each one's sense: a body that
    was turned gets the axes turned likewise, and so the same capsule."""
    centred = points - points.mean(axis=0)
    axes = np.linalg.eigh(centred.T @ centred)[1]
    skewness = ((centred @ axes) ** 3).sum(axis=0)
    turned: Floats = axes * np.where(skewness < 0, -1.0, 1.0)
    return turned


def _outermost(points: Floats, radii: Floats) -> Floats:
    """Return indices of the outermost spheres in even directions (Fibonacci lattice)."""
    i = np.arange(DIRECTIONS) + 0.5
    z, turn = 1 - 2 * i / DIRECTIONS, np.pi * (1 + 5**0.5) * i
    flat = np.sqrt(1 - z * z)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), z])
    # one direction at a time: a mesh may have a million vertices
    return np.unique([np.argmax(points @ direction + radii) for direction in directions])


def _starts(points: Floats, radii: Floats) -> list[Floats]:
    """Return ends (6,) of a sphere and of a capsule along each axis, around the box centre."""
    low, high = (points - radii[:, None]).min(axis=0), (points + radii[:, None]).max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    starts = [np.tile(middle, 2)]
    for axis in range(3):
        reach = np.zeros(3)
        reach[axis] = max(half[axis] - np.delete(half, axis).max(), 0.0)
        starts.append(np.concatenate([middle - reach, middle + reach]))
    return starts


def _search(
    start: Floats, points: Floats, radii: Floats, *, size: float, rng: np.random.Generator
) -> Floats:
    """Return ends (6,) of a capsule with at most the volume of ``start``."""
    best, least, step = start, float(_volumes(start[None], points, radii)[0]), 0.2 * size
    for _ in range(GENERATIONS):
        tries = best + step * rng.standard_normal((CANDIDATES, 6))
        volumes = _volumes(tries, points, radii)
        first = int(np.argmin(volumes))
        gained = float(volumes[first]) < least
        if gained:
            best, least = tries[first], float(volumes[first])
        step *= 1.2 if gained else 0.85
    return best
