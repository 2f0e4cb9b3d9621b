"""Capsule fits: everything inside, always; small; the same for a body that was moved."""

import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hri_predict.base.arrays import Floats
from hri_predict.robots.urdf.convert import fit_capsule, needed_radius

SEEDS = st.integers(0, 2**32 - 1)


def cloud(seed: int) -> Floats:
    """A lopsided cloud of 1 to 200 points, centimetres to a metre large."""
    rng = np.random.default_rng(seed)
    spread = 10 ** rng.uniform(-2, 0) * rng.dirichlet([1, 1, 1])
    points: Floats = rng.exponential(1, (int(rng.integers(1, 200)), 3)) * spread
    return points + rng.uniform(-3, 3, 3)


def sphere_volume(radius: float) -> float:
    return 4 / 3 * np.pi * radius**3


def outside(points: Floats, radii: Floats, a: Floats, b: Floats, radius: float) -> float:
    """How far the worst sphere sticks out, by coal."""
    along = b - a
    length = float(np.linalg.norm(along))
    worst = -np.inf
    for point, size in zip(points, radii, strict=True):
        result = coal.DistanceResult()
        axis = coal.Capsule(1e-9, length)
        turn = np.eye(3)
        if length > 1e-9:
            z = along / length
            x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
            x /= np.linalg.norm(x)
            turn = np.column_stack([x, np.cross(z, x), z])
        pose = coal.Transform3s(turn, (a + b) / 2)
        other = coal.Transform3s(np.eye(3), point)
        gap = coal.distance(axis, pose, coal.Sphere(1e-9), other, coal.DistanceRequest(), result)
        worst = max(worst, float(gap) + size - radius)
    return worst


@given(SEEDS)
@pytest.mark.long
def test_every_point_is_inside_and_no_sphere_about_the_mean_is_smaller(seed: int) -> None:
    points = cloud(seed)
    fit = fit_capsule(points)
    along = fit.b - fit.a
    length = float(along @ along)
    t = np.clip((points - fit.a) @ along / length, 0, 1) if length > 0 else np.zeros(len(points))
    far = np.linalg.norm(points - (fit.a + t[:, None] * along), axis=1)
    assert far.max() <= fit.radius + 1e-9
    sphere = np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    assert fit.volume <= sphere_volume(sphere) * (1 + 1e-9)


@settings(max_examples=10)
@given(SEEDS)
@pytest.mark.long
def test_balls_are_inside_by_coal(seed: int) -> None:
    points = cloud(seed)[:40]
    radii = np.random.default_rng(seed).uniform(0, 0.3, len(points))
    fit = fit_capsule(points, radii)
    assert outside(points, radii, fit.a, fit.b, fit.radius) <= 1e-6


@pytest.mark.long
@settings(max_examples=15)
@given(SEEDS)
def test_a_body_that_was_moved_gets_the_capsule_moved(seed: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.exponential(1, (60, 3)) * [0.3, 0.12, 0.05]
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    turn *= np.sign(np.linalg.det(turn))
    shift = rng.uniform(-2, 2, 3)
    fit, moved = fit_capsule(points), fit_capsule(points @ turn.T + shift)
    assert moved.radius == pytest.approx(fit.radius, rel=1e-6)
    expected = np.array([fit.a, fit.b]) @ turn.T + shift
    np.testing.assert_allclose([moved.a, moved.b], expected, atol=1e-6)


@pytest.mark.long
@settings(max_examples=20)
@given(SEEDS, st.floats(0.01, 10))
def test_radius_grows_with_the_body(seed: int, scale: float) -> None:
    points = cloud(seed)
    fit = fit_capsule(points)
    radii = np.zeros(len(points))
    more = np.vstack([points, points.mean(axis=0) + scale])
    assert needed_radius(more, np.zeros(len(more)), fit.a, fit.b) >= fit.radius - 1e-12
    assert needed_radius(points, radii + 0.1, fit.a, fit.b) == pytest.approx(fit.radius + 0.1)


def test_a_capsule_is_found_again() -> None:
    # Points on a capsule of 0.1 m radius and 0.5 m length; its volume is pi r^2 (l + 4 r / 3)
    # = 0.0198968 m3. No capsule that holds them all can be much smaller.
    rng = np.random.default_rng(3)
    direction = rng.standard_normal((4000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    points = 0.1 * direction + np.where(direction[:, :1] > 0, 0.25, -0.25) * [1, 0, 0]
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    fit = fit_capsule(points @ turn.T)
    assert np.pi * 0.01 * (0.5 + 0.4 / 3) == pytest.approx(0.0198968, abs=1e-7)
    assert fit.volume == pytest.approx(0.0198968, rel=0.01)
    assert fit.radius == pytest.approx(0.1, rel=0.01)
    assert float(np.linalg.norm(fit.b - fit.a)) == pytest.approx(0.5, rel=0.02)


def test_a_ball_is_a_sphere() -> None:
    fit = fit_capsule(np.array([[1.0, 2.0, 3.0]]), np.array([0.2]))
    assert fit.volume == pytest.approx(sphere_volume(0.2), rel=1e-6)
    np.testing.assert_allclose(fit.a, [1, 2, 3], atol=1e-6)


@pytest.mark.parametrize("points", [np.zeros((1, 3)), np.outer(np.arange(5.0), [1, 2, 3])])
def test_a_point_and_a_line_need_hardly_a_radius(points: Floats) -> None:
    fit = fit_capsule(points)
    assert fit.radius < 0.05
    assert needed_radius(points, np.zeros(len(points)), fit.a, fit.b) == fit.radius


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.array([[0, np.nan, 0]])])
def test_no_points_or_no_numbers(points: Floats) -> None:
    with pytest.raises(ValueError, match="at least one point"):
        fit_capsule(points)


def test_the_same_body_gives_the_same_capsule() -> None:
    one, again = fit_capsule(cloud(11)), fit_capsule(cloud(11))
    np.testing.assert_array_equal([one.a, one.b], [again.a, again.b])
