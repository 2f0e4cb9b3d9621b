"""Why a robot's states are refused is said with the joint, its value and the remedy."""

import math

import pytest

from hri_predict.node.refused_states import SAY_NS, STUCK, RefusedStates, why_refused
from tests.hri_predict.robots.test_tracker import MODEL, QD, Q, tracker
from tests.messages import make_state

MS = 1_000_000


def state(positions=Q, velocities=QD, counter=1):
    return make_state(tuple(positions), tuple(velocities), counter=counter)


def test_degrees_are_recognised():
    said = why_refused(state([math.degrees(q) for q in Q]), MODEL)
    assert said.startswith("joint 2, 'shoulder_lift")
    assert "outside its limits" in said
    assert said.endswith("radians are meant, these look like degrees")
    said = why_refused(state(velocities=[math.degrees(v) for v in QD]), MODEL)
    assert said.startswith("the velocity of joint 1")
    assert "degrees" in said


@pytest.mark.parametrize("missing", [None, math.nan, math.inf])
def test_what_is_not_a_number_is_named(missing):
    said = why_refused(state([*Q[:2], missing, *Q[3:]]), MODEL)
    assert said == f"joint 3, '{MODEL.joint_names[2]}', is not a number: send a measured one"


def test_a_wrong_number_of_joints_names_them_in_their_order():
    said = why_refused(state(Q[:5], QD[:5]), MODEL)
    assert said.startswith("5 positions for 6 joints")
    assert ", ".join(MODEL.joint_names) in said


def test_what_lies_outside_and_is_not_degrees_says_only_that():
    assert "degrees" not in why_refused(state([*Q[:5], 1000.0]), MODEL)


def test_it_is_said_once_in_ten_seconds_with_the_number(caplog):
    robot = tracker()
    refused = RefusedStates(robot)
    wrong = [math.degrees(q) for q in Q]
    for k in range(605):
        at_ns = k * 20 * MS
        robot.update(state(wrong, counter=k), at_ns, "plc")
        refused.look(state(wrong, counter=k), at_ns, "plc")
    lines = [r.getMessage() for r in caplog.records]
    assert len(lines) == 1 + 604 * 20 * MS // SAY_NS
    assert lines[0].startswith("robot 'arm', link 'plc': 1 RobotStates refused: joint 2")
    assert "501 RobotStates refused" in lines[1]


def test_good_states_and_short_repeats_are_not_worth_a_line(caplog):
    robot = tracker()
    refused = RefusedStates(robot)
    for k in range(500):
        one = state(counter=k // 4, velocities=(0.0,) * 6)
        robot.update(one, k * 5 * MS, "plc")
        refused.look(one, k * 5 * MS, "plc")
    assert caplog.records == []


def test_a_counter_that_stands_still_is_named(caplog):
    robot = tracker()
    refused = RefusedStates(robot)
    for k in range(STUCK + 1):
        robot.update(state(counter=7), k * 20 * MS, "plc")
        refused.look(state(counter=7), k * 20 * MS, "plc")
    (line,) = [r.getMessage() for r in caplog.records]
    assert line == (
        f"robot 'arm', link 'plc': {STUCK} RobotStates have one counter, 7: count up by 1 with "
        "each new state"
    )
