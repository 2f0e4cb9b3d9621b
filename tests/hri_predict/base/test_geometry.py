"""Capsule distance against an independent library, brute force and a table of degenerate cases."""

from typing import Any

import coal
import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.base.geometry import (
    Capsules,
    capsule_distance,
    horizontal_distance,
    least_distance,
    segment_distance,
)

TOLERANCE = 1e-9
coordinate = st.floats(-3, 3, allow_nan=False, width=64)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)
radius = st.floats(0.01, 0.3)


# Coarse points meet often: shared ends, parallel, collinear, crossing, equal.
def short_axes() -> tuple[Any, ...]:
    """Two axes of a hundredth of a millimetre that cross: one is a point to coal."""
    a, b, c = (np.array([x, 0.5, z]) for x, z in ((0.0, 0.0), (1e-5, 0.0), (5e-6, -1e-3)))
    return a, b, 0.1, c, c + np.array([0.0, 0.0, 2e-3]), 0.2


coarse = st.tuples(*[st.integers(-2, 2).map(float)] * 3).map(np.array)
any_point = st.one_of(point, coarse)


def capsule(a: Any, b: Any, r: Any = 0.0) -> Capsules:
    return Capsules(np.asarray(a, float), np.asarray(b, float), np.asarray(r, float))


def by_coal(a: Floats, b: Floats, ra: float, c: Floats, d: Floats, rb: float) -> float:
    """Distance by coal's own capsule-capsule routine."""

    def shape(p: Floats, q: Floats, r: float) -> tuple[Any, Any]:
        length = float(np.linalg.norm(q - p))
        z = (q - p) / length if length > 0 else np.array([0.0, 0.0, 1.0])
        helper = np.eye(3)[np.argmin(np.abs(z))]
        x = np.cross(helper, z)
        x /= np.linalg.norm(x)
        rotation = np.column_stack([x, np.cross(z, x), z])
        return coal.Capsule(r, length), coal.Transform3s(rotation, (p + q) / 2)

    first, first_pose = shape(a, b, ra)
    second, second_pose = shape(c, d, rb)
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return float(coal.distance(first, first_pose, second, second_pose, request, result))


