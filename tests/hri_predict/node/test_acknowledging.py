"""What an Acknowledge ends in the node: what was shown, once, after a pause."""

import pytest

from hri_predict.contracts.link import Received
from hri_predict.contracts.scene import Scene
from hri_predict.node.presses import QUIET_S
from hri_predict.protocol.messages import Acknowledge, NodeState
from hri_predict.protocol.reasons import Reason
from hri_sim.baseline_demo import baseline_demo
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


@pytest.fixture
def supervised(make_workcell):
    """A robot that is latched since the start, in an empty room, and quiet links."""
    base = baseline_demo()
    asked = {"restart": "supervised", "latch": ["start", "stop"]}
    risk = base.node.risk.model_copy(update=asked)
    return make_workcell(config=base.with_node(risk=risk))


def button(cell):
    """The drive's link, which still brings states, with an inbox for what the test sends."""
    link = next(link for link in cell.assembly.links if link.name == "drive")
    link.inbox, takes = [], link.take

    def take():
        sent, link.inbox = link.inbox, []
        return [*takes(), *sent]

    link.take = take
    return link


def _may_move(tick):
    return tick.advices[0].level.may_move


def test_a_supervised_latch_ends_with_the_release(supervised):
    drive = button(supervised)
    shown = supervised.run(QUIET_S + 1.0)[-1].advices[0].latch_id
    assert shown
    press(supervised, drive, shown, 7)
    held = supervised.run(0.5)
    assert not any(map(_may_move, held))
    assert held[-1].advices[0].latch_id == shown
    press(supervised, drive, 0, 7)
    after = supervised.run(1.0)
    assert after[0].advices[0].latch_id == 0
    assert _may_move(after[-1])
    assert supervised.node.acknowledges == 1
    assert supervised.node.acknowledges_refused == 0


def test_a_supervised_latch_is_not_ended_by_a_button_that_sticks(supervised):
    drive = button(supervised)
    shown = supervised.run(QUIET_S + 1.0)[-1].advices[0].latch_id
    press(supervised, drive, shown, 7)
    assert not any(map(_may_move, supervised.run(QUIET_S)))
    press(supervised, drive, 0, 7)  # much too late
    assert not any(map(_may_move, supervised.run(1.0)))
    assert supervised.node.acknowledges_not_counted == {"too_long": 1}


def test_a_supervised_press_for_lost_people_leaves_the_latch(supervised):
    """They were a pending condition while the button was held: the latch needs its own press."""
    drive = button(supervised)
    shown = lose(supervised).advices[0].latch_id
    press(supervised, drive, shown, 7)
    supervised.run(0.5)
    tick = press(supervised, drive, 0, 7)
    assert tick.status.reason is Reason.NONE
    latch = supervised.run(QUIET_S + 1.0)[-1].advices[0].latch_id
    assert latch not in (0, shown)
    press(supervised, drive, latch, 8)
    supervised.run(0.5)
    press(supervised, drive, 0, 8)
    assert _may_move(supervised.run(1.0)[-1])


def test_after_a_scene_that_could_not_be_processed_somebody_may_be_anywhere(
    near, monkeypatch, caplog
):
    near.run(0.4)

    def raises(*_):
        raise ValueError("injected")

    with monkeypatch.context() as patch:
        patch.setattr(near.node._people, "_take", raises)
        near.run(0.04)
    tick = near.run(QUIET_S + 1.0)[-1]
    assert "could not be processed" in caplog.text
    assert near.node.people_counters["failed_scenes"] >= 1
    assert tick.status.reason is Reason.ROOM_NOT_SEEN_EMPTY
    assert not tick.advices[0].level.may_move
    drive, _ = heard(near)
    assert press(near, drive, tick.advices[0].latch_id, 7).status.reason is Reason.NONE


@pytest.mark.parametrize("people", [None, 5, iter(())], ids=["none", "5", "iterator"])
def test_people_who_cannot_be_counted_may_be_anywhere(near, caplog, people):
    near.run(0.4)
    near.node.receive(Scene(near.clock.now_ns(), 1000, True, people), near.clock.now_ns())
    tick = near.run(QUIET_S + 1.0)[-1]
    assert "could not be processed" in caplog.text
    assert near.node.people_counters["failed_scenes"] == 1
    assert tick.status.reason is Reason.ROOM_NOT_SEEN_EMPTY
