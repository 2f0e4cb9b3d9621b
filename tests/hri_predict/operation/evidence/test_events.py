"""Which ticks begin an event."""

from hri_predict.operation.evidence.events import Events
from hri_predict.protocol.messages import Level
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.operation.evidence.ticks import tick

CLEAR, SLOW, STOP = Level.CLEAR, Level.SLOW, Level.STOP
UNKNOWN, FAULT = Level.UNKNOWN, Level.FAULT


def kinds(ticks):
    events = Events()
    return [[(e.kind, e.robot) for e in events.of(each)] for each in ticks], events


def test_a_stop_begins_once():
    found, events = kinds(
        [tick(0, CLEAR), tick(40, STOP), tick(80, STOP), tick(120, SLOW), tick(160, STOP)]
    )
    assert found == [[], [("stop", 0)], [], [], [("stop", 0)]]
    assert events.count == {"stop": 2}


def test_a_fault_begins_when_the_situation_is_no_longer_known():
    found, _ = kinds(
        [tick(0, UNKNOWN), tick(40, CLEAR), tick(80, UNKNOWN), tick(120, FAULT), tick(160, STOP)]
    )
    # a node that starts knows nothing yet: that is no fault
    assert found == [[], [], [("fault", 0)], [], [("stop", 0)]]


def test_a_node_that_is_told_to_end_is_no_fault():
    events = Events()
    for each in (tick(0, CLEAR), tick(40, UNKNOWN, reason=Reason.STOPPING)):
        assert events.of(each) == []


def test_a_near_miss_counts_again_after_a_second_without():
    times = [0, 40, 80, 900, 1800, 2900]
    found, events = kinds([tick(t, SLOW, near=(0,)) for t in times])
    assert [bool(each) for each in found] == [True, False, False, False, False, True]
    assert events.near_misses == {(0, "l_hand", 2): 2}


def test_each_robot_has_events_of_its_own():
    found, events = kinds([tick(0, CLEAR, CLEAR), tick(40, STOP, SLOW, near=(1,))])
    assert found[1] == [("stop", 0), ("near_miss", 1)]
    report = events.report(["arm", "crane"], [("a", "b", "c"), ("x", "y", "hook")])
    assert report["near_misses"] == [
        {"robot": "crane", "body_part": "l_hand", "robot_link": "hook", "count": 1}
    ]
