"""Markers show the capsules where they are, in the colour of the level."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.links.ros2.codec import MARKER_BYTES
from hri_predict.base.looks import LOOKS
from hri_predict.base.skeleton import JOINTS
from hri_predict.protocol.messages import Level, Pose, Zone, ZoneCapsule
from hri_predict.protocol.ros.markers import (
    CYLINDER,
    LINE_LIST,
    POINTS,
    SPHERE_LIST,
    pose_markers,
    zone_markers,
)
from tests.hri_predict.protocol.ros.decoding import decoded

MARKERS = "visualization_msgs/msg/MarkerArray"
metres = st.floats(-50, 50)
places = st.tuples(metres, metres, metres)
capsules = st.builds(ZoneCapsule, st.integers(0, 16), places, places, st.floats(0, 3))
zones = st.builds(
    Zone,
    person=st.integers(0, 65_535),
    step=st.integers(0, 255),
    horizon_s=st.floats(0, 2),
    capsules=st.lists(capsules, max_size=255).map(tuple),
)


def markers_of(data):
    return decoded(data, MARKERS).markers


def zone_of(*capsules_: ZoneCapsule, step: int = 0, person: int = 1) -> Zone:
    return Zone(person=person, step=step, horizon_s=0.0, capsules=capsules_)


def turned_z(q) -> np.ndarray:
    """The z axis after the rotation of a quaternion."""
    return np.array(
        [
            2 * (q.x * q.z + q.w * q.y),
            2 * (q.y * q.z - q.w * q.x),
            1 - 2 * (q.x * q.x + q.y * q.y),
        ]
    )


@given(zones, st.sampled_from(Level))
def test_a_cylinder_lies_between_its_ends_and_spheres_are_on_them(zone, level):
    data = zone_markers(zone, stamp_ns=1_700_000_000_000_000_000, frame_id="room", level=level)
    markers = markers_of(data)
    assert len(markers) == 2 * len(zone.capsules)
    assert len(data) <= 8 + MARKER_BYTES * len(markers)
    assert len({(m.ns, m.id) for m in markers}) == len(markers)
    for capsule, cylinder, spheres in zip(zone.capsules, markers[::2], markers[1::2], strict=True):
        a, b = np.array(capsule.a), np.array(capsule.b)
        assert (cylinder.type, spheres.type) == (CYLINDER, SPHERE_LIST)
        middle, axis = cylinder.pose.position, turned_z(cylinder.pose.orientation)
        half = 0.5 * cylinder.scale.z * axis
        # double precision, of values up to 50 m; the rotation near straight down is cut at 1e-9
        center = np.array([middle.x, middle.y, middle.z])
        np.testing.assert_allclose(center - half, a, atol=1e-2 if axis[2] < -0.999 else 1e-6)
        np.testing.assert_allclose(center + half, b, atol=1e-2 if axis[2] < -0.999 else 1e-6)
        assert cylinder.scale.x == cylinder.scale.y == spheres.scale.x == 2 * capsule.radius
        assert [(p.x, p.y, p.z) for p in spheres.points] == [capsule.a, capsule.b]


@pytest.mark.parametrize("level", Level)
def test_the_colour_is_that_of_the_level(level):
    zone = zone_of(ZoneCapsule(0, (0, 0, 0), (0, 0, 1), 0.1))
    marker, _ = markers_of(zone_markers(zone, stamp_ns=0, frame_id="room", level=level))
    shown = [round(255 * c) for c in (marker.color.r, marker.color.g, marker.color.b)]
    assert tuple(shown) == LOOKS[level.name].rgb


def test_what_is_ahead_is_paler_and_has_its_own_namespace():
    capsule = ZoneCapsule(0, (0, 0, 0), (0, 0, 1), 0.1)
    now, ahead = (
        markers_of(
            zone_markers(zone_of(capsule, step=step), stamp_ns=0, frame_id="r", level=Level.STOP)
        )[0]
        for step in (0, 12)
    )
    assert (now.ns, ahead.ns) == ("zone 0", "zone 12")
    assert now.color.a > ahead.color.a > 0


def test_every_marker_disappears_by_itself():
    zone = zone_of(ZoneCapsule(0, (0, 0, 0), (0, 0, 1), 0.1))
    for marker in markers_of(zone_markers(zone, stamp_ns=0, frame_id="r", level=Level.STOP)):
        assert 0 < marker.lifetime.sec * 10**9 + marker.lifetime.nanosec <= 500_000_000


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_capsule_that_is_not_a_number_is_left_out(bad):
    good = ZoneCapsule(1, (0, 0, 0), (0, 0, 1), 0.1)
    zone = zone_of(
        ZoneCapsule(0, (bad, 0, 0), (0, 0, 1), 0.1), good, ZoneCapsule(2, *good[1:3], bad)
    )
    markers = markers_of(zone_markers(zone, stamp_ns=0, frame_id="r", level=Level.STOP))
    assert len(markers) == 2


def test_a_capsule_straight_down_and_one_without_length():
    down = ZoneCapsule(0, (0, 0, 1), (0, 0, 0), 0.1)
    point = ZoneCapsule(1, (1, 1, 1), (1, 1, 1), 0.1)
    markers = markers_of(
        zone_markers(zone_of(down, point), stamp_ns=0, frame_id="r", level=Level.STOP)
    )
    np.testing.assert_allclose(turned_z(markers[0].pose.orientation), [0, 0, -1], atol=1e-12)
    assert markers[2].scale.z == 0.0


@given(st.lists(st.tuples(metres, metres, metres), min_size=1, max_size=40))
def test_a_pose_is_drawn_by_its_bones_or_its_points(positions):
    joints = tuple((j, *place) for j, place in enumerate(positions))
    pose = Pose(person=7, step=3, horizon_s=0.1, joints=joints)
    (marker,) = markers_of(pose_markers(pose, stamp_ns=0, frame_id="room", level=Level.CLEAR))
    if len(positions) == len(JOINTS):
        assert (marker.type, len(marker.points)) == (LINE_LIST, 2 * (len(JOINTS) - 1))
    else:
        assert (marker.type, len(marker.points)) == (POINTS, len(positions))
