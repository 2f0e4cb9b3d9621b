"""Distance and angle of the nearest person from the robot's base."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.plant.nearest import Nearest, seen_from
from hri_predict.base.settings import Pose
from hri_predict.protocol.messages import Zone, ZoneCapsule

HERE = np.eye(4)
MS = 1_000_000


def capsule(a: tuple[float, float, float], b: tuple[float, float, float], radius: float = 0.2):
    return ZoneCapsule(0, a, b, radius)


def zone(person: int, x: float, y: float) -> Zone:
    body = capsule((x, y, 0.0), (x, y, 1.7))
    return Zone(person=person, step=0, horizon_s=0.0, capsules=(body,), age_s=0.05)


@pytest.mark.parametrize(
    ("body", "distance_m", "degrees"),
    [
        (capsule((2, 0, 0), (2, 0, 1.7)), 1.8, 0),
        (capsule((0, 2, 0), (0, 2, 1.7)), 1.8, 90),
        (capsule((-2, -2, 0), (-2, -2, 1)), math.sqrt(8) - 0.2, -135),
        (capsule((2, -1, 1), (2, 1, 1)), 1.8, 0),  # the nearest point lies between the ends
        (capsule((0.1, 0, 0), (0.1, 0, 1)), 0.0, 0),  # the base is within the body
    ],
)
def test_distance_and_angle_in_the_base_s_plane(body, distance_m, degrees):
    distance, angle = seen_from(HERE, [body])
    assert distance == pytest.approx(distance_m, abs=1e-9)
    assert math.degrees(angle) == pytest.approx(degrees, abs=1e-6)


def test_a_turned_base_sees_it_elsewhere():
    """The base stands at (1, 1), and its x axis points along the room's y axis."""
    turned = Pose(xyz=[1, 1, 0.5], quaternion_xyzw=[0, 0, math.sqrt(0.5), math.sqrt(0.5)])
    nearest = Nearest(turned)
    nearest.take(zone(4, 1.0, 3.0), 0)
    seen = nearest.at(1, 10 * MS)
    assert seen is not None
    assert (seen.person, seen.distance_m) == (4, pytest.approx(1.8))
    assert seen.angle_rad == pytest.approx(0.0, abs=1e-9)
    assert seen.age_s == pytest.approx(0.06)


def test_the_nearest_of_several_counts_and_one_unknown_hides_all():
    nearest = Nearest(Pose())
    nearest.take(zone(1, 4.0, 0.0), 0)
    nearest.take(zone(2, 0.0, 1.0), 0)
    seen = nearest.at(2, 10 * MS)
    assert seen is not None
    assert seen.person == 2
    assert nearest.at(3, 10 * MS) is None
    nearest.take(zone(1, 4.0, 0.0), 240 * MS)
    assert nearest.at(2, 260 * MS) is None  # of the other nothing came for 250 ms


def test_without_a_base_nothing_is_known():
    nearest = Nearest(None)
    nearest.take(zone(1, 4.0, 0.0), 0)
    assert nearest.at(1, 0) is None


@pytest.mark.parametrize("x", [math.nan, math.inf, -math.inf])
def test_a_person_without_a_place_is_unknown_at_once(x):
    nearest = Nearest(Pose())
    nearest.take(zone(1, 4.0, 0.0), 0)
    nearest.take(zone(2, 3.0, 0.0), 0)
    nearest.take(zone(2, x, 0.0), MS)
    assert nearest.at(2, 2 * MS) is None


coordinate = st.floats(-10, 10)
point = st.tuples(coordinate, coordinate, coordinate)


@given(st.lists(st.builds(capsule, point, point, st.floats(0.01, 1)), min_size=1, max_size=5))
def test_the_distance_is_that_of_the_nearest_point_of_a_fine_sampling(bodies):
    distance, angle = seen_from(HERE, bodies)
    shares = np.linspace(0, 1, 2001)[:, None]
    sampled = min(
        float(np.hypot(*(np.array(c.a) + shares * np.subtract(c.b, c.a))[:, :2].T).min()) - c.radius
        for c in bodies
    )
    step = 20 * math.sqrt(2) / 2000  # the longest segment's step
    assert distance == pytest.approx(max(0.0, sampled), abs=step)
    assert -math.pi <= angle <= math.pi
