"""Who is seen from where, and under which id."""

import numpy as np
import pytest

from hri_predict.base.skeleton import JOINTS
from hri_predict.contracts.scene import Person
from hri_sim.faults.injector import Occlusion
from hri_sim.people.body import Body

MS = 1_000_000
CAMERA = [-5.0, 0.0, 2.0]
BOX = [-1.0, -0.5, -0.6, 0.5, 1.9]  # between the camera and the origin
J = len(JOINTS)


def stands(number, x, y):
    body = Body(1.75)
    joints = body.joints(body.standing(np.array([x, y]), 0.0))
    return Person(number, joints, np.ones(J, bool))


def occlusion(boxes=(BOX,), cameras=(CAMERA,), rename=0.0):
    return Occlusion(cameras, boxes, rename, np.random.default_rng(1))


@pytest.mark.parametrize(
    ("place", "is_seen"),
    [
        ((0.0, 0.0), False),  # behind the box
        ((-2.0, 0.0), True),  # before it
        ((0.0, 2.5), True),  # beside it
        ((8.0, 0.0), False),  # far behind: the camera is hardly higher than the box
    ],
)
def test_a_box_hides_who_is_behind_it(place, is_seen):
    assert bool(occlusion().seen([stands(1, *place)], 0)) is is_seen


def test_a_second_camera_sees_behind_the_box():
    (person,) = occlusion(cameras=(CAMERA, [5.0, 0.0, 2.0])).seen([stands(1, 0.0, 0.0)], 0)
    assert person.observed.all()


def test_a_low_box_hides_the_legs_alone():
    (person,) = occlusion(boxes=([-1.0, -0.5, -0.6, 0.5, 0.7],)).seen([stands(1, 0.0, 0.0)], 0)
    assert person.observed[JOINTS.index("head")]
    assert not person.observed[JOINTS.index("l_foot")]
    assert np.isnan(person.positions[~person.observed]).all()


def test_people_hide_each_other():
    front, behind = stands(1, -3.5, 0.0), stands(2, -2.5, 0.0)
    assert [p.id for p in occlusion(boxes=()).seen([front, behind], 0)] == [1]
    assert len(occlusion(boxes=()).seen([front, stands(2, -2.5, 1.5)], 0)) == 2


@pytest.mark.parametrize(("rename", "gap_ms", "number"), [(1, 500, 1000), (1, 100, 1), (0, 500, 1)])
def test_who_is_found_again_after_a_while_may_get_another_id(rename, gap_ms, number):
    tracker = occlusion(rename=float(rename))
    for now, place in ((0, (-2.0, 0.0)), (50, (0.0, 0.0)), (gap_ms, (-2.0, 0.0))):
        seen = tracker.seen([stands(1, *place)], now * MS)
    assert [person.id for person in seen] == [number]
