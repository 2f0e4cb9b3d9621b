"""Smallest spheres around the intersection of two spheres, and around the parts of a path."""

import numpy as np

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import norm


def cut(
    centre: Floats, radius: Floats, other_centre: Floats, other_radius: Floats
) -> tuple[Floats, Floats]:
    """Return the smallest sphere that holds all points inside both spheres.

    With d the distance of the centres, the spheres meet in a circle whose plane is at
    x = (d^2 + r1^2 - r2^2) / 2d from the first centre. Where 0 < x < d the circle's disc is the
    widest part of the intersection, so the sphere about its middle with its radius,
    sqrt(r1^2 - x^2), holds all of it; elsewhere the smaller sphere does.

    Two spheres that do not meet contradict each other. Then the *other* one is returned: the caller
    must pass the more reliable one as the other.

    Args:
        centre, radius: (..., 3) and (...) metres, the sphere to cut.
        other_centre, other_radius: likewise; all broadcast together. A radius may be infinite.

    Returns:
        centre (..., 3) and radius (...), never larger than the smaller of the two radii.
    """
    apart = other_centre - centre
    d = np.sqrt(np.einsum("...i,...i->...", apart, apart))
    part, within = along(d, radius, other_radius)
    return centre + part[..., None] * apart, within


def along(d: Floats, radius: Floats, other_radius: Floats) -> tuple[Floats, Floats]:
    """Return the sphere of ``cut``: its centre, as a fraction of the way to the other centre, and
    its radius.

    Args:
        d: (...) distance of the centres, metres.
        radius, other_radius: as for ``cut``.
    """
    both, way = radius + other_radius, np.maximum(d, 1e-12)
    with np.errstate(invalid="ignore", over="ignore"):
        x = 0.5 * (d + (radius - other_radius) * both / way)
        lens = (x > 0) & (x < d) & (d < both)
        disc = np.sqrt(np.maximum((radius - x) * (radius + x), 0.0))
        disc = np.minimum(disc, np.minimum(radius, other_radius))  # rounding aside it is smaller
        part = x / way
    other = (other_radius < radius) | (d >= both)  # where there is no lens
    within = np.where(lens, disc, np.where(other, other_radius, radius))
    return np.where(lens, part, other), within


def enclosed(knots: Floats, steps: Floats) -> tuple[Floats, Floats]:
    """Return spheres around a piecewise linear path.

    Args:
        knots: (P, N, J, 3) the path at steps 0..N-1; it ends at the last.
        steps: (P, K+1) ascending by at most 1 from entry 1 on, so that an interval spans at most
            one knot.

    Returns:
        mid (P, K+1, J, 3) and radius (P, K+1, J): entry k >= 1 holds the path between
        ``steps[k-1]`` and ``steps[k]``; entry 0 is the path at step 0. Interval 1 starts at
        ``steps[1] - 1``, the current step.
    """
    last = knots.shape[1] - 1
    ends = steps[:, 1:]
    bounds = np.concatenate([ends[:, :1] - 1.0, ends], axis=1)
    bounds = np.minimum(np.maximum(bounds, 0.0), last)  # on small arrays faster than numpy.clip
    below = np.minimum(bounds.astype(np.intp), max(last - 1, 0))
    person = np.arange(len(knots))[:, None]
    part = (bounds - below)[..., None, None]
    lower, upper = knots[person, below], knots[person, np.minimum(below + 1, last)]
    at = lower + part * (upper - lower)  # (P, K+1, J, 3) at the bounds
    start, end = at[:, :-1], at[:, 1:]
    corner = upper[:, :-1]
    inside = (below[:, :-1] + 1 < bounds[:, 1:])[..., None]
    mid = 0.5 * (start + end)
    half = 0.5 * norm(end - start)
    radius = np.maximum(half, np.where(inside, norm(corner - mid), 0.0))
    return (
        np.concatenate([knots[:, :1], mid], axis=1),
        np.concatenate([np.zeros_like(radius[:, :1]), radius], axis=1),
    )
