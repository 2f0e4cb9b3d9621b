"""The nearest points of two capsules, for the line that is drawn between them."""

import numpy as np

from hri_predict.arrays import Floats


def nearest_points(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    """The points of two capsules' surfaces that are nearest to each other; each capsule is (7,).

    Where the axes touch, both are the common point. C. Ericson, "Real-Time Collision Detection"
    (2005), section 5.1.9.
    """
    a1, b1, r1 = first[:3], first[3:6], float(first[6])
    a2, b2, r2 = second[:3], second[3:6], float(second[6])
    d1, d2, r = b1 - a1, b2 - a2, a1 - a2
    a, e, b, c, f = d1 @ d1, d2 @ d2, d1 @ d2, d1 @ r, d2 @ r
    square = a * e - b * b
    s = _unit(float((b * f - c * e) / square)) if square > 1e-12 * a * e else 0.0
    t = _unit(float((b * s + f) / e)) if e > 0 else 0.0
    s = _unit(float((b * t - c) / a)) if a > 0 else 0.0
    on_1, on_2 = a1 + s * d1, a2 + t * d2
    gap = on_2 - on_1
    length = float(np.sqrt(gap @ gap))
    if length < 1e-9:
        return on_1, on_2
    return on_1 + gap * (r1 / length), on_2 - gap * (r2 / length)


def _unit(value: float) -> float:
    return min(max(float(value), 0.0), 1.0)
