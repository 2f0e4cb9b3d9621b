"""What the node's status says of what the self-check found, and of what is left out."""

from dataclasses import replace

import pytest

from hri_predict.node.shedding import SHED_TICKS
from hri_predict.protocol.messages import Advice, NodeState, Pose, Status, Zone
from hri_predict.protocol.reasons import Reason


@pytest.fixture
def finding(make_workcell, monkeypatch):
    """A node that runs, near somebody, and whose risk stage finds what the test says."""

    def made(reasons):
        cell = make_workcell(make_workcell.near)
        cell.run(0.6)
        assess = cell.node._risk.assess
        monkeypatch.setattr(
            cell.node._risk, "assess", lambda *args: replace(assess(*args), reasons=reasons)
        )
        return cell

    return made


@pytest.mark.parametrize(
    ("reasons", "state", "told"),
    [
        ((), NodeState.RUNNING, Reason.NONE),
        ((Reason.ZONES_WIDENED,), NodeState.RUNNING, Reason.ZONES_WIDENED),
        ((Reason.MOTION_UNLIKE,), NodeState.DEGRADED, Reason.MOTION_UNLIKE),
        ((Reason.CALIBRATION_DRIFT,), NodeState.DEGRADED, Reason.CALIBRATION_DRIFT),
        ((Reason.MOTION_UNLIKE, Reason.ZONES_WIDENED), NodeState.DEGRADED, Reason.MOTION_UNLIKE),
        ((Reason.PREDICTOR_LATE, Reason.ZONES_WIDENED), NodeState.DEGRADED, Reason.PREDICTOR_LATE),
    ],
)
def test_wider_zones_alone_are_the_self_check_at_work(finding, reasons, state, told):
    (tick,) = finding(reasons).run(0.04)
    assert (tick.status.node_state, tick.status.reason) == (state, told)


def test_wider_zones_do_not_hide_a_link_that_is_down(finding, monkeypatch):
    cell = finding((Reason.ZONES_WIDENED,))
    assert cell.run(0.04)[0].status.node_state is NodeState.RUNNING
    link = cell.assembly.links[1]
    down = property(lambda _: False, lambda _, __: None)  # whatever the link finds out
    monkeypatch.setattr(type(link), "connected", down, raising=False)
    assert cell.run(0.04)[0].status.node_state is NodeState.DEGRADED


def kinds(tick):
    return {type(message) for message in tick.messages}


def test_what_is_left_out_under_load_is_told_and_the_advice_is_whole(make_workcell):
    cell = make_workcell(make_workcell.near)
    cell.run(0.6)
    shedding = cell.node.shedding
    (before,) = cell.run(0.04)
    assert {Zone, Pose, Advice, Status} <= kinds(before)
    for without in ((Pose,), (Pose, Zone)):
        for _ in range(SHED_TICKS):
            shedding.note(0.9, 0)
        (tick,) = cell.run(0.04)
        assert {Zone, Pose} - kinds(tick) == set(without)
        assert {Advice, Status} <= kinds(tick)
        assert (tick.status.node_state, tick.status.reason) == (
            NodeState.DEGRADED,
            Reason.LOAD_SHED,
        )
        assert Reason.LOAD_SHED not in [advice.reason for advice in tick.advices]
        assert tick.assessment is not None
        assert tick.assessment.zones.ids  # they are judged, though not sent
    shedding.note(0.1, 0)
    for seconds in (6, 12):
        shedding.note(0.1, seconds * 10**9)
    (after,) = cell.run(0.04)
    assert {Zone, Pose} <= kinds(after)
    assert (after.status.node_state, after.status.reason) == (NodeState.RUNNING, Reason.NONE)


def test_a_worse_condition_hides_that_something_is_left_out(finding):
    cell = finding((Reason.MOTION_UNLIKE,))
    for _ in range(SHED_TICKS):
        cell.node.shedding.note(0.9, 0)
    (tick,) = cell.run(0.04)
    assert tick.status.reason is Reason.MOTION_UNLIKE