def coal_slack_m(a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """How far coal may be off: it takes an axis whose square is below 1e-7 for a point, and is off
    by up to 1.3e-5 m (of 1,500 drawn pairs of each length) where one is below a few centimetres."""
    shortest = float(min(np.linalg.norm(b - a), np.linalg.norm(d - c)))
    return 1e-6 if shortest > 0.1 else 1e-4 if shortest > 5e-4 else 5e-4


def by_sampling(a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """An upper bound of the axes' distance, at most half a step above it."""
    t = np.linspace(0, 1, 201)[:, None]
    p, q = a + t * (b - a), c + t * (d - c)
    return float(np.min(np.linalg.norm(p[:, None] - q[None], axis=-1)))


def by_candidates(a: Floats, b: Floats, c: Floats, d: Floats) -> float:
    """Another algorithm: the four ends onto the other segment, and the lines' common normal."""

    def onto(p: Floats, u: Floats, v: Floats) -> float:
        w = v - u
        length = w @ w
        t = np.clip((p - u) @ w / length, 0, 1) if length > 0 else 0.0
        return float(np.linalg.norm(p - u - t * w))

    best = [onto(a, c, d), onto(b, c, d), onto(c, a, b), onto(d, a, b)]
    system = np.column_stack([b - a, c - d])
    (s, t), *_ = np.linalg.lstsq(system, c - a, rcond=None)
    if 0 <= s <= 1 and 0 <= t <= 1:
        best.append(float(np.linalg.norm(a + s * (b - a) - c - t * (d - c))))
    return min(best)


def test_equals_coal_to_the_last_digits() -> None:
    rng = np.random.default_rng(11)
    for i in range(2000):
        ends = rng.uniform(-3, 3, (4, 3)) if i % 2 else rng.integers(-1, 2, (4, 3)).astype(float)
        a, b, c, d = ends
        ours = float(capsule_distance(capsule(a, b, 0.1), capsule(c, d, 0.2)))
        assert ours == pytest.approx(by_coal(a, b, 0.1, c, d, 0.2), abs=1e-12)


@given(point, point, radius, point, point, radius)
@example(*short_axes())
def test_equals_coal_on_hostile_input(
    a: Floats, b: Floats, ra: float, c: Floats, d: Floats, rb: float
) -> None:
    ours = float(capsule_distance(capsule(a, b, ra), capsule(c, d, rb)))
    assert ours == pytest.approx(by_coal(a, b, ra, c, d, rb), abs=coal_slack_m(a, b, c, d))


@given(any_point, any_point, any_point, any_point)
def test_equals_another_algorithm_also_where_axes_meet_or_degenerate(
    a: Floats, b: Floats, c: Floats, d: Floats
) -> None:
    assert float(segment_distance(a, b, c, d)) == pytest.approx(
        by_candidates(a, b, c, d), abs=TOLERANCE
    )


@given(any_point, any_point, any_point, any_point)
def test_brackets_brute_force(a: Floats, b: Floats, c: Floats, d: Floats) -> None:
    ours = float(segment_distance(a, b, c, d))
    sampled = by_sampling(a, b, c, d)
    step = (np.linalg.norm(b - a) + np.linalg.norm(d - c)) / 200 / 2
    assert sampled - step - TOLERANCE <= ours <= sampled + TOLERANCE


DEGENERATE = {
    "two points": ((0, 0, 0), (0, 0, 0), (0, 3, 4), (0, 3, 4), 5.0),
    "same point": ((1, 2, 3), (1, 2, 3), (1, 2, 3), (1, 2, 3), 0.0),
    "point beside a segment": ((0, 2, 0), (0, 2, 0), (-1, 0, 0), (1, 0, 0), 2.0),
    "point past a segment's end": ((4, 4, 0), (4, 4, 0), (-1, 0, 0), (1, 0, 0), 5.0),
    "point on a segment": ((0.5, 0, 0), (0.5, 0, 0), (-1, 0, 0), (1, 0, 0), 0.0),
    "identical": ((0, 0, 0), (1, 1, 1), (0, 0, 0), (1, 1, 1), 0.0),
    "identical, reversed": ((0, 0, 0), (1, 1, 1), (1, 1, 1), (0, 0, 0), 0.0),
    "parallel, side by side": ((0, 0, 0), (1, 0, 0), (0.2, 0.7, 0), (3, 0.7, 0), 0.7),
    "parallel, opposed": ((0, 0, 0), (1, 0, 0), (3, 0.7, 0), (0.2, 0.7, 0), 0.7),
    "parallel, apart": ((0, 0, 0), (1, 0, 0), (4, 4, 0), (9, 4, 0), 5.0),
    "parallel, apart, before": ((0, 0, 0), (1, 0, 0), (-9, 4, 0), (-3, 4, 0), 5.0),
    "collinear, overlapping": ((0, 0, 0), (2, 0, 0), (1, 0, 0), (3, 0, 0), 0.0),
    "collinear, nested": ((0, 0, 0), (3, 0, 0), (1, 0, 0), (2, 0, 0), 0.0),
    "collinear, touching": ((0, 0, 0), (1, 0, 0), (1, 0, 0), (2, 0, 0), 0.0),
    "collinear, apart": ((0, 0, 0), (1, 0, 0), (3, 0, 0), (2.5, 0, 0), 1.5),
    "crossing": ((-1, 0, 0), (1, 0, 0), (0, -1, 0), (0, 1, 0), 0.0),
    "skew": ((-1, 0, 0), (1, 0, 0), (0, -1, 0.3), (0, 1, 0.3), 0.3),
    "sharing an end": ((0, 0, 0), (1, 0, 0), (0, 0, 0), (0, 1, 0), 0.0),
    "lines cross beyond both": ((1, 0, 0), (2, 0, 0), (0, 1, 0), (0, 2, 0), np.sqrt(2)),
    "end above the other's middle": ((0, 0, 1), (0, 0, 2), (-1, 0, 0), (1, 0, 0), 1.0),
    "very short against long": ((0, 1, 0), (1e-9, 1, 0), (-3, 0, 0), (3, 0, 0), 1.0),
}


@pytest.mark.parametrize("case", DEGENERATE, ids=list(DEGENERATE))
def test_degenerate(case: str) -> None:
    a, b, c, d, expected = DEGENERATE[case]
    first, second = capsule(a, b, 0.1), capsule(c, d, 0.2)
    assert float(capsule_distance(first, second)) == pytest.approx(expected - 0.3, abs=1e-12)
    assert float(capsule_distance(second, first)) == pytest.approx(expected - 0.3, abs=1e-12)


@pytest.mark.parametrize("angle", [1e-3, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-12, 1e-15])
@pytest.mark.parametrize("crossing_at", [0.0, 0.31, 1.0])
def test_nearly_parallel_axes_that_cross(angle: float, crossing_at: float) -> None:
    a, b = np.array([0.0, 0, 0]), np.array([1.0, 0, 0])
    direction = np.array([np.cos(angle), np.sin(angle), 0])
    cross = a + crossing_at * (b - a)
    for c, d in ((cross - 0.4 * direction, cross + 0.6 * direction),):
        assert float(segment_distance(a, b, c, d)) < TOLERANCE
        assert float(segment_distance(c, d, b, a)) < TOLERANCE
        lifted = np.array([0, 0, 0.25])
        assert float(segment_distance(a, b, c + lifted, d + lifted)) == pytest.approx(
            0.25, abs=TOLERANCE
        )


@given(any_point, any_point, any_point, any_point, st.integers(0, 2**32 - 1))
@example(np.zeros(3), np.ones(3), np.zeros(3), np.ones(3), 0)
def test_symmetric_and_invariant_to_rigid_motion(
    a: Floats, b: Floats, c: Floats, d: Floats, seed: int
) -> None:
    ours = float(segment_distance(a, b, c, d))
    for p, q, u, v in ((c, d, a, b), (b, a, c, d), (a, b, d, c)):
        assert float(segment_distance(p, q, u, v)) == pytest.approx(ours, abs=TOLERANCE)
    rng = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    shift = rng.uniform(-2, 2, 3)
    moved = [rotation @ p + shift for p in (a, b, c, d)]
    assert float(segment_distance(*moved)) == pytest.approx(ours, abs=TOLERANCE)


def test_broadcasts_like_numpy() -> None:
    rng = np.random.default_rng(5)
    a = capsule(rng.normal(size=(4, 1, 3)), rng.normal(size=(4, 1, 3)), rng.uniform(0, 1, (4, 1)))
    b = capsule(rng.normal(size=(5, 3)), rng.normal(size=(5, 3)), rng.uniform(0, 1, 5))
    batch = capsule_distance(a, b)
    assert batch.shape == (4, 5)
    for i in range(4):
        for j in range(5):
            one = capsule_distance(
                capsule(a.a[i, 0], a.b[i, 0], a.radius[i, 0]), capsule(b.a[j], b.b[j], b.radius[j])
            )
            assert batch[i, j] == pytest.approx(float(one), abs=1e-14)


@given(st.integers(0, 2**32 - 1), st.booleans(), st.sampled_from([0.05, 1.0, 4.0]))
def test_the_least_distance_is_that_of_the_nearest_pair_that_counts(
    seed: int, degenerate: bool, apart_m: float
) -> None:
    rng = np.random.default_rng(seed)

    def drawn(*shape: int) -> Capsules:
        a = apart_m * rng.normal(size=(*shape, 3))
        b = a if degenerate else a + 0.3 * rng.normal(size=a.shape)
        return Capsules(a, b, rng.uniform(0.0, 0.2, shape))

    bodies, others = drawn(2, 3, 5), drawn(3, 4)
    counts = rng.random((2, 3, 5)) < 0.6
    pairs = capsule_distance(
        Capsules(bodies.a[..., :, None, :], bodies.b[..., :, None, :], bodies.radius[..., None]),
        Capsules(others.a[:, None], others.b[:, None], others.radius[:, None]),
    )
    every = np.where(counts[..., None], pairs, np.inf).min((-2, -1))
    assert np.array_equal(least_distance(bodies, counts, others), every)


def test_the_least_distance_keeps_nan_and_is_infinite_where_nothing_counts() -> None:
    bodies = capsule([[0.0, 0, 0], [np.nan, 0, 0]], [[1.0, 0, 0], [1.0, 0, 0]], [0.1, 0.1])
    post = capsule([[5.0, 0, 0]], [[5.0, 0, 2]], [0.1])
    assert np.isnan(least_distance(bodies, np.array([True, True]), post))
    assert least_distance(bodies, np.array([True, False]), post) == pytest.approx(3.8)
    assert np.isinf(least_distance(bodies, np.array([False, False]), post))
    none = Capsules(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    assert np.isinf(least_distance(none, np.zeros(0, bool), post))


@given(any_point, any_point, radius, any_point)
def test_horizontal_distance_is_that_of_a_tall_post(a, b, r, base):
    # oracle: coal's distance to a post of 1 mm that reaches far above and below everything
    low, high = (np.array([base[0], base[1], z]) for z in (-50.0, 50.0))
    found = float(horizontal_distance(capsule(a, b, r), base))
    coal_m = by_coal(a, b, r, low, high, 0.001)
    assert found - 0.001 == pytest.approx(coal_m, abs=coal_slack_m(a, b, low, high))
    up = np.array([0, 0, 7.0])  # the height of the capsule changes nothing
    lifted = float(horizontal_distance(capsule(a + up, b + up, r), base))
    assert lifted == pytest.approx(found, abs=1e-9)
