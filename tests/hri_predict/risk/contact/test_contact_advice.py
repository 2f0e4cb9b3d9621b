"""What is advised where contact is permitted, and what the detail says of it."""

import re

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.base.skeleton import CANONICAL
from hri_predict.people.snapshot import PeopleSnapshot
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.levels.advice import Levels
from tests.hri_predict.risk.contact.cell import (
    HYBRID,
    MODEL,
    READY,
    SEGMENTS,
    TIP,
    beside,
    people,
    stage,
    standing,
)


def advised(bodies, remarks=(), captures=40):
    """The advice after some captures of the same scene, at the robot's present remarks."""
    constants, separation = stage()
    levels = Levels(
        settings=HYBRID,
        robots=[constants],
        named=[],
        horizon_s=1.2,
        segment_index=np.arange(len(SEGMENTS)),
    )
    joints = len(CANONICAL.joints)
    advice = None
    for k in range(captures):
        now_ns = 10**9 + k * 40_000_000
        snapshot = PeopleSnapshot(
            now_ns=now_ns,
            ids=bodies.zones.ids,
            history=np.zeros((1, 2, joints, 3)),
            observed=np.ones((1, 2, joints), bool),
            capture_ns=np.array([now_ns]),
            last_positions=np.zeros((1, joints, 3)),
            joint_age_s=np.zeros((1, joints)),
            lost=(),
            reasons=(),
            newest_capture_ns=now_ns,
            captures=k,
            counters={},
        )
        said = [remarks if k == captures - 1 else ()]
        advice = levels(snapshot, bodies, separation(bodies, [standing()]), said)[0]
    return advice


@pytest.mark.parametrize("other", ["head", "thorax"])
def test_the_distance_that_the_detail_tells_is_that_of_the_part_it_names(other):
    there = TIP + np.array([-0.45, 0.0, 0.1])
    advice = advised(people({"l_hand": beside(x=-0.2), other: tuple(there)}, growth=0.6))
    told = re.search(r"person 7, (\w+), ([\d.]+) m from (\w+)", advice.detail)
    assert told is not None
    part, distance, link = told.groups()
    assert part == other
    links = MODEL.capsules(READY)
    c = MODEL.capsule_names.index(link)
    true = capsule_distance(
        Capsules(there, there, np.array(0.05)),
        Capsules(links.a[c], links.b[c], links.radius[c]),
    )
    assert float(distance) == pytest.approx(float(true), abs=0.006)
    assert advice.separation_m < true - 0.1  # the hand is nearer


def test_a_robot_that_does_not_keep_its_limit_may_touch_nobody():
    hand = people({"l_hand": beside()})
    obeys = advised(hand)
    assert obeys.level is not Level.STOP
    assert obeys.speed_limit_m_s > 0
    ignores = advised(hand, [Reason.ROBOT_TOO_FAST])
    assert ignores.level is Level.STOP
    assert ignores.speed_limit_m_s == 0
