"""The sphere about the intersection of two spheres: it holds it, and none holds it tighter."""

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_predict.zones.sphere_geometry import cut

COORDINATE = st.floats(-5, 5)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE).map(np.array)
RADIUS = st.floats(0, 6)


def one(centre, radius, other_centre, other_radius):
    return cut(
        np.asarray(centre, float),
        np.asarray(radius, float),
        np.asarray(other_centre, float),
        np.asarray(other_radius, float),
    )


def points_in(rng, centre, radius, count=400):
    """Points of a sphere, a third of them of its skin."""
    away = rng.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    far = np.where(np.arange(count) % 3 == 0, 1.0, rng.random(count) ** (1 / 3))
    return centre + radius * far[:, None] * away


@given(POINT, RADIUS, POINT, RADIUS, st.integers(0, 2**32 - 1))
def test_whatever_lies_in_both_lies_in_the_result(a, ra, b, rb, seed):
    middle, radius = one(a, ra, b, rb)
    rng = np.random.default_rng(seed)
    points = np.concatenate([points_in(rng, a, ra), points_in(rng, b, rb)])
    in_both = (np.linalg.norm(points - a, axis=1) <= ra) & (
        np.linalg.norm(points - b, axis=1) <= rb
    )
    assert (np.linalg.norm(points[in_both] - middle, axis=1) <= radius + 1e-6).all()


@given(POINT, RADIUS, POINT, RADIUS)
@example(np.zeros(3), 1.5, np.array([0.0, 0.0, 1.5]), 2.0**-14)  # rounding was larger
def test_never_larger_than_the_smaller_unless_they_contradict_each_other(a, ra, b, rb):
    _, radius = one(a, ra, b, rb)
    if np.linalg.norm(a - b) < ra + rb:
        assert radius <= min(ra, rb) * (1 + 1e-12)
    else:
        assert radius == rb


@given(POINT, RADIUS, POINT, RADIUS)
def test_spheres_that_meet_may_be_given_in_either_order(a, ra, b, rb):
    apart = np.linalg.norm(a - b)
    if apart >= ra + rb - 1e-6 or (apart < 1e-6 and abs(ra - rb) < 1e-6):
        return  # they contradict each other, or are one
    middle, radius = one(a, ra, b, rb)
    other_middle, other_radius = one(b, rb, a, ra)
    # a thin lens magnifies rounding: its radius is a root, so half the digits are left
    assert radius == pytest.approx(other_radius, abs=1e-6)
    assert middle == pytest.approx(other_middle, abs=1e-6)


