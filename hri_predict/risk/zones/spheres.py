"""The smallest sphere around the intersection of two spheres: one bound on a point cuts another."""

import numpy as np

from hri_predict.arrays import Floats


def cut(
    centre: Floats, radius: Floats, other_centre: Floats, other_radius: Floats
) -> tuple[Floats, Floats]:
    """The smallest sphere that holds all points inside both spheres.

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
    """The sphere of ``cut``: its place, as a part of the way to the other centre, and its radius.

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
