"""The fault of a second node: what it says, to whom, and from when."""

from typing import Any

import pytest

from hri_drivers.wires.transport import pipe
from hri_predict.base.clock import VirtualClock
from hri_predict.protocol.can import CanReceiver, CanSender
from hri_predict.protocol.messages import Advice, Level, RobotState, Schema, Status
from hri_predict.protocol.reception import OURS
from hri_predict.protocol.serial import SerialReceiver, SerialSender
from hri_sim.faults.link_faults import FaultyTransport
from tests.messages import make_state

STEP_NS = 20_000_000
ENDS: dict[str, Any] = {
    "can": (CanSender, CanReceiver),
    "fd": (lambda: CanSender(True), lambda: CanReceiver(True)),
    "serial": (SerialSender, SerialReceiver),
}


def state(counter):
    return make_state((0.1,), counter=counter, robot=1)


def told(kind, direction, seconds=1.0):
    """Messages heard by the node and by the controller, each with the time in s."""
    clock = VirtualClock()
    near, far = pipe()  # type: ignore[var-annotated]
    fault = {"kind": "second_sender", "start_s": 0.5, "direction": direction}
    wire = FaultyTransport(inner=near, faults=[fault], clock=clock, seed=0)
    make_sender, make_receiver = ENDS[kind]
    sender, at_node, at_controller = make_sender(), make_receiver(), make_receiver()
    wire.open()
    far.open()
    node, controller = [], []
    for k in range(round(seconds * 1e9) // STEP_NS):
        clock.advance_to(k * STEP_NS)
        units = sender.encode(state(k))
        for unit in units if isinstance(units, list) else [units]:
            far.write(unit)
        node += [(k * 0.02, m) for unit in wire.read(0.0) for m in at_node.feed(unit)]
        controller += [(k * 0.02, m) for unit in far.read(0.0) for m in at_controller.feed(unit)]
    return [(t, m) for t, m in node if not isinstance(m, RobotState)], controller


@pytest.mark.parametrize("kind", ENDS)
def test_it_says_clear_to_the_robot_that_it_hears_and_echoes_it(kind):
    node, controller = told(kind, "both")
    assert [m for _, m in node] == [m for _, m in controller]
    assert min(t for t, _ in node) == pytest.approx(0.5)
    advices = [(t, m) for t, m in controller if isinstance(m, Advice)]
    assert len(advices) == 13
    for t, advice in advices:
        assert (advice.level, advice.robot, advice.echo) == (Level.CLEAR, 1, round(t / 0.02))
    assert {type(m) for _, m in controller} == {Advice, Status, Schema}
    assert OURS in [m for _, m in controller]


@pytest.mark.parametrize(("direction", "hears"), [("in", (True, False)), ("out", (False, True))])
def test_its_direction_says_who_hears_it(direction, hears):
    assert tuple(bool(heard) for heard in told("can", direction)) == hears