@given(POINT, RADIUS, POINT, RADIUS, POINT, st.integers(0, 2**32 - 1))
def test_moves_with_the_room(a, ra, b, rb, shift, seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    touching = abs(np.linalg.norm(a - b) - (ra + rb)) < 1e-6
    if touching or np.linalg.norm(a - b) < 1e-6:
        return  # rounding decides which of two cases it is
    middle, radius = one(a, ra, b, rb)
    moved, moved_radius = one(turn @ a + shift, ra, turn @ b + shift, rb)
    assert moved_radius == pytest.approx(radius, abs=1e-6)
    assert moved == pytest.approx(turn @ middle + shift, abs=1e-6)


def test_a_lens_worked_by_hand():
    # d = 6, r1 = 5, r2 = sqrt(13): x = (36 + 25 - 13) / 12 = 4 from the first centre, between the
    # two; the rim has the radius sqrt(25 - 16) = 3, and 3 = sqrt(13 - 2^2) from the other side
    middle, radius = one((1, 2, 3), 5, (7, 2, 3), np.sqrt(13))
    assert middle == pytest.approx([5, 2, 3])
    assert radius == pytest.approx(3)


def test_past_the_other_centre_the_smaller_sphere_holds_more_than_the_rim():
    # d = 1, r1 = 5, r2 = 4.5: x = (1 + 25 - 20.25) / 2 = 2.875 > d: more than half of the second
    middle, radius = one((0, 0, 0), 5, (1, 0, 0), 4.5)
    assert middle.tolist() == [1, 0, 0]
    assert radius == 4.5
    # and the other way round x = (1 + 20.25 - 25) / 2 < 0
    middle, radius = one((1, 0, 0), 4.5, (0, 0, 0), 5)
    assert middle.tolist() == [1, 0, 0]
    assert radius == 4.5


@pytest.mark.parametrize("at", [0, 1])
def test_a_sphere_in_the_other_is_the_result(at):
    small, large = ((0.1, 0, 0), 1.0), ((0, 0, 0), 3.0)
    first, second = (small, large) if at else (large, small)
    middle, radius = one(*first, *second)
    assert middle == pytest.approx([0.1, 0, 0])
    assert radius == 1.0


@pytest.mark.parametrize(("ra", "rb"), [(1.0, 1.0), (0.2, 2.0), (1.0, 3.0), (0.0, 0.0)])
def test_spheres_that_contradict_each_other_give_the_other(ra, rb):
    middle, radius = one((0, 0, 0), ra, (4, 0, 0), rb)  # the third pair touches
    assert middle == pytest.approx([4, 0, 0])
    assert radius == rb


def test_infinite_radii_bound_nothing():
    for ra, rb, at, wanted in (
        (np.inf, 2, 3.0, 2),
        (2, np.inf, 0.0, 2),
        (np.inf, np.inf, 0, np.inf),
    ):
        middle, radius = one((0, 0, 0), ra, (3, 0, 0), rb)
        assert radius == wanted
        assert middle == pytest.approx([at, 0, 0])


def test_one_place_and_one_point():
    assert one((1, 1, 1), 2, (1, 1, 1), 0.5)[1] == 0.5
    assert one((1, 1, 1), 0.5, (1, 1, 1), 2)[1] == 0.5
    middle, radius = one((0, 0, 0), 1, (0.5, 0, 0), 0)
    assert (middle.tolist(), radius) == ([0.5, 0, 0], 0)


@given(st.floats(0.5, 3), st.floats(0.5, 3), st.floats(0.05, 0.95))
def test_no_sphere_holds_a_lens_tighter(ra, rb, share):
    # Only where the rim lies between the centres: |ra^2 - rb^2| < d^2, and d < ra + rb.
    least = np.sqrt(abs(ra**2 - rb**2))
    d = least + share * (ra + rb - least)
    _, radius = one((0, 0, 0), ra, (0, 0, d), rb)
    x = (d**2 + ra**2 - rb**2) / (2 * d)
    angle = np.linspace(0, 2 * np.pi, 64, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros(64)], 1) * np.sqrt(ra**2 - x**2)
    rim[:, 2] = x
    assert np.linalg.norm(rim, axis=1) == pytest.approx(np.full(64, ra))  # of both spheres
    assert np.linalg.norm(rim - (0, 0, d), axis=1) == pytest.approx(np.full(64, rb))
    # opposite points of the rim are in both spheres: a smaller sphere cannot hold them
    widest = np.linalg.norm(rim[:32] - rim[32:], axis=1).max()
    assert radius == pytest.approx(widest / 2)


def test_many_at_once_are_as_one_by_one():
    rng = np.random.default_rng(3)
    a, b = rng.normal(size=(5, 4, 3)), rng.normal(size=(5, 1, 3))
    ra, rb = rng.random((5, 4)) * 2, rng.random((5, 1)) * 2
    middle, radius = cut(a, ra, b, rb)
    assert (middle.shape, radius.shape) == ((5, 4, 3), (5, 4))
    for i, j in np.ndindex(5, 4):
        alone = one(a[i, j], ra[i, j], b[i, 0], rb[i, 0])
        assert np.array_equal(alone[0], middle[i, j])
        assert alone[1] == radius[i, j]
