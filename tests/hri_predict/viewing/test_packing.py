import json
import re

import numpy as np
import pytest

from hri_predict.base.geometry import Capsules, capsule_distance
from hri_predict.protocol.messages import Advice, Level, NodeState
from hri_predict.protocol.reasons import Reason
from hri_predict.risk.types import Grounds
from hri_predict.viewing.packing import STEPS, robot_facts, state_facts, steps_of
from hri_predict.viewing.picture import pack, unpack
from tests.hri_predict.viewing.staged import pictures


@pytest.fixture(scope="module")
def near():
    """The demo's cell with its person in front of the robot."""
    return pictures([6.5])[0]


def capsules(rows) -> Capsules:
    return Capsules(rows[..., :3], rows[..., 3:6], rows[..., 6])


@pytest.mark.long
def test_a_picture_holds_people_forecast_zones_and_robots(near):
    facts, steps = near.facts, len(near.facts["times_s"])
    assert facts["people"] == [1] == facts["zones"]
    assert near.bodies.shape[0] == 1
    assert near.forecast.shape[:2] == near.zones.shape[:2] == (1, steps)
    assert facts["robots"][0]["capsules"] == len(near.robots) > 3
    assert facts["robots"][0]["level"] == "STOP"
    assert list(facts["named"]) == ["bench"]
    assert facts["room"]["view"] is not None


def test_zones_hold_the_body_at_its_capture(near):
    body, zone = near.bodies[0], near.zones[0, 0]
    middle = 0.5 * (body[:, :3] + body[:, 3:6])
    inside = capsule_distance(capsules(np.c_[middle, middle, 0 * body[:, 6]]), capsules(zone))
    assert (inside < 1e-4).all()  # 32-bit floats at 3 m


def test_the_forecast_begins_near_the_body(near):
    shift = np.linalg.norm(near.forecast[0, 0, :, :3] - near.bodies[0, :, :3], axis=-1)
    assert shift.max() < 0.5  # nobody's hand goes faster than 10 m/s: 2 steps of 25 ms


def test_the_separation_line_is_as_long_as_said(near):
    robot = near.facts["robots"][0]
    one, other = np.array(robot["line"])
    said_m = float(robot["apart"].split()[0])
    assert np.linalg.norm(one - other) == pytest.approx(said_m, abs=0.006)  # two digits are said
    assert robot["apart"].endswith("at 0.00 m/s; new captures must confirm it")  # STOP
    assert re.fullmatch(r"person 1's (left|right) \w+ - [\w ]+", robot["pair"])


def test_whoever_stands_there_is_told_the_deciding_part_while_a_person_decides():
    def near(level: Level, reason: Reason, person: int | None = 1) -> str:
        why = Grounds(person=person, segment="left_hand", pair_m=0.671)
        advice = Advice(robot=0, level=level, reason=reason)
        return robot_facts("arm", advice, why, link="forearm", band_m=None)["near"]

    said = "person 1's left hand, 0.67 m from the forearm"
    assert near(Level.STOP, Reason.PERSON_NEAR) == said
    assert near(Level.CLEAR, Reason.PERSON_NEAR) == ""
    assert near(Level.STOP, Reason.ROBOT_NOT_AUTOMATIC) == ""
    assert near(Level.STOP, Reason.PERSON_NEAR, person=None) == ""


@pytest.mark.long
def test_the_band_is_the_configured_one():
    robot = pictures([5.8])[0].facts["robots"][0]
    assert (robot["level"], robot["reason"]) == ("SLOW", Reason.PERSON_APPROACHING.text)
    assert "by 0.1 m (risk.band_m)" in robot["clears"]
    assert re.fullmatch(r"person 1's [\w ]+, \d\.\d\d m from the [\w ]+", robot["near"])


def test_a_link_without_contact_is_named_as_what_degrades_the_node():
    facts = state_facts(NodeState.DEGRADED, [], ["plc"])
    assert facts == {"state": "DEGRADED", "reasons": ["link plc is not connected"]}


def test_a_picture_is_small_enough_and_plain_data(near):
    packed = pack(near)
    assert len(packed) < 50_000
    assert json.dumps(unpack(packed[4:]).facts)


@pytest.mark.parametrize("count", [1, 2, 8, 31])
def test_the_steps_that_are_sent_begin_now_and_end_at_the_horizon(count):
    steps = steps_of(count)
    assert steps[0] == 0
    assert steps[-1] == count - 1
    assert len(steps) == min(STEPS, count)


def test_a_room_that_nobody_is_in_makes_a_picture():
    first = pictures([0.5])[0]
    assert first.facts["people"] == []
    assert len(first.bodies) == len(first.zones) == 0
