"""What an Acknowledge ends in the node: what was shown, once, after a pause."""

from hri_predict.contracts.link import Received
from hri_predict.node.presses import QUIET_S
from hri_predict.protocol.messages import Acknowledge, NodeState
from hri_predict.protocol.reasons import Reason
from tests.hri_predict.node.test_node import heard, near

__all__ = ["near"]  # the fixture


def press(near, link, latch, ack):
    link.inbox.append(Received(Acknowledge(latch, ack), near.clock.now_ns()))
    return near.run(0.04)[-1]


def lose(near):
    """Lose a person for long enough to acknowledge that; return the tick that shows it."""
    near.node._people._lost.forgotten = True
    return near.run(QUIET_S + 1.0)[-1]


def test_an_acknowledgement_ends_what_it_names_once(near):
    drive, monitor = heard(near)
    tick = lose(near)
    shown = tick.advices[0].latch_id
    assert tick.status.reason is Reason.ROOM_NOT_SEEN_EMPTY
    assert shown
    for latch in (0, shown + 1):  # what an old controller sends, and what is not shown
        assert press(near, monitor, latch, 7).status.reason is Reason.ROOM_NOT_SEEN_EMPTY
    assert near.node.acknowledges == 0
    tick = press(near, drive, shown, 7)
    assert tick.status.reason is Reason.NONE
    assert tick.advices[0].latch_id == 0
    for _ in range(3):
        press(near, drive, shown, 7)
    assert near.node.acknowledges == 1
    assert near.node.acknowledges_refused == 2
    assert near.node.acknowledges_not_counted == {"names_nothing": 1, "not_shown": 1}


def test_what_is_lost_again_has_another_number(near):
    drive, _ = heard(near)
    first = lose(near).advices[0].latch_id
    press(near, drive, first, 7)
    tick = lose(near)
    assert tick.advices[0].latch_id not in (0, first)
    assert press(near, drive, first, 8).status.reason is Reason.ROOM_NOT_SEEN_EMPTY


def test_acknowledges_without_end_count_for_nothing_and_are_said(near):
    drive, _ = heard(near)
    near.node._people._lost.forgotten = True
    latch, reasons = 0, []
    for ack in range(1, 60):
        drive.inbox.append(Received(Acknowledge(latch, ack), near.clock.now_ns()))
        tick = near.run(0.4)[-1]
        latch = tick.advices[0].latch_id
        reasons += tick.assessment.reasons
    assert tick.status.reason is Reason.ROOM_NOT_SEEN_EMPTY
    assert tick.status.node_state is NodeState.DEGRADED
    assert Reason.ACKNOWLEDGE_REPEATED in reasons
    assert near.node.acknowledges == 0
    assert near.node.acknowledges_refused == 59
    quiet = near.run(QUIET_S)[-1]
    assert Reason.ACKNOWLEDGE_REPEATED not in quiet.assessment.reasons
    assert press(near, drive, latch, 99).status.reason is Reason.NONE


def test_a_tick_that_fails_releases_nothing(near, monkeypatch):
    drive, _ = heard(near)
    shown = lose(near).advices[0].latch_id
    with monkeypatch.context() as patched:
        patched.setattr(near.node._prediction, "run", None)
        press(near, drive, shown, 7)
    near.run(0.04)
    assert near.node.acknowledges_refused == 1
