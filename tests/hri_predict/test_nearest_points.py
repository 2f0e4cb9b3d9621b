import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as drawn

from hri_predict.base.geometry import Capsules, nearest_points, segment_distance

POINTS = drawn.arrays(np.float64, (4, 3), elements=st.floats(-5, 5).map(lambda x: round(x, 3)))


def capsule(*row: float) -> Capsules:
    return Capsules(np.array(row[:3]), np.array(row[3:6]), np.array(row[6]))


@given(POINTS)
def test_the_points_are_as_far_apart_as_the_capsules(points):
    a1, b1, a2, b2 = points
    first, second = capsule(*a1, *b1, 0.0), capsule(*a2, *b2, 0.0)
    one, other = nearest_points(first, second)
    # the denominator of nearly parallel axes loses half the digits: 1e-8 of 10 m, times ten
    np.testing.assert_allclose(
        np.linalg.norm(one - other), segment_distance(a1, b1, a2, b2), atol=1e-5
    )


def test_the_line_begins_and_ends_on_the_surfaces():
    first = capsule(0, 0, 0, 0, 0, 1, 0.1)
    second = capsule(1, 0, 0.5, 2, 0, 0.5, 0.2)
    one, other = nearest_points(first, second)
    np.testing.assert_allclose(one, [0.1, 0, 0.5], atol=1e-12)
    np.testing.assert_allclose(other, [0.8, 0, 0.5], atol=1e-12)


def test_capsules_whose_axes_cross_give_one_point():
    first = capsule(-1, 0, 0, 1, 0, 0, 0.1)
    second = capsule(0, -1, 0, 0, 1, 0, 0.1)
    one, other = nearest_points(first, second)
    np.testing.assert_allclose(one, other, atol=1e-12)
