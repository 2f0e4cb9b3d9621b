"""Near misses: hardly farther than the robot's motion needs."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from hri_predict.risk.levels.near_miss import near_misses
from hri_predict.risk.separation.stage import Findings, RobotFindings
from hri_predict.risk.terms import Finding
from hri_predict.zones.body_zones import BodyZones

BODIES = cast(
    BodyZones, SimpleNamespace(zones=SimpleNamespace(ids=(7, 8), segments=("head", "l_hand")))
)


def finding(separation_m, limit_m, **changes: Any):
    fields = {
        "separation_m": separation_m,
        "predicted_m": 0.1,
        "slack_m": separation_m - limit_m,
        "near": False,
        "breach_s": 0.5,
        "limits": (1.0,),
        "person": 1,
        "segment": 1,
        "link": 2,
    }
    return Finding(**fields | changes)


def misses(speed_m_s=0.5, **ways: Any):
    return near_misses(Findings((RobotFindings(speed_m_s=speed_m_s, **ways),), ()), BODIES)


@pytest.mark.parametrize(
    ("separation_m", "count"), [(0.99, 0), (1.0, 1), (1.19, 1), (1.21, 0), (5.0, 0)]
)
def test_within_a_fifth_of_the_limit(separation_m, count):
    assert len(misses(people=finding(separation_m, 1.0))) == count


def test_it_names_person_part_and_link():
    (miss,) = misses(people=finding(1.1, 1.0))
    assert (miss.robot, miss.person, miss.segment, miss.link) == (0, 8, "l_hand", 2)
    assert (miss.separation_m, miss.limit_m) == pytest.approx((1.1, 1.0))


def test_a_robot_that_stands_misses_nobody():
    assert misses(0.0, people=finding(1.1, 1.0)) == ()
    assert near_misses(Findings((RobotFindings(),), ()), BODIES) == ()


def test_the_mildest_judgement_counts_as_for_the_advice():
    assert misses(people=finding(0.8, 1.0), standard=finding(0.8, 0.3)) == ()
    assert len(misses(people=finding(0.8, 1.0), standard=finding(0.8, 0.7))) == 1
