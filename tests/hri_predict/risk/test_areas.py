"""Named zones and the field of view against sampled points."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_predict.base.arrays import Bools, Floats
from hri_predict.base.geometry import Capsules
from hri_predict.base.settings import Region
from hri_predict.risk.areas import FieldOfView, NamedZone, NamedZoneSettings, approach_m
from hri_predict.risk.types import NamedZoneState
from hri_predict.zones.body_zones import BodyZones
from hri_predict.zones.types import Zones
from tests.hri_predict.risk.people_speeds import bodies_in

SQUARE = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]
ELL = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]]
points = st.tuples(st.floats(-2, 5), st.floats(-2, 5), st.floats(-1, 4)).map(np.array)


def zone(**changes) -> NamedZone:
    data = {"name": "door", "polygon": ELL, "z_min": 0.0, "z_max": 2.0, **changes}
    return NamedZone(NamedZoneSettings.model_validate(data), 0.0, stale_s=0.1)


def one(a: Floats, b: Floats, radius: float) -> Capsules:
    return Capsules(np.asarray(a, float)[None], np.asarray(b, float)[None], np.array([radius]))


def in_ell(p: Floats) -> Bools:
    """Oracle: the L is two rectangles."""
    x, y = p[..., 0], p[..., 1]
    low = (x >= 0) & (x <= 3) & (y >= 0) & (y <= 1)
    result: Bools = low | ((x >= 0) & (x <= 1) & (y >= 0) & (y <= 3))
    return result


@given(points, points, st.floats(0, 0.5), st.integers(0, 2**32 - 1))
def test_no_capsule_with_a_point_inside_is_missed(a, b, radius, seed):
    rng = np.random.default_rng(seed)
    offset = rng.normal(size=(400, 3))
    offset *= radius * rng.random((400, 1)) / np.linalg.norm(offset, axis=1, keepdims=True)
    body = a + rng.random((400, 1)) * (b - a) + offset
    inside = in_ell(body) & (body[:, 2] >= 0) & (body[:, 2] <= 2)
    if inside.any():
        assert zone().occupied(one(a, b, radius)).all()


@pytest.mark.parametrize(
    ("a", "b", "radius", "expected"),
    [
        ((0.5, 0.5, 1), (0.5, 0.5, 1), 0.0, True),
        ((2, 2, 1), (2, 2, 1), 0.9, False),  # in the notch
        ((2, 2, 1), (2, 2, 1), 1.1, True),
        ((-1, 0.5, 1), (4, 0.5, 1), 0.0, True),  # right through
        ((0.5, 0.5, 2.2), (0.5, 0.5, 3), 0.1, False),  # above
        ((0.5, 0.5, 2.05), (0.5, 0.5, 3), 0.1, True),
        ((4, 4, 1), (5, 5, 1), 0.1, False),
        ((np.nan, 0, 0), (0, 0, 0), 0.1, True),
        ((50, 50, 1), (50, 50, 1), np.inf, True),
    ],
)
def test_occupied(a, b, radius, expected):
    assert zone().occupied(one(a, b, radius)).item() is expected


def bodies(x: list[float], grown: float = 0.0) -> BodyZones:
    """One sphere of 0.1 m at (x, 0.5, 1) per step; the zones are grown."""
    centre = np.array([[(v, 0.5, 1.0)] for v in x])[None]
    radius = np.full(centre.shape[:-1], 0.1)
    grow = np.full_like(radius, grown)
    grow[:, 0] = 0.0
    times = np.linspace(0.0, 0.1 * (len(x) - 1), len(x))
    zones = Zones((1,), ("head",), times, Capsules(centre, centre, radius + grow))
    return bodies_in(zones, paths=Capsules(centre, centre, radius))


def test_entry_is_predicted_from_the_body_as_forecast():
    walk = [4.5, 4.0, 3.5, 3.05, 2.5]
    state = zone().state(bodies(walk, grown=1.0))
    assert not state.occupied
    assert state.entry_s == pytest.approx(0.2)  # in the interval to 0.3 s
    assert zone(entry="zone").state(bodies(walk, grown=1.0)).entry_s == pytest.approx(0.0)
    assert zone().state(bodies([4.5, 4.4, 4.3])).entry_s is None
    assert zone().state(bodies([2.0, 5.0])) == NamedZoneState("door", True, 0.0)


def test_nobody_occupies_nothing():
    empty = Capsules(np.zeros((0, 2, 1, 3)), np.zeros((0, 2, 1, 3)), np.zeros((0, 2, 1)))
    zones = Zones((), ("head",), np.array([0.0, 0.1]), empty)
    assert zone().state(bodies_in(zones)) == NamedZoneState("door", False, None)


# -- field of view ---------------------------------------------------------------------------------


def view(floor_m: float = 0.0, **changes) -> FieldOfView:
    return FieldOfView.of(Region.model_validate({"polygon": ELL, **changes}), floor_m)


@given(points, points, st.floats(0, 0.3), st.integers(0, 2**32 - 1))
def test_what_is_not_seen_is_never_nearer_than_said(a, b, radius, seed):
    rng = np.random.default_rng(seed)
    distance = view().distance_outside(one(a, b, radius)).item()
    if distance <= 0:
        return
    assert in_ell(np.array([a, b])).all()
    # points outside, near the view's corners and edges where it matters
    outside = rng.uniform(-1, 4, size=(4000, 2))
    outside = outside[~in_ell(outside)]
    s = np.linspace(0, 1, 30)[:, None]
    axis = (a + s * (b - a))[:, :2]
    gaps = np.linalg.norm(outside[:, None] - axis, axis=2).min() - radius
    assert distance <= gaps + 1e-9


@pytest.mark.parametrize(
    ("changes", "a", "b", "expected"),
    [
        ({}, (0.5, 0.5, 1), (0.5, 0.5, 1), 0.4),
        ({}, (0.5, 0.5, 1), (0.5, 2.5, 1), 0.4),
        ({}, (0.5, 2.5, 1), (2.5, 0.5, 1), -0.1),  # ends inside, but across the notch
        ({}, (2, 2, 1), (2, 2, 1), -0.1),
        ({"z_max": 3.0}, (0.5, 0.5, 2.9), (0.5, 0.5, 2.9), 0.4),  # nobody is up there
        ({"z_max": 2.0}, (0.5, 0.5, 1.9), (0.5, 0.5, 1.5), 0.0),
        ({"z_min": 1.0}, (0.5, 0.5, 1.2), (0.5, 0.5, 1.5), 0.1),
        # heights are above the floor, wherever the room's origin is
        ({"z_min": 0.0, "floor_m": -0.8}, (0.5, 0.5, 0.2), (0.5, 0.5, 0.5), 0.1),
        ({"z_min": -0.8, "floor_m": -0.8}, (0.5, 0.5, 0.2), (0.5, 0.5, 0.5), 0.4),
        ({"z_max": 3.0, "floor_m": 1.0}, (0.5, 0.5, 2.9), (0.5, 0.5, 2.9), 0.0),
        ({"z_max": 3.5, "floor_m": 1.0}, (0.5, 0.5, 2.9), (0.5, 0.5, 2.9), 0.4),
    ],
)
def test_distance_to_what_is_not_seen(changes, a, b, expected):
    assert view(**changes).distance_outside(one(a, b, 0.1)).item() == pytest.approx(expected)


def test_approach_of_an_unseen_person():
    assert approach_m(np.array([0.0, 0.1, 0.25, 0.3, 0.3125, 1.0])) == pytest.approx(
        [0.0, 0.2, 0.5, 0.5, 0.5, 1.6]
    )
