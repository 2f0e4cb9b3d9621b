"""What the node's status says of what the self-check found."""

from dataclasses import replace

import pytest

from hri_predict.protocol.messages import NodeState
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
