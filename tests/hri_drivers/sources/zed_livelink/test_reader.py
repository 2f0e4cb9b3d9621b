"""Stereolabs' Live Link: both senders, captures in several datagrams, and bytes that are not it."""

import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hri_drivers.sources.mocap.frames import Frame, FrameError
from hri_drivers.sources.zed_livelink.source import AXES, UNITS, ZedReader
from hri_predict.contracts.joint_map import axes_rotation, load_joint_map
from hri_predict.contracts.source import SourceCounters
from hri_sim.people.body import Body
from hri_sim.senders import zed_livelink

BODY = Body(1.75)
JOINTS = BODY.joints(BODY.standing(np.array([1.0, 2.0]), 0.3))
MAP = load_joint_map("zed38").with_units(1.0).with_axes(["x", "y", "z"])
UTC = 1_790_000_000_000_000_000


class Cameras:
    """A reader, and its counters."""

    def __init__(self) -> None:
        self.counters = SourceCounters()
        self.reader = ZedReader(MAP.source_joints, 0.3, self.counters)

    def read(self, *datagrams: bytes) -> list[Frame]:
        found = [self.reader.read(data) for data in datagrams]
        return [frame for frame in found if frame is not None]


def changed(data: bytes, **change: Any) -> bytes:
    return json.dumps(json.loads(data) | change).encode()


def one(frame_id: int = 1, people: int = 1) -> list[bytes]:
    bodies = {k: JOINTS + k for k in range(people)}
    return zed_livelink.for_unreal(bodies, UTC + frame_id, frame_id)


@pytest.mark.parametrize("unity", [False, True])
def test_every_joint_is_where_the_person_has_it(unity: bool) -> None:
    people = {7: JOINTS, 65536 + 9: JOINTS + 1.0}
    datagrams = (
        [zed_livelink.for_unity(people, UTC)] if unity else zed_livelink.for_unreal(people, UTC, 5)
    )
    (frame,) = Cameras().read(*datagrams)
    assert (frame.stamp_ns, frame.number) == (UTC, None if unity else 5)
    assert [person.id for person in frame.people] == [7, 9]  # ids have 16 bits
    joints, seen = MAP.map(frame.people[0].positions, frame.people[0].observed)
    assert seen.sum() == 20
    assert np.abs(joints - JOINTS)[seen].max() < 1e-5  # sent to 0.01 mm


@pytest.mark.parametrize("system", range(len(AXES)))
@pytest.mark.parametrize("unit", range(len(UNITS)))
def test_each_coordinate_system_and_unit_of_the_sdk(system: int, unit: int) -> None:
    metres = [0.001, 0.01, 1.0, 0.0254, 0.3048][unit]
    axes, left_handed = AXES[system]
    keypoints = zed_livelink.keypoints_of(JOINTS) @ axes_rotation(axes, left_handed) / metres
    places = [dict(zip("xyz", place, strict=True)) for place in keypoints.tolist()]
    (data,) = one()
    (frame,) = Cameras().read(
        changed(data, keypoint=places, coordinate_system=system, coordinate_unit=unit)
    )
    joints, seen = MAP.map(frame.people[0].positions, frame.people[0].observed)
    np.testing.assert_allclose(joints[seen], JOINTS[seen], atol=1e-9)


def test_a_capture_waits_for_all_of_its_bodies() -> None:
    cameras = Cameras()
    first, second = one(1, people=2)
    assert cameras.read(first) == []
    assert len(cameras.read(second)[0].people) == 2
    lost, _ = one(2, people=2)
    assert len(cameras.read(lost, *one(3, people=2))) == 1
    assert cameras.counters.incomplete == 1


def test_an_empty_room_is_said_by_the_sender_for_unity_alone() -> None:
    assert zed_livelink.for_unreal({}, UTC, 1) == []
    (frame,) = Cameras().read(zed_livelink.for_unity({}, UTC))
    assert frame.people == ()


def test_a_body_that_is_searched_for_is_not_observed() -> None:
    (data,) = one()
    (frame,) = Cameras().read(changed(data, tracking_state=2))
    assert not frame.people[0].observed.any()


def test_joints_of_little_confidence_are_counted_and_not_observed() -> None:
    cameras = Cameras()
    (data,) = one()
    (frame,) = cameras.read(changed(data, keypoint_confidence=[29.0] * 38))
    assert not frame.people[0].observed.any()
    assert cameras.counters.unsure_joints > 20


def test_poses_of_cameras_are_ignored_and_counted() -> None:
    cameras = Cameras()
    assert cameras.read(zed_livelink.camera(UTC, 1)) == []
    assert cameras.counters.ignored == 1


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"keypoint": []}, "0 keypoints, and the joint map has 38"),
        ({"keypoint_confidence": [1]}, "one number for each"),
        ({"tracking_state": 0}, "enable tracking"),
        ({"coordinate_system": 6}, "not the SDK's"),
        ({"coordinate_unit": -1}, "not the SDK's"),
        ({"timestamp": 0}, "nanoseconds of UTC"),
        ({"timestamp": 1.5}, "'timestamp'"),
        ({"nb_bodies": 0}, "1 bodies of 0"),
        ({"nb_bodies": 65}, "at most 64"),
        ({"id": True}, "'id'"),
        ({"role": None}, "'role'"),
    ],
)
def test_a_wrong_body_is_refused_with_the_remedy(change: dict[str, Any], says: str) -> None:
    (data,) = one()
    with pytest.raises(FrameError, match=says):
        Cameras().reader.read(changed(data, **change))


def test_an_id_that_comes_twice_is_refused() -> None:
    cameras = Cameras()
    first, _ = one(1, people=2)
    cameras.read(first)
    with pytest.raises(FrameError, match="an id occurs twice"):
        cameras.read(first)


@given(st.binary(max_size=60), st.integers(0, 4000), st.booleans())
def test_any_bytes_are_a_capture_or_refused(junk: bytes, at: int, unity: bool) -> None:
    sound = zed_livelink.for_unity({1: JOINTS}, UTC) if unity else one()[0]
    for data in (junk, sound[:at] + junk + sound[at + len(junk) :]):
        try:
            frames = Cameras().read(data)
        except FrameError:
            continue
        for person in frames[0].people if frames else ():
            assert np.isfinite(person.positions[person.observed]).all()
